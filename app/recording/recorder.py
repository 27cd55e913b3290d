"""The recorder: a process of its own that hears the robot on the link, and the console by its standard input.

Neither the control loop nor the driver's stream can be held up by a disk this way, and when the console dies the robot
goes on being recorded until it has come to rest.
"""

import json
import logging
import os
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import msgspec

from app import runtime
from app.link.access import DIRECT, LinkAccess, LinkError
from app.link.listener import Listener
from app.recording import channels, storage
from app.recording.channels import Facts, Input, Kind, RecorderState
from cobra.description import RobotDescription
from cobra.errors import OperatorError
from cobra.loading import DescriptionError, parse_description
from cobra.messages import Event, Meta, encode

if TYPE_CHECKING:
    from app.recording.writer import SessionWriter

log = logging.getLogger("cobra.recorder")

BUDGET_BYTES: Final = 20_000_000_000
HOUSEKEEPING_S: Final = 30.0
REPORT_S: Final = 1.0
LONELY_S: Final = 150.0
"""Without its console it records on for so long: past the robot's final action, which is taken after 60 s."""
GIVEN_UP_S: Final = 15.0
"""A robot process that is gone is waited for this long."""
RETRY_S: Final = 2.0
EARLY: Final = 5000
"""Messages kept while the file is not open yet."""
NICENESS: Final = 5
"""The robot and its driver go first."""


class RecorderError(OperatorError):
    """Nothing can be recorded. The message says why and what to do."""


class Report(msgspec.Struct, frozen=True, kw_only=True):
    """What the recorder tells the console, one line of JSON a second."""

    path: str
    state: RecorderState
    room: str = ""
    """Why old sessions could not make enough room; empty when they could."""
    deleted: tuple[str, ...] = ()
    """Sessions that were deleted to make room since the last report."""


class FeedLine(msgspec.Struct, frozen=True, kw_only=True):
    """What the console tells the recorder, one line of JSON each: any of these."""

    input: Input | None = None
    events: tuple[Event, ...] = ()
    """What the robot announced so far; the recorder takes what came before it listened."""
    connect: str = ""
    """The robot process was started anew; its link is here now."""
    end: bool = False


