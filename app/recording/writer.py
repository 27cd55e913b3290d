"""A session being written: a bounded queue that anybody may put into, and one thread that decodes, encodes and writes.

Putting never waits. What does not fit, because the disk is slow or full, is counted and told; the session goes on.
"""

import contextlib
import logging
import math
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec

from app.link.listener import history
from app.recording import channels, storage
from app.recording.channels import (
    CALIBRATION,
    COMMAND,
    DIGEST,
    EVENT,
    INPUT,
    RECORDER,
    REQUEST,
    STATE,
    Facts,
    Input,
    Kind,
    RecorderState,
)
from app.recording.digest import Digester
from app.recording.foxglove import JOINTS, LOG, SCENE, FoxgloveView, log_of
from app.recording.foxglove import TYPES as FOXGLOVE
from app.recording.mcap_file import McapFile, Topic
from cobra.messages import Calibration, Event, Heard, RobotState, decode

log = logging.getLogger(__name__)

CAPACITY: Final = 5000
"""Messages that may wait for the disk: 20 s of a loop of 250 Hz."""
POLL_S: Final = 0.05
CHUNK_S: Final = 0.4
"""A chunk is closed when its first message is this old: with `POLL_S` and the disk, well within a second."""
CHUNK_BYTES: Final = 1_000_000
VIEW_PERIOD_NS: Final = 50_000_000
"""Of the scene and the joints for Foxglove: 20 Hz; nothing is written of a robot that stands still, but once a second."""
STILL_PERIOD_NS: Final = 1_000_000_000
SELF_PERIOD_S: Final = 1.0
STUCK_S: Final = 2.0
"""A disk that took nothing for this long is told of."""
SECOND_NS: Final = 1_000_000_000


class _Item(NamedTuple):
    kind: Kind
    arrival_ns: int
    payload: bytes | Input


