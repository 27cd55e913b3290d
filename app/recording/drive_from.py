"""`--drive-from FILE`: recorded sticks drive the twin through the same pilot as a pad, and the result is compared.

Only ever a twin: nobody's hand is on the dead-man. Between two drives it waits no longer than `LONGEST_PAUSE_S`.
"""

import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from app.console.inputs import Controls
from app.console.mapping import FRAMES
from app.console.pilot import Pilot
from app.recording.channels import Input
from app.recording.container import RecordingError
from app.recording.reader import Recording
from cobra.control.modes.mode import modes_of
from cobra.description import RobotDescription
from cobra.kinematics.backbone import Backbone
from cobra.messages import Reply, RobotState

Floats = NDArray[np.float64]

KEY: Final = "recording"
"""Among the pilot's sources."""
HELD: Final = frozenset({"left_shoulder", "right_shoulder"})
"""Buttons that shape motion while they are held. What others chose stands in the reading itself."""
LONGEST_PAUSE_S: Final = 2.0
BEFORE_S: Final = 0.5
"""Let go and centred for so long before each press."""
PERIOD_S: Final = 0.02
READY_S: Final = 60.0
STEP_S: Final = 0.05
"""Of the comparison."""


class Drive(NamedTuple):
    """One press of the dead-man: its readings and how long the pause before it was."""

    pause_s: float
    readings: tuple[Input, ...]


class Comparison(NamedTuple):
    """The driven tip against the recorded one, at equal times of driving [m, s]."""

    driven_s: float
    recorded_s: float
    largest_m: float
    rms_m: float
    last_m: float
    way_m: float
    """Of the recorded tip."""

    @property
    def words(self) -> str:
        return (
            f"drove {self.driven_s:.1f} s of {self.recorded_s:.1f} s recorded; the tip was apart at most "
            f"{1e3 * self.largest_m:.1f} mm (rms {1e3 * self.rms_m:.1f} mm, at the end {1e3 * self.last_m:.1f} mm) "
            f"over a way of {self.way_m:.2f} m"
        )


def refuse_real_buses(description: RobotDescription) -> None:
    """Recorded sticks never reach a motor.

    Raises:
        RecordingError: a bus of this robot is not the simulated one.
    """
    for bus in description.buses:
        if bus.interface != "cobra-sim":
            raise RecordingError(
                f"--drive-from drives a twin only: bus {bus.name!r} of {description.name!r} is a real one "
                f"({bus.interface} {bus.channel}); look at the recording with cobra-teleop replay"
            )


def drives_of(recording: Recording) -> tuple[Drive, ...]:
    """The recorded presses in order.

    Raises:
        RecordingError: nobody drove in it, or its sticks were not recorded.
    """
    drives: list[Drive] = []
    readings: list[Input] = []
    end_s = 0.0
    for _, reading in recording.inputs():
        if reading.source:
            readings.append(reading)
        elif readings:
            drives.append(Drive(min(max(readings[0].stamp - end_s, BEFORE_S), LONGEST_PAUSE_S), tuple(readings)))
            end_s, readings = readings[-1].stamp, []
    if readings:
        drives.append(Drive(LONGEST_PAUSE_S, tuple(readings)))
    if not drives:
        raise RecordingError(f"{recording.path}: nobody drove in this recording, so there are no sticks to drive from")
    return tuple(drives)


def plan(path: Path, description: RobotDescription) -> tuple[tuple[Drive, ...], list[RobotState]]:
    """The recorded presses, and the states while they were driven.

    Raises:
        RecordingError: it is no recording, of another robot, nobody drove in it, or a bus of this robot is a real one.
    """
    refuse_real_buses(description)
    with Recording(path) as recording:
        if recording.robot != description.name:
            raise RecordingError(f"{path}: a recording of robot {recording.robot!r}, this is {description.name!r}")
        drives = drives_of(recording)
        return drives, [state for _, state in recording.states() if state.phase == "driving"]


