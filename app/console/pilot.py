"""Who drives, and whether at all: the console's side of hold-to-run. The robot decides once more on its own.

A source drives when its dead-man goes down with the sticks centred while nobody drives and the robot is ready. Every
end of a drive, whatever its cause, asks the same of everybody: release, centre, press again.
"""

import threading
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

from msgspec.structs import replace

from app.console.freeze import FreezeWatch
from app.console.inputs import Controls, InputSource
from app.console.mapping import (
    CLUTCH,
    DEAD_MAN,
    FRAMES,
    Action,
    Profile,
    Selection,
    centred,
    fault_of,
    first_selection,
    map_controls,
)
from app.console.pad_profile import AS_BUILT, PadProfile, corrected
from cobra.clock import Clock
from cobra.control.modes.mode import modes_of
from cobra.control.modes.stick_frame import StickFrame
from cobra.description import RobotDescription
from cobra.messages import Intent, Phase

SILENCE_S = 0.2
"""A source whose newest reading is older ends its drive."""
ROBOT_SILENCE_S = 0.5
"""Without word from the robot for this long nobody drives."""
ANSWER_S = 1.0
"""The robot must answer a press this soon, else that press is void: it may not start to move the robot later."""

WHY_NOT: dict[Phase, str] = {
    "disarmed": "the robot is disarmed: arm it first",
    "commissioning": "a step of commissioning runs: wait until it is done",
    "homing": "the robot is homing: wait until it is ready",
    "holding": "the robot holds: see the cause",
    "stopped": "STOP is latched: clear it first",
    "fault": "the robot has a fault: see the cause, then arm again",
}

NOBODY = Controls(connected=False)

SLOWER_S, SLOWEST_S, SLOWEST = 0.2, 0.5, 0.25
"""Round trips from which motion gets slower, and at which it has this share of its speed; beyond, commands are dropped."""

Stage = Literal["release", "ready", "pressed", "driving"]
"""release: must let go first. ready: may press. pressed: waits for the robot to report its last stop. driving."""


class Wanted(NamedTuple):
    """What the robot is to do now."""

    held: bool
    intent: Intent
    """At rest unless held."""
    input_stamp: float
    """When the driving source was read [s]; 0 when nobody drives."""
    source: str
    """The driving source's key; empty when nobody drives."""
    controls: Controls
    """The driving source's newest reading; at rest when nobody drives."""
    selection: Selection
    ended: str
    """Why the last drive ended, where its driver did not let go; empty while somebody drives."""


class Status(NamedTuple):
    """For people."""

    driver: str
    """Key of the source that drives, or empty."""
    words: dict[str, str]
    """For every source, by key: what it does, or what is missing for it to drive."""
    selection: Selection
    counts: dict[str, int]
    """Readings that were not usable, and ends of drives, by reason."""


@dataclass(slots=True)
class _Source:
    device: InputSource | None
    """Polled where there is one; else its readings are pushed."""
    controls: Controls
    """The newest reading, corrected as its device's profile says."""
    stage: Stage = "release"
    clutched: bool = False
    """The clutch was pressed, and since then not both let go of and the sticks centred."""
    pressed_s: float = 0.0
    watch: FreezeWatch = field(default_factory=FreezeWatch)
    raw: Controls | None = None
    profile: PadProfile = AS_BUILT


