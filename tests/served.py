"""Real processes without a page: simulated drives behind SLCAN, a robot process on python-can's slcan driver, and a driver."""

import contextlib
import os
import re
import shlex
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import msgspec

from app.runtime import Running
from cobra.loading import description_text
from cobra.messages import Command, Intent, Reply, Request, RobotState
from tests.stack import Observer, wait_for

DRIVEN_WITH = "drive it with: cobra-teleop "
BUS = re.compile(r"^bus (\S+): slcan (\S+)$", re.MULTILINE)


class Drives:
    """`cobra-teleop motors serve`."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self._output = folder / "drives.txt"
        self._command = [sys.executable, "-m", "app", "motors", "serve", *arguments]
        self.start()

    def start(self, *more: str) -> None:
        before = len(self._text())
        with self._output.open("ab") as output:
            self.process = subprocess.Popen(
                [*self._command, *more], stdin=subprocess.PIPE, stdout=output, stderr=subprocess.STDOUT
            )
        wait_for("the drives", lambda: "Ctrl-C ends" in self._text()[before:], 60.0)
        self.channels = dict(BUS.findall(self._text()[before:]))
        line = next(line for line in self._text()[before:].splitlines() if line.startswith(DRIVEN_WITH))
        self.driven_with = shlex.split(line.removeprefix(DRIVEN_WITH))

    def make(self, fault: str) -> None:
        """Ask for a fault, and wait until it is there."""
        before = len(self._text())
        assert self.process.stdin is not None
        self.process.stdin.write(fault.encode() + b"\n")
        self.process.stdin.flush()
        wait_for(f"the answer to {fault!r}", lambda: "\n" in self._text()[before:])

    def end(self) -> None:
        self.process.kill()
        self.process.wait()
        if self.process.stdin is not None:
            self.process.stdin.close()

    def _text(self) -> str:
        return self._output.read_text() if self._output.exists() else ""


class Rig:
    """Drives, robot process and a driver's stream of commands at 50 Hz."""

    def __init__(self, folder: Path, *serve: str, rate_Hz: float = 50.0) -> None:
        """`rate_Hz`: two processes that simulate and drive leave a busy machine little room at 100 Hz."""
        text = description_text("cobra").replace("loop_rate_Hz = 100.0", f"loop_rate_Hz = {rate_Hz}")
        robot = str(folder / "cobra.toml")
        Path(robot).write_text(text, "utf-8")
        self.drives = Drives(folder, "--robot", robot, *serve)
        self.output = folder / "robot.txt"
        environment = {**os.environ, "COBRA_TELEOP_RUNTIME_DIR": str(folder), "COBRA_TELEOP_DATA_DIR": str(folder)}
        with self.output.open("wb") as output:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "app", "robot", *self.drives.driven_with],
                env=environment, stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT,
            )  # fmt: skip
        entry = folder / "robot-cobra.json"
        wait_for("the robot process", lambda: entry.exists() or self.process.poll() is not None, 60.0)
        assert self.process.poll() is None, self.output.read_text()
        self.observer = Observer("cobra", msgspec.json.decode(entry.read_bytes(), type=Running).endpoint)
        reply = self.ask("acquire")
        self._lease = reply.lease
        self._held = False
        self._intent = Intent()
        self._sequence = 0
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._stream, daemon=True)
        self._thread.start()

    @property
    def state(self) -> RobotState:
        return self.observer.state

    def ask(self, what: str, value: float = 0.0) -> Reply:
        lease = getattr(self, "_lease", "")
        return self.observer.link.request(Request(what=what, lease=lease, who="test", value=value))

    def drive(self) -> None:
        """Hold the dead-man and push the stick to and fro until the robot drives."""
        self._intent = Intent(primary=(0.5, 0.0), twist=0.3)

        def driving() -> bool:
            # A release counts once the robot has heard it: a press that overtakes it is void, for ever.
            self._held = False
            released = self._sequence + 1
            self.observer.wait("a release", lambda state: state.phase == "ready" and state.accepted > released, 10.0)
            self._held = True
            with contextlib.suppress(AssertionError):
                self.observer.wait("driving", lambda state: state.phase == "driving", 1.0)
            return self.state.phase == "driving"

        wait_for("the drive", driving)

    def let_go(self) -> None:
        self._held = False

    def ready(self) -> None:
        """Mend what can be mended, arm and home until the robot is ready."""
        self.let_go()
        self.drives.make("heal")

        def armed() -> bool:
            if self.state.phase in ("disarmed", "fault"):
                reply = self.ask("arm")
                self.refused = reply.reasons
                if not reply.ok:
                    return False
            if (self.state.phase == "holding" and not self.state.homed) or self.state.tendons.warnings:
                self.ask("home")
                self.observer.wait("homing", lambda state: state.phase != "ready")
            with contextlib.suppress(AssertionError):
                self.observer.wait("ready", lambda state: state.phase in ("ready", "fault"), 30.0)
            return self.state.phase == "ready"

        wait_for("a robot that is ready", armed, 90.0)

    def close(self) -> None:
        self._done.set()
        self._thread.join()
        self.observer.close()
        self.process.terminate()
        try:
            self.process.wait(10)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.drives.end()

    def _stream(self) -> None:
        while not self._done.wait(0.02):
            self._sequence += 1
            state = self.state
            intent = self._intent if self._held else Intent()
            # To and fro, so that no limit is reached however long a test takes.
            if int(state.stamp / 1.5) % 2:
                intent = msgspec.structs.replace(intent, primary=(-intent.primary[0], 0.0), twist=-intent.twist)
            self.observer.link.send(
                Command(lease=self._lease, epoch=state.epoch, sequence=self._sequence, echo=state.stamp, held=self._held,
                        intent=intent)
            )  # fmt: skip


@contextlib.contextmanager
def served(folder: Path, *serve: str, rate_Hz: float = 50.0) -> Iterator[Rig]:
    rig = Rig(folder, *serve, rate_Hz=rate_Hz)
    try:
        yield rig
    finally:
        rig.close()