class RecordedInput:
    """An `InputSource` that plays recorded readings; between them it is let go and centred."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._now = Controls()

    @property
    def name(self) -> str:
        return self._name

    def read(self) -> Controls:
        """The newest reading."""
        return self._now

    def show(self, reading: Input | None) -> None:
        """A recorded reading, or None to let go; stamped as if it were read now."""
        stamp = time.monotonic()
        if reading is None:
            self._now = Controls(stamp=stamp)
            return
        self._now = Controls(
            left=reading.left,
            right=reading.right,
            left_trigger=reading.left_trigger,
            right_trigger=reading.right_trigger,
            buttons=frozenset(button for button in reading.buttons if button in HELD),
            stamp=stamp,
        )


class DriveFrom:
    """Arms the twin, drives it through all recorded presses and compares. A thread of its own.

    Args:
        path: the recording.
        description: of the robot that is driven.
        simulated: whether its process says that it is a twin: its buses may be led elsewhere than described.
        arm: asks the robot to arm.
        latest: its newest state.
        wake: tells the driver's stream that the sticks moved.
        tell: hears in words what becomes of it.
    """

    def __init__(
        self,
        path: Path,
        description: RobotDescription,
        pilot: Pilot,
        *,
        simulated: bool,
        arm: Callable[[], Reply],
        latest: Callable[[], RobotState | None],
        wake: Callable[[], None],
        tell: Callable[[str], None],
    ) -> None:
        if not simulated:
            raise RecordingError(
                "--drive-from drives a twin only: the robot process that runs was started on a real bus; look at the "
                "recording with cobra-teleop replay"
            )
        refuse_real_buses(description)
        self._path = path
        self._description = description
        self._pilot = pilot
        self._arm, self._latest, self._wake, self._tell = arm, latest, wake, tell
        self._source = RecordedInput(f"recording {path.name}")
        self._done = threading.Event()
        self._seen: list[RobotState] = []
        self._thread: threading.Thread | None = None
        self.comparison: Comparison | None = None
        """Once it has driven."""

    def start(self) -> None:
        """Read the recording and begin. Raises RecordingError as `plan`."""
        drives, recorded = plan(self._path, self._description)
        self._pilot.attach(KEY, self._source)
        self._thread = threading.Thread(target=self._run, args=(drives, recorded), name="drive from", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Let go."""
        self._done.set()
        if self._thread is not None:
            self._thread.join(2.0)

    def _run(self, drives: Sequence[Drive], recorded: list[RobotState]) -> None:
        self._tell(f"driving the twin from {self._path.name}: {len(drives)} presses")
        try:
            self._get_ready()
            for drive in drives:
                self._press(drive)
        except _EndedError as end:
            self._tell(f"driving from the recording ended: {end}")
        finally:
            self._show(None)
            self._pilot.detach(KEY)
        if self._seen and recorded:
            self.comparison = compare(self._description, recorded, self._seen)
            self._tell(self.comparison.words)

    def _get_ready(self) -> None:
        deadline, asked_s = time.monotonic() + READY_S, -np.inf
        while (state := self._latest()) is None or state.phase != "ready":
            if time.monotonic() > deadline:
                raise _EndedError(f"the twin did not get ready within {READY_S:.0f} s: {state.cause if state else ''}")
            if state is not None and state.phase == "disarmed" and time.monotonic() - asked_s > 1.0:
                asked_s = time.monotonic()
                self._arm()
            self._pass(None, PERIOD_S)

    def _press(self, drive: Drive) -> None:
        self._pass(None, drive.pause_s)
        first = drive.readings[0]
        modes = list(modes_of(self._description))
        refusal = self._pilot.choose(
            KEY,
            mode=modes.index(first.mode) if first.mode in modes else None,
            frame=list(FRAMES).index(first.frame) if first.frame in FRAMES else None,
        )
        if refusal:
            raise _EndedError(refusal)
        begin = time.monotonic()
        for reading in drive.readings:
            section = reading.section if reading.section in self._description.active_sections else None
            refusal = self._pilot.select(KEY, section=section, level=reading.level)
            if refusal:
                raise _EndedError(refusal)
            self._pass(reading, reading.stamp - first.stamp - (time.monotonic() - begin), follow=True)
        self._pass(None, PERIOD_S)

    def _pass(self, reading: Input | None, seconds: float, follow: bool = False) -> None:
        """Hold a reading; with `follow`, show it when its time has come. Collects the states meanwhile."""
        if not follow:
            self._show(reading)
        end = time.monotonic() + max(seconds, 0.0)
        while True:
            self._look()
            rest = end - time.monotonic()
            if self._done.wait(min(max(rest, 0.0), PERIOD_S)):
                raise _EndedError("it was stopped")
            if rest <= PERIOD_S:
                break
            if not follow:
                self._show(reading)
        if follow:
            self._show(reading)

    def _look(self) -> None:
        state = self._latest()
        if state is None or (self._seen and state.tick == self._seen[-1].tick):
            return
        if state.phase in ("stopped", "fault"):
            raise _EndedError(state.cause)
        if state.phase == "driving":
            self._seen.append(state)

    def _show(self, reading: Input | None) -> None:
        self._source.show(reading)
        self._wake()


class _EndedError(Exception):
    """It cannot go on; says why."""


def compare(description: RobotDescription, recorded: Sequence[RobotState], driven: Sequence[RobotState]) -> Comparison:
    """Both measured tips at equal times of driving. Pauses count for nothing."""
    one, other = _path(description, recorded), _path(description, driven)
    end_s = min(one[0][-1], other[0][-1])
    times = np.arange(0.0, end_s + 1e-9, STEP_S)
    tips = [np.stack([np.interp(times, t, tip[:, i]) for i in range(3)], axis=1) for t, tip in (one, other)]
    apart = np.linalg.norm(tips[0] - tips[1], axis=1)
    way = np.linalg.norm(np.diff(tips[0], axis=0), axis=1).sum()
    return Comparison(
        driven_s=float(other[0][-1]),
        recorded_s=float(one[0][-1]),
        largest_m=float(apart.max()),
        rms_m=float(np.sqrt(np.mean(apart**2))),
        last_m=float(apart[-1]),
        way_m=float(way),
    )


def _path(description: RobotDescription, states: Sequence[RobotState]) -> tuple[Floats, Floats]:
    """Time of driving (n,) [s] and the measured tip (n, 3) [m]."""
    backbone = Backbone(description)
    steps = np.diff([state.stamp for state in states], prepend=states[0].stamp)
    # A longer step is a pause between two drives.
    driven_s = np.cumsum(np.where((steps > 0.0) & (steps < BEFORE_S / 2), steps, 0.0))
    tips = np.array([backbone.tip(np.array(state.measured))[:3, 3] for state in states])
    return driven_s, tips