class Pilot:
    """Arbiter between the pad and the pages. Safe from any thread; has none of its own."""

    def __init__(
        self,
        description: RobotDescription,
        clock: Clock,
        profiles: Callable[[str], PadProfile] = lambda device: AS_BUILT,
        admits: Callable[[str], bool] = lambda source: True,
    ) -> None:
        """`profiles` gives each device's profile by its name; `admits` says whether a source, by its key, is the driver's: others can only STOP."""
        self._admits = admits
        self._description = description
        self._clock = clock
        self._profiles = profiles
        self._selection = first_selection(description)
        self._lock = threading.Lock()
        self._sources: dict[str, _Source] = {}
        self._driver = ""
        self._engaged_s = 0.0
        self._answered = False
        self._phase: Phase | None = None
        self._phase_s = 0.0
        self._poses: tuple[str, ...] = ()
        self._actions: list[Action] = []
        self._ended = ""
        self._counts: Counter[str] = Counter()

    def attach(self, key: str, device: InputSource) -> None:
        """Poll a device, such as the pad, from now on; its changes may be pushed with `update` as well."""
        with self._lock:
            if key in self._sources:
                self._lose(key, "is another device now")
            controls = device.read()
            self._sources[key] = _Source(device, _unseen(controls))
            self._take(key, controls, self._clock.now())

    def update(self, key: str, controls: Controls) -> None:
        """Take a new reading of a source, such as a page; a key not seen before is a new source."""
        with self._lock:
            if key not in self._sources:
                self._sources[key] = _Source(None, _unseen(controls))
            now = self._clock.now()
            self._take(key, controls, now)
            self._check(now)

    def detach(self, key: str) -> None:
        """A source is gone for good."""
        with self._lock:
            if key in self._sources:
                self._lose(key, "is gone")
                del self._sources[key]

    def robot_phase(self, phase: Phase, poses: tuple[str, ...] = ()) -> None:
        """What the robot says it does, and the poses it keeps; to be told with every state that arrives."""
        with self._lock:
            self._poses = poses
            self._phase, self._phase_s = phase, self._clock.now()
            if not self._driver:
                return
            if phase == "driving":
                self._answered = True
            elif phase != "ready":
                self._end(f"the robot went to {phase}")
            elif self._answered:
                self._end("the robot stopped driving by itself")

    def select(self, key: str, section: int | None = None, level: int | None = None) -> str:
        """Choose section or speed level by index; returns why it was refused, or an empty string."""
        with self._lock:
            if self._driver not in ("", key) or not self._admits(key):
                return f"{self._driver} drives" if self._driver else "take the controls first"
            chosen = self._selection
            if section is not None:
                if section not in self._description.active_sections:
                    return f"section {section} does not bend; those that do: {self._description.active_sections}"
                chosen = replace(chosen, section=section)
            if level is not None:
                if not 0 <= level < len(self._description.teleop.speed_levels):
                    return f"there is no speed level {level}: 0…{len(self._description.teleop.speed_levels) - 1}"
                chosen = replace(chosen, level=level)
            self._selection = chosen
            return ""

    def choose(self, key: str, mode: int | None = None, frame: int | None = None, pose: str | None = None) -> str:
        """Choose a mode or a view for the sticks, by index, or the saved pose to go to, while nobody drives.

        Returns why it was refused, or an empty string.
        """
        with self._lock:
            if self._driver or not self._admits(key):
                return (
                    "let go first: this is changed while nobody drives" if self._driver else "take the controls first"
                )
            chosen, modes = self._selection, modes_of(self._description)
            if mode is not None:
                if not 0 <= mode < len(modes):
                    return f"there is no mode {mode}: 0…{len(modes) - 1}"
                chosen = replace(chosen, mode=modes[mode])
            if frame is not None:
                if not 0 <= frame < len(FRAMES):
                    return f"there is no view {frame}: 0…{len(FRAMES) - 1}"
                chosen = replace(chosen, frame=FRAMES[frame])
            if pose is not None:
                chosen = replace(chosen, pose=pose)
            self._selection = chosen
            return ""

    @property
    def frame(self) -> StickFrame:
        """The view that the sticks go by."""
        return self._selection.frame

    def command(self, now: float, robot_lag_s: float = 0.0) -> Wanted:
        """What to send to the robot now [s, the console's clock], whose round trip is `robot_lag_s` beside the page's own."""
        with self._lock:
            self._refresh(now)
            source = self._sources.get(self._driver)
            controls = source.controls if source else NOBODY
            if source and source.clutched:
                controls = replace(controls, buttons=controls.buttons | {CLUTCH})
            intent = map_controls(controls, controls, self._selection, self._shape(source), self._description).intent
            intent = replace(intent, speed=intent.speed * pace(controls.lag_s + robot_lag_s))
            return Wanted(
                source is not None, intent, controls.stamp, self._driver, controls, self._selection, self._ended
            )

    def take_actions(self) -> tuple[Action, ...]:
        """What buttons asked for since the last call."""
        with self._lock:
            taken, self._actions = tuple(self._actions), []
            return taken

    def status(self, now: float) -> Status:
        """Who drives, and in words what keeps everybody else from it."""
        with self._lock:
            self._refresh(now)
            words = {key: self._words(key, source, now) for key, source in self._sources.items()}
            return Status(self._driver, words, self._selection, dict(self._counts))

    def _refresh(self, now: float) -> None:
        for key, source in self._sources.items():
            if source.device is not None and (controls := source.device.read()) is not source.raw:
                self._take(key, controls, now)
        self._check(now)

    def _take(self, key: str, controls: Controls, now: float) -> None:
        source = self._sources[key]
        source.raw, source.profile = controls, self._profiles(controls.device or self._device_of(source))
        controls = corrected(controls, source.profile) if source.device else controls  # a page corrects its own pad
        previous, source.controls = source.controls, controls
        source.watch.look(controls)
        shape = self._shape(source)
        mapped = map_controls(controls, previous, self._selection, shape, self._description, self._poses)
        if fault := fault_of(controls):
            self._counts[f"{key}: {fault}"] += 1
        if "stop" in mapped.actions:
            self._actions = ["stop"]
            self._end(f"STOP by {self._name(key)}")
            source.stage = "release"  # a dead-man that goes down together with STOP is no press
            return

        silent = DEAD_MAN in previous.buttons and controls.stamp - previous.stamp > SILENCE_S
        unfit = "fell silent" if silent else self._unfit(source, now)
        if unfit:
            self._lose(key, unfit)
            return
        if not self._is_drivers(key):
            source.stage = "release"
            return
        at_rest = centred(controls, self._shape(source))
        source.clutched = CLUTCH in controls.buttons or (source.clutched and not at_rest)
        if not self._driver:
            self._selection = mapped.selection
        elif self._driver == key:
            kept = self._selection
            self._selection = replace(mapped.selection, mode=kept.mode, frame=kept.frame, pose=kept.pose)
        if not self._driver and not mapped.held and at_rest:
            self._actions += mapped.actions
        self._step(key, source, mapped.held, at_rest, now)

    def _step(self, key: str, source: _Source, held: bool, at_rest: bool, now: float) -> None:
        """Advance a sound source by one reading."""
        if not held:
            if source.stage == "driving":
                self._end(f"{self._name(key)} let go")
                self._ended = ""
            source.stage = "ready"
        elif source.stage == "ready":
            source.stage = "pressed" if at_rest else "release"
            source.pressed_s = now
        elif source.stage == "pressed" and not at_rest:
            source.stage = "release"
        self._engage(key, source, now)

    def _engage(self, key: str, source: _Source, now: float) -> None:
        if source.stage != "pressed":
            return
        phase = self._phase_at(now)
        if not self._driver and phase == "ready":
            source.stage = "driving"
            self._driver, self._engaged_s, self._answered, self._ended = key, now, False, ""
        elif self._driver or phase != "driving" or now - source.pressed_s > ANSWER_S:
            # `driving` is the echo of the drive before: only for that is it worth waiting.
            source.stage = "release"

    def _check(self, now: float) -> None:
        """What time alone changes."""
        for key, source in self._sources.items():
            if source.stage == "driving":
                self._is_drivers(key)
            if source.stage in ("pressed", "driving") and (unfit := self._unfit(source, now)):
                self._lose(key, unfit)
            self._engage(key, source, now)
        if self._driver and self._phase_at(now) is None:
            self._end("no word from the robot")
        if self._driver and not self._answered and now - self._engaged_s > ANSWER_S:
            self._end("the robot does not follow")

    def _unfit(self, source: _Source, now: float) -> str:
        """Why this source cannot drive now, or an empty string."""
        controls = source.controls
        if not controls.connected:
            return "has a button held since it came: let go of it" if controls.buttons else "is not connected"
        if fault := fault_of(controls):
            return f"reads values that are {fault}"
        if abs(now - controls.stamp) > SILENCE_S:
            return "fell silent"
        moving = source.stage == "driving" and not centred(controls, self._shape(source))
        if moving and (source.device is not None or controls.device) and source.watch.frozen():
            return "does not change any more, as if it were frozen"
        return ""

    def _is_drivers(self, key: str) -> bool:
        """Whether the source may drive; the drive of one that may no more ends here."""
        if self._admits(key):
            return True
        if self._driver == key:
            self._lose(key, "is not the driver's any more")
        return False

    def _lose(self, key: str, why: str) -> None:
        if self._driver == key:
            self._counts[f"drive ended: {why}"] += 1
            self._end(f"{self._name(key)} {why}")
        self._sources[key].stage = "release"

    def _end(self, why: str) -> None:
        """Nobody drives any more; whoever holds the dead-man lets go first."""
        if self._driver:
            self._ended = why
        self._driver = ""
        for source in self._sources.values():
            if source.stage != "ready":
                source.stage = "release"

    def _phase_at(self, now: float) -> Phase | None:
        return self._phase if now - self._phase_s <= ROBOT_SILENCE_S else None

    def _shape(self, source: _Source | None) -> Profile:
        return source.profile.shape if source else AS_BUILT.shape

    def _device_of(self, source: _Source) -> str:
        return source.device.name if source.device else ""

    def _name(self, key: str) -> str:
        device = self._sources[key].device
        return device.name if device is not None else key

    def _words(self, key: str, source: _Source, now: float) -> str:
        dead_man = "LB" if source.device is not None else "the hold button"
        if key == self._driver:
            return "clutch: centre the sticks and let go of it" if source.clutched else "drives"
        if unfit := self._unfit(source, now):
            return f"{self._name(key)} {unfit}"
        if not self._admits(key):
            return "it is not chosen to drive; STOP acts" if source.device else "take the controls to drive; STOP acts"
        if self._driver:
            return f"{self._name(self._driver)} drives; only STOP acts from here"
        at_rest = centred(source.controls, self._shape(source))
        if DEAD_MAN in source.controls.buttons:
            return f"let go of {dead_man}{'' if at_rest else ', centre the sticks'}, then press again"
        if not at_rest:
            return f"centre the sticks, then hold {dead_man}"
        phase = self._phase_at(now)
        if phase is None:
            return "no word from the robot"
        return WHY_NOT.get(phase, f"hold {dead_man} to drive")


def _unseen(controls: Controls) -> Controls:
    """What came before the first reading: buttons that are down already were not pressed now, STOP excepted."""
    return Controls(buttons=controls.buttons - {"b"}, connected=False, stamp=controls.stamp)


def pace(lag_s: float) -> float:
    """Share of the speed that a driver gets who sees and acts this late: what he corrects, he corrects late."""
    late = min(1.0, max(0.0, (lag_s - SLOWER_S) / (SLOWEST_S - SLOWER_S)))
    return 1.0 - (1.0 - SLOWEST) * late