class Recorder:
    """Records one robot into one file until `end()`.

    Args:
        robot: the robot's name on the link.
        endpoint: where its link listens; empty when `connect` will say so before the start.
        path: the recording, or a folder in which it gets a name by time and robot.
        budget_bytes: of the folder.
        settings: kept as an attachment: what the program was started with.
        access: account and certificate, where a router asks for them.
        wait: for a robot that is gone, however long; else it is given up, or looked for on this machine.
    """

    def __init__(
        self,
        robot: str,
        endpoint: str,
        path: Path,
        budget_bytes: int = BUDGET_BYTES,
        settings: dict[str, Any] | None = None,
        access: LinkAccess = DIRECT,
        wait: bool = False,
    ) -> None:
        self._access = access
        self._wait = wait
        self._robot = robot
        self._endpoint = endpoint
        self._path = path
        self._budget_bytes = budget_bytes
        self._settings = settings or {}
        self._listener: Listener | None = None
        self._writer: SessionWriter | None = None
        self._early: deque[tuple[Kind, int, bytes]] = deque(maxlen=EARLY)
        self._ended = threading.Event()
        self._gone_s: float | None = None
        self._events: deque[bytes] = deque(maxlen=200)
        self._room = ""
        self._deleted: list[str] = []
        self._next_housekeeping_s = 0.0

    @property
    def ended(self) -> bool:
        """Whether it was told to end."""
        return self._ended.is_set()

    @property
    def path(self) -> Path:
        """The file; known once it runs."""
        return self._path

    def start(self) -> None:
        """Connect, make room, open the file.

        Raises:
            RecorderError: the folder or the file cannot be written.
            LinkError: the robot does not answer.
        """
        folder = self._path.parent if self._path.suffix == storage.SUFFIX else self._path
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        except OSError as error:
            raise RecorderError(f"{folder}: no recordings can be kept there: {error.strerror}") from None
        meta = self._first_connect()
        if self._path is folder:
            self._path = storage.new_path(folder, self._robot, time.time())
        self._keep_house()
        # The writer draws in the kinematics, which take a while to load; the link is heard meanwhile.
        from app.recording.writer import SessionWriter  # noqa: PLC0415

        writer = SessionWriter(self._path, facts_of(self._robot, meta, self._settings))
        try:
            writer.start()
        except OSError as error:
            self._disconnect()
            raise RecorderError(f"{self._path}: the recording cannot be written: {error.strerror}") from None
        while self._early:
            writer.put(*self._early.popleft())
        self._writer = writer

    def run(self, report: Callable[[Report], None], lonely: Callable[[], bool] = lambda: False) -> None:
        """Until `end()`, or until the robot is gone for good. `lonely` says whether the console has gone."""
        alone_since: float | None = None
        while not self._ended.wait(REPORT_S):
            now = time.monotonic()
            if now >= self._next_housekeeping_s:
                self._keep_house()
            report(self.report())
            alone_since = (alone_since or now) if lonely() else None
            gone_since = self._gone_s
            if alone_since is not None and (gone_since is not None or now - alone_since > LONELY_S):
                break
            if gone_since is not None and not self._wait:
                if now - gone_since > GIVEN_UP_S:
                    break
                self._look_for_robot()
        self.stop()
        report(self.report())

    def end(self) -> None:
        """Safe from any thread, and from a signal."""
        self._ended.set()

    def stop(self) -> None:
        """Close the file in order."""
        self._disconnect()
        if self._writer is not None:
            self._writer.stop()

    def input(self, reading: Input) -> None:
        """A reading of whatever drives, from the console."""
        if self._writer is not None:
            self._writer.put("input", time.time_ns(), reading)

    def backlog(self, events: Iterable[Event]) -> None:
        """Events that the console knows; those that were heard here are passed over."""
        for data in map(encode, events):
            if data not in self._events:
                self._put("event", data)

    def connect(self, endpoint: str) -> None:
        """The robot process is there, or was started anew: its link is here."""
        self._endpoint = endpoint
        if self._writer is None:
            return  # `start` connects
        self._disconnect()
        try:
            self._connect()
        except LinkError as error:
            log.warning("%s", error)

    def report(self) -> Report:
        """How it goes."""
        state = self._writer.status if self._writer is not None else RecorderState()
        deleted, self._deleted = tuple(self._deleted), []
        return Report(path=str(self._path), state=state, room=self._room, deleted=deleted)

    def _first_connect(self) -> Meta:
        while True:
            try:
                return self._connect()
            except LinkError:
                if not self._wait or self._ended.wait(RETRY_S):
                    raise

    def _connect(self) -> Meta:
        def alive(yes: bool) -> None:
            self._gone_s = None if yes else time.monotonic()

        hear = {
            "history": lambda data: self._put("history", data),
            "event": lambda data: self._put("event", data),
            "heard": lambda data: self._put("heard", data),
            "calibration": lambda data: self._put("calibration", data),
        }
        listener = Listener(self._robot, self._endpoint, hear, alive, self._access)
        meta = listener.start()
        self._listener, self._gone_s = listener, None
        if calibration := listener.calibration():
            self._put("calibration", calibration)
        return meta

    def _disconnect(self) -> None:
        listener, self._listener = self._listener, None
        if listener is not None:
            listener.stop()

    def _look_for_robot(self) -> None:
        """A robot process that was started anew by hand, on this machine."""
        running = runtime.find("robot", self._robot)
        if running is not None and running.endpoint != self._endpoint:
            self.connect(running.endpoint)

    def _put(self, kind: Kind, data: bytes) -> None:
        if kind == "event":
            self._events.append(data)
        if self._writer is not None:
            self._writer.put(kind, time.time_ns(), data)
        else:
            self._early.append((kind, time.time_ns(), data))

    def _keep_house(self) -> None:
        self._next_housekeeping_s = time.monotonic() + HOUSEKEEPING_S
        folder = self._path.parent if self._path.suffix == storage.SUFFIX else self._path
        self._deleted += [path.name for path in storage.make_room(folder, self._budget_bytes)]
        self._room = storage.shortage(folder, self._budget_bytes)
        if self._writer is not None:
            full = storage.free_bytes(folder) < storage.LAST_BYTES
            self._writer.refused = f"nothing is recorded: {self._room}" if full else ""


