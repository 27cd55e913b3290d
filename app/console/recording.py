"""The console's recorder: a process beside it that is fed without waiting, watched, and started again when it ends."""

import contextlib
import logging
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

import msgspec

from app.console.pilot import Wanted
from app.recording import storage
from app.recording.channels import Input
from app.recording.recorder import FeedLine, Report
from cobra.messages import Command, Event

log = logging.getLogger("cobra.recording")

WAITING: Final = 1000
"""Readings that may wait for the recorder; 10 s of the driver's stream."""
STOP_S: Final = 12.0
"""So long the recorder may take to close its file."""
PATIENCE_S: Final = 6.0
"""A recorder that says nothing for this long hangs."""
BEGIN_S: Final = 30.0
"""One that has not said anything by then does not begin."""
TRIES: Final = 3


class RecorderProcess:
    """Keeps one recorder for one robot.

    Args:
        robot: its name on the link.
        path: where the session is recorded.
        options: more for its command line.
        warn: tells the operator, in words.
        events: what the robot announced so far; the recorder takes what came before it listened.
    """

    def __init__(
        self,
        robot: str,
        path: Path,
        options: Sequence[str],
        warn: Callable[[str], None],
        events: Callable[[], Sequence[Event]],
    ) -> None:
        self._robot = robot
        self._path = path
        self._options = tuple(options)
        self._warn = warn
        self._events = events
        self._endpoint = ""
        self._waiting: queue.Queue[FeedLine] = queue.Queue()
        self._process: subprocess.Popen[bytes] | None = None
        self._stopping = False
        self._tries = 0
        self._idle = False
        self._heard_s = 0.0
        self._told = ""
        self.report: Report | None = None
        """The newest; None before the first."""
        self.lost_inputs = 0
        """Readings that the recorder was too slow for."""

    @property
    def path(self) -> Path:
        return self._path

    @property
    def problem(self) -> str:
        """What is wrong with the recording, in words; empty when nothing is."""
        if self._process is None:
            return "nothing is recorded: the recorder ended" if self._tries else ""
        silent_s = time.monotonic() - self._heard_s
        if self.report is None:
            return "nothing is recorded yet: the recorder does not begin" if silent_s > BEGIN_S else ""
        if silent_s > PATIENCE_S:
            return "the recorder does not answer: nobody knows whether this is recorded"
        return self.report.state.problem or self.report.room

    def start(self) -> None:
        """Start the process; it waits for `connect`."""
        self._launch()

    def connect(self, endpoint: str) -> None:
        """A robot process is there: record it, or go on with it in the same file."""
        self._endpoint = endpoint
        self._feed(FeedLine(connect=endpoint))

    def sent(self, wanted: Wanted, command: Command) -> None:
        """What the driver's stream carries, with the sticks behind it. Never waits."""
        idle = not wanted.source
        if idle and self._idle:
            return
        self._idle = idle
        controls = wanted.controls
        reading = Input(
            stamp=time.monotonic(),
            source=wanted.source,
            left=controls.left,
            right=controls.right,
            left_trigger=controls.left_trigger,
            right_trigger=controls.right_trigger,
            buttons=tuple(sorted(controls.buttons)),
            section=wanted.selection.section,
            level=wanted.selection.level,
            mode=command.mode,
            frame=wanted.selection.frame,
        )
        self._feed(FeedLine(input=reading))

    def stop(self) -> None:
        """Let it write what waits and close its file."""
        self._stopping = True
        process = self._process
        if process is None:
            return
        self._feed(FeedLine(end=True))
        try:
            process.wait(STOP_S)
        except subprocess.TimeoutExpired:
            log.error("the recorder does not end; %s may need to be recovered", self._path)
            process.kill()
            process.wait()

    def _launch(self) -> None:
        self._tries += 1
        program = (sys.executable, "-m", "app", "record", "--feed", "--robot-name", self._robot)
        where = ("--file", str(self._path))
        self._process = process = subprocess.Popen(
            [*program, *where, *self._options],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
        )
        self._heard_s = time.monotonic()
        # A queue of its own: what is meant for this one must not go to the one that ended.
        waiting: queue.Queue[FeedLine] = queue.Queue(WAITING)
        self._waiting = waiting
        for body, arguments in ((self._write, (process, waiting)), (self._listen, (process,))):
            threading.Thread(target=body, args=arguments, name="recording", daemon=True).start()

    def _feed(self, line: FeedLine) -> None:
        try:
            self._waiting.put_nowait(line)
        except queue.Full:
            self.lost_inputs += 1

    def _write(self, process: subprocess.Popen[bytes], waiting: "queue.Queue[FeedLine]") -> None:
        assert process.stdin is not None
        with contextlib.suppress(OSError):
            while process is self._process:
                with contextlib.suppress(queue.Empty):
                    line = waiting.get(timeout=1.0)
                    process.stdin.write(msgspec.json.encode(line) + b"\n")
                    process.stdin.flush()

    def _listen(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stdout is not None
        for line in process.stdout:
            with contextlib.suppress(msgspec.MsgspecError):
                report, first = msgspec.json.decode(line, type=Report), self.report is None
                self.report, self._heard_s = report, time.monotonic()
                if first:
                    self._feed(FeedLine(events=tuple(self._events())))
                self._tell(report)
        process.wait()
        self._process = None
        if not self._stopping:
            self._again()

    def _again(self) -> None:
        """It ended by itself: say so, and record on into another file."""
        self._warn("the recorder ended by itself; driving goes on" + (", a new recording begins" if self._more else ""))
        if self._more:
            folder = self._path.parent
            self._path = storage.new_path(folder, self._robot, time.time())
            self.report = None
            self._launch()
            self._feed(FeedLine(connect=self._endpoint))

    @property
    def _more(self) -> bool:
        return self._tries < TRIES

    def _tell(self, report: Report) -> None:
        for name in report.deleted:
            self._warn(f"recording: {name} was deleted to make room")
        problem = report.state.problem or report.room
        if problem != self._told:
            self._warn(f"recording: {problem}; driving goes on" if problem else "recording: it is written again")
        self._told = problem
