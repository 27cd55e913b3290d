"""Claims about the console's recorder: whatever becomes of it or its disk, the operator is told and driving goes on."""

import resource
import signal
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from app.console import recording as console_recording
from app.console.inputs import Controls
from app.console.mapping import Selection
from app.console.pilot import Wanted
from app.console.recording import WAITING, RecorderProcess
from app.recording import storage
from app.recording.reader import Recording
from cobra.messages import Command, Intent
from tests.app.recording.test_recorder import Robot
from tests.stack import wait_for


class Console:
    """What a console does for its recorder."""

    def __init__(self, folder: Path, robot: Robot) -> None:
        self.warnings: list[str] = []
        self.recorder = RecorderProcess("cobra", folder / "a.mcap", (), self.warnings.append, tuple)
        self.recorder.start()
        self.recorder.connect(robot.endpoint)
        wait_for("the first report", lambda: self.written > 0)

    @property
    def written(self) -> int:
        report = self.recorder.report
        return report.state.written if report else 0

    @property
    def process(self) -> psutil.Process:
        (process,) = [
            child for child in psutil.Process().children() if "--feed" in child.cmdline() and child.status() != "zombie"
        ]
        return process

    def warned(self, words: str) -> bool:
        return any(words in warning for warning in self.warnings)


@pytest.fixture
def robot() -> Iterator[Robot]:
    with Robot() as robot:
        yield robot


@pytest.fixture
def console(robot: Robot, tmp_path: Path) -> Iterator[Console]:
    console = Console(tmp_path, robot)
    yield console
    console.recorder.stop()


def test_a_disk_that_refuses_is_counted_and_told_and_what_comes_later_is_recorded(
    console: Console, robot: Robot, tmp_path: Path
) -> None:
    limit = resource.prlimit(console.process.pid, resource.RLIMIT_FSIZE)
    resource.prlimit(console.process.pid, resource.RLIMIT_FSIZE, (50_000, limit[1]))
    wait_for("a complaint", lambda: console.warned("cannot be written: File too large; driving goes on"))
    tick = robot.tick
    assert "File too large" in console.recorder.problem
    wait_for("losses", lambda: console.recorder.report.state.dropped > 100)
    wait_for("the robot to go on", lambda: robot.tick > tick + 20)
    resource.prlimit(console.process.pid, resource.RLIMIT_FSIZE, limit)
    wait_for("the disk to take it again", lambda: console.warned("it is written again"))
    wait_for("no problem", lambda: not console.recorder.problem)
    after = robot.tick
    wait_for("more states", lambda: robot.tick > after + 50)
    console.recorder.stop()
    with Recording(tmp_path / "a.mcap") as recording:
        assert recording.closed
        assert recording.digest.dropped > 100
        last = recording.state_at(1e9)
        assert last is not None
        assert last.tick > after


def test_a_recorder_that_is_killed_is_told_and_another_recording_begins(console: Console, tmp_path: Path) -> None:
    console.process.kill()
    wait_for(
        "the news", lambda: console.warned("the recorder ended by itself; driving goes on, a new recording begins")
    )
    wait_for("the next file", lambda: console.recorder.path.name != "a.mcap" and console.written > 0)
    console.recorder.stop()
    assert len(storage.recordings(tmp_path)) == 2
    with Recording(console.recorder.path) as recording:
        assert recording.closed
        assert recording.digest.states > 0


def test_a_recorder_that_hangs_is_told_and_never_waited_for(console: Console, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(console_recording, "PATIENCE_S", 1.5)
    process = console.process
    process.send_signal(signal.SIGSTOP)
    try:
        wait_for("the news", lambda: "does not answer" in console.recorder.problem)
        # Far more than a pipe and the queue hold.
        wanted = Wanted(True, Intent(), 0.0, "pad", Controls(), Selection(section=0, level=0), "")
        command = Command(lease="", epoch=0, sequence=1, echo=0.0, held=True)
        for _ in range(10 * WAITING):
            console.recorder.sent(wanted, command)
        assert console.recorder.lost_inputs > WAITING
    finally:
        process.send_signal(signal.SIGCONT)
    wait_for("its answer", lambda: not console.recorder.problem)