def facts_of(robot: str, meta: Meta, settings: dict[str, Any]) -> Facts:
    """What stands at the start of a recording, from what the robot says of itself."""
    description: RobotDescription | None = None
    try:
        description = parse_description(meta.description, robot)
    except DescriptionError as error:
        log.warning("the robot's description is of another version; shapes are not recorded for Foxglove: %s", error)
    attachments = {
        channels.DESCRIPTION: meta.description.encode(),
        channels.VERSIONS: _json(meta.versions),
        channels.SETTINGS: _json({"pid": meta.pid, **settings}),
    }
    return Facts(robot, description, attachments)


def run_recorder(recorder: Recorder, feed: bool) -> int:
    """The process: until Ctrl-C, SIGTERM, the feed's end or the robot's. With `feed`, the console is at our standard ends."""
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: recorder.end())
    _step_back()
    if not feed:
        recorder.start()
        print(f"recording {recorder.path} (Ctrl-C ends it)", flush=True)
        recorder.run(_Told().print)
        print(f"recorded {recorder.path}", flush=True)
        return 0
    console = _Console(recorder)
    threading.Thread(target=console.listen, name="feed", daemon=True).start()
    import app.recording.writer  # noqa: F401, PLC0415 - while the robot process starts

    console.told_where.wait()
    if not recorder.ended:
        recorder.start()
        recorder.run(console.tell, console.gone.is_set)
    return 0


class _Told:
    """Prints a problem once when it comes and once when it goes."""

    def __init__(self) -> None:
        self._last = ""

    def print(self, report: Report) -> None:
        problem = report.state.problem or report.room
        if problem != self._last:
            print(problem or "the disk takes the recording again", file=sys.stderr, flush=True)
        self._last = problem
        for name in report.deleted:
            print(f"deleted {name} to make room", file=sys.stderr, flush=True)


class _Console:
    """The console at the other ends of our standard input and output."""

    def __init__(self, recorder: Recorder) -> None:
        self._recorder = recorder
        self.gone = threading.Event()
        self.told_where = threading.Event()
        """The robot's link is known, or never will be."""

    def listen(self) -> None:
        decoder = msgspec.json.Decoder(FeedLine)
        rest = b""
        # Not through sys.stdin: its lock, held by a daemon thread, would end the interpreter with a fault.
        while data := os.read(0, 65536):
            *lines, rest = (rest + data).split(b"\n")
            for line in lines:
                self._obey(line, decoder)
        self.gone.set()
        if not self.told_where.is_set():
            self._recorder.end()
            self.told_where.set()

    def _obey(self, line: bytes, decoder: "msgspec.json.Decoder[FeedLine]") -> None:
        try:
            told = decoder.decode(line)
        except msgspec.MsgspecError as error:
            log.warning("the console said something that is not understood: %s", error)
            return
        if told.input is not None:
            self._recorder.input(told.input)
        self._recorder.backlog(told.events)
        if told.connect:
            self._recorder.connect(told.connect)
            self.told_where.set()
        if told.end:
            self._recorder.end()
            self.told_where.set()

    def tell(self, report: Report) -> None:
        if self.gone.is_set():
            return
        try:
            sys.stdout.buffer.write(msgspec.json.encode(report) + b"\n")
            sys.stdout.buffer.flush()
        except OSError:
            self.gone.set()


def _step_back() -> None:
    """Behind the robot and its driver, whatever precedence our parent has."""
    if hasattr(os, "setpriority"):
        try:
            os.setpriority(os.PRIO_PROCESS, 0, NICENESS)
        except OSError as error:
            log.debug("precedence unchanged: %s", error)


def _json(value: Any) -> bytes:
    return json.dumps(value, indent=1, default=str).encode()