class SessionWriter:
    """Writes one recording. `put` from any thread; everything else happens in a thread of its own.

    Args:
        path: the file, which must not exist yet.
        facts: what stands at its start.
        now_ns: the wall clock.
        make_file: opens the file; tests give a slow or a full disk.
    """

    def __init__(
        self,
        path: Path,
        facts: Facts,
        *,
        capacity: int = CAPACITY,
        now_ns: Callable[[], int] = time.time_ns,
        make_file: Callable[..., McapFile] = McapFile,
    ) -> None:
        self.path = path
        self._facts = facts
        self._capacity = capacity
        self._now_ns = now_ns
        self._file = make_file(path, topics())
        self._queue: deque[_Item] = deque()
        self._overflow = 0
        self._lost = 0
        self._unreadable = 0
        self._disk = ""
        self.refused = ""
        """Why nothing is to be written now, in words; set by whoever watches the disk. What comes is dropped then."""
        self._progress_s = math.inf
        self._stopped = threading.Event()
        self._thread: threading.Thread | None = None
        self._offset_ns = 0
        self._clock_ahead = False
        self._calibration = b""
        self._tick = -1
        self._missed = 0
        self._chunk_since_s: float | None = None
        self._next_self_s = 0.0
        self._next_view_ns = self._still_until_ns = 0
        self._seen_q: tuple[object, ...] = ()
        self._digester: Digester | None = None
        self._view: FoxgloveView | None = None

    # ------------------------------------------------------------------ for everybody

    def start(self) -> None:
        """Create the file and begin.

        Raises:
            OSError: it cannot be created.
        """
        now_ns = self._now_ns()
        description, robot = self._facts.description, self._facts.robot
        title = description.title if description else robot
        facts = {"format": str(channels.FORMAT), "robot": robot, "title": title, "started_ns": str(now_ns)}
        try:
            self._file.start(facts)
            storage.lock(self._file.descriptor)
            for name, content in self._facts.attachments.items():
                kind = "application/toml" if name.endswith(".toml") else "application/json"
                self._file.attach(name, kind, content, now_ns)
        except OSError:
            self._file.close()
            raise
        self._thread = threading.Thread(target=self._run, name="recorder", daemon=True)
        self._thread.start()

    def put(self, kind: Kind, arrival_ns: int, payload: bytes | Input) -> None:
        """Something arrived. Never waits, never raises; safe from any thread."""
        if len(self._queue) >= self._capacity:
            self._overflow += 1
            return
        self._queue.append(_Item(kind, arrival_ns, payload))

    def stop(self, timeout_s: float = 10.0) -> None:
        """Write what still waits and close the file in order. A disk that hangs is given up on: recover the file then."""
        self._stopped.set()
        if self._thread is not None:
            self._thread.join(timeout_s)
            self._thread = None

    @property
    def status(self) -> RecorderState:
        """How it goes, from any thread and also while the disk hangs."""
        return RecorderState(
            written=self._file.messages,
            size_bytes=self._file.size,
            dropped=self._overflow + self._lost,
            missed=self._missed,
            unreadable=self._unreadable,
            problem=self._problem(),
        )

    def _problem(self) -> str:
        if self._disk:
            return self._disk
        stuck_s = time.monotonic() - self._progress_s
        return f"the disk has taken nothing for {stuck_s:.0f} s" if stuck_s > STUCK_S else ""

    # ------------------------------------------------------------------ the thread

    def _run(self) -> None:
        self._begin()
        # Only from here on is it the disk that is waited for: kinematics take seconds to load on a busy machine.
        self._progress_s = time.monotonic()
        last = False
        while not last:
            # What is put before the flag is seen is still written.
            last = self._stopped.wait(POLL_S)
            self._drain()
            self._say_how_it_goes()
            self._flush_when_due(last)
            self._progress_s = time.monotonic()
        self._finish()

    def _begin(self) -> None:
        description = self._facts.description
        self._digester = Digester(self._facts.robot, description)
        self._view = FoxgloveView(description) if description else None

    def _drain(self) -> None:
        while self._queue:
            item = self._queue.popleft()
            try:
                self._take(item)
            except (msgspec.MsgspecError, ValueError, TypeError) as error:
                if not self._unreadable:
                    log.warning("a message could not be recorded: %s", error)
                self._unreadable += 1
            if self._file.pending_bytes >= CHUNK_BYTES:
                self._flush()

    def _take(self, item: _Item) -> None:
        arrival, payload = item.arrival_ns, item.payload
        if isinstance(payload, Input):
            self._add(INPUT, arrival, arrival, payload)
            return
        match item.kind:
            case "history":
                # The last of them was published at once: to it belongs the arrival, for the others the clock moves back.
                states = [decode(data, RobotState) for data in history(payload)]
                for state in states:
                    self._take_state(state, arrival - round((states[-1].stamp - state.stamp) * SECOND_NS))
            case "state":
                self._take_state(decode(payload, RobotState), arrival)
            case "event":
                event = decode(payload, Event)
                time_ns = self._time(event.stamp, arrival)
                self._add(EVENT, time_ns, arrival, event)
                self._add(LOG, time_ns, arrival, log_of(event, self._facts.robot, time_ns))
                self._digest.event(event, time_ns)
            case "heard":
                heard = decode(payload, Heard)
                for judged in heard.commands:
                    self._add(COMMAND, self._time(judged.stamp, arrival), arrival, judged, judged.command.sequence)
                    self._digest.judged(judged)
                for answered in heard.answers:
                    self._add(REQUEST, self._time(answered.stamp, arrival), arrival, answered)
            case "calibration":
                self._attach_calibration(decode(payload, Calibration), arrival)

    def _take_state(self, state: RobotState, arrival: int) -> None:
        if state.tick < self._tick:
            self._clock_ahead = False  # another robot process: its clock is another
        elif self._tick >= 0:
            self._missed += state.tick - self._tick - 1
        self._tick = state.tick
        time_ns = self._time(state.stamp, arrival)
        self._add(STATE, time_ns, arrival, state, state.tick)
        self._digest.state(state, time_ns)
        if self._view is None or time_ns < self._next_view_ns:
            return
        self._next_view_ns = time_ns + VIEW_PERIOD_NS
        shown = (state.measured, state.commanded)
        if shown == self._seen_q and time_ns < self._still_until_ns:
            return
        self._seen_q, self._still_until_ns = shown, time_ns + STILL_PERIOD_NS
        if scene := self._view.scene(state, time_ns):
            self._add(SCENE, time_ns, arrival, scene)
        self._add(JOINTS, time_ns, arrival, self._view.joints(state, time_ns))

    def _attach_calibration(self, calibration: Calibration, arrival: int) -> None:
        """Each that was in force is an attachment of its own; of equal names the last one counts."""
        data = msgspec.json.format(channels.encode(calibration))
        if data == self._calibration:
            return
        self._calibration = data
        self._flush()
        # An old one, told first, says nothing of how the clocks are apart.
        since = self._time(calibration.stamp, arrival) if self._clock_ahead else arrival
        try:
            self._file.attach(CALIBRATION, "application/json", data, since)
        except OSError as error:
            self._lost += 1
            self._disk = f"the recording cannot be written: {error.strerror}"

    def _add(self, topic: str, time_ns: int, arrival: int, message: msgspec.Struct, sequence: int = 0) -> None:
        if self._chunk_since_s is None:
            self._chunk_since_s = time.monotonic()
        self._file.add(topic, max(time_ns, 0), arrival, channels.encode(message), sequence)

    def _time(self, stamp_s: float, arrival: int) -> int:
        """The robot's clock as wall clock: moved as a whole by what lay between them at the first message."""
        stamp_ns = round(stamp_s * SECOND_NS)
        if not self._clock_ahead:
            self._clock_ahead, self._offset_ns = True, arrival - stamp_ns
        return stamp_ns + self._offset_ns

    def _say_how_it_goes(self) -> None:
        if time.monotonic() >= self._next_self_s:
            self._next_self_s = time.monotonic() + SELF_PERIOD_S
            now = self._now_ns()
            self._add(RECORDER, now, now, self.status)

    def _flush_when_due(self, last: bool) -> None:
        since = self._chunk_since_s
        if since is not None and (last or time.monotonic() - since >= CHUNK_S - POLL_S):
            self._flush()

    def _flush(self) -> None:
        waiting = self._file.pending_messages
        self._chunk_since_s = None
        try:
            self._file.flush() if not self.refused else self._file.forget()
        except OSError as error:
            self._lost += waiting
            if not self._disk:
                log.error("%s: %s; driving goes on", self.path, error.strerror)
            self._disk = f"the recording cannot be written: {error.strerror}"
        else:
            self._lost += waiting if self.refused else 0
            self._disk = self.refused

    def _finish(self) -> None:
        self._digest.dropped = self._overflow + self._lost
        digest: Any = channels.encode(self._digest.result())
        with contextlib.suppress(OSError):  # it can be recovered
            self._file.attach(DIGEST, "application/json", digest, self._now_ns())
            self._file.finish()
        self._file.close()

    @property
    def _digest(self) -> Digester:
        assert self._digester is not None
        return self._digester


def topics() -> list[Topic]:
    """Every channel of a recording: ours, then Foxglove's."""
    ours = [Topic(name, f"cobra.{kind.__name__}", channels.schema(kind)) for name, kind in channels.TYPES.items()]
    theirs = [Topic(name, schema, channels.schema(kind)) for name, (schema, kind) in FOXGLOVE.items()]
    return ours + theirs
