"""Finds the robot process of a robot, or starts one; notices when it is gone; ends it with the console."""

import contextlib
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil

from app import runtime
from app.link.access import DIRECT
from cobra.errors import OperatorError

START_TIMEOUT_S = 30.0
STOP_TIMEOUT_S = 3.0
LOOK_S = 0.02


class RobotStartError(OperatorError):
    """The robot process did not come up. The message is its own."""


class RobotKeeper:
    """Keeps one robot process.

    The process runs in a session of its own, so that neither Ctrl-C in the console's terminal nor the console's death
    takes it down: it holds the robot, and the next console adopts it.
    """

    access = DIRECT
    no_restart = ""

    def __init__(self, robot: str, name: str, options: tuple[str, ...] = ()) -> None:
        self._robot = robot
        self._name = name
        self._options = options
        self._process: subprocess.Popen[bytes] | None = None
        self.adopted = False

    @property
    def log_file(self) -> Path:
        return runtime.folder() / f"robot-{self._name}.log"

    def launch(self) -> None:
        """Adopt the running robot process, or start one without waiting for it."""
        self.adopted = runtime.find("robot", self._name) is not None
        if not self.adopted:
            with self.log_file.open("wb") as log:
                self._process = subprocess.Popen(
                    [
                        sys.executable,
                        "-m",
                        "app",
                        "robot",
                        "--robot",
                        self._robot,
                        "--leave-when-orphaned",
                        *self._options,
                    ],
                    stdin=subprocess.DEVNULL,
                    stdout=log,
                    stderr=subprocess.STDOUT,
                    start_new_session=True,
                )

    def wait(self) -> str:
        """Wait until the process has registered itself; returns where its link is.

        Raises:
            RobotStartError: it ended, or it takes too long.
        """
        deadline = time.monotonic() + START_TIMEOUT_S
        while time.monotonic() < deadline:
            if running := runtime.find("robot", self._name):
                return running.endpoint
            if self._process is None:
                raise RobotStartError("the robot process that ran here has just ended: start again")
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(LOOK_S)
                raise RobotStartError(self._last_words())
        raise RobotStartError(f"the robot process did not come up within {START_TIMEOUT_S:.0f} s; see {self.log_file}")

    def end(self) -> None:
        """Ask the robot process to quit, and insist when it does not."""
        running = runtime.find("robot", self._name)
        if running is not None:
            with contextlib.suppress(psutil.Error):
                process = psutil.Process(running.pid)
                process.send_signal(signal.SIGTERM)
                try:
                    process.wait(STOP_TIMEOUT_S)
                except psutil.TimeoutExpired:
                    process.kill()
                    process.wait(STOP_TIMEOUT_S)
        if self._process is not None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(STOP_TIMEOUT_S)
            self._process = None

    def _last_words(self) -> str:
        lines = self.log_file.read_text("utf-8", errors="replace").strip().splitlines()
        return (
            lines[-1].removeprefix("cobra-teleop: ")
            if lines
            else f"the robot process ended without a word; see {self.log_file}"
        )
