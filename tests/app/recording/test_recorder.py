"""Claims about the recorder on a real link: what the robot publishes is recorded, and a SIGKILL takes less than a second."""

import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from app import runtime
from app.link.robot_end import RobotLink
from app.recording.reader import Recording
from app.recording.recorder import FeedLine, Recorder, Report
from app.recording.recover import default_target, recover
from cobra.loading import description_text
from cobra.messages import Event, Heard, Meta
from tests.recordings import judged, moving
from tests.stack import wait_for

RATE_Hz = 100.0


class Robot:
    """Publishes on a real link what a robot process would, at its rate."""

    def __init__(self) -> None:
        self.endpoint = f"tcp/127.0.0.1:{runtime.any_free_port()}"
        self.link = RobotLink("cobra", self.endpoint, Meta(description=description_text("cobra"), versions={}, pid=1))
        self.tick = 0
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> "Robot":
        self.link.start(lambda data: None, lambda data: None, lambda data, answer: None)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._done.set()
        self._thread.join()
        self.link.stop()

    def _run(self) -> None:
        while not self._done.wait(1.0 / RATE_Hz):
            t = self.tick / RATE_Hz
            now = time.monotonic()
            self.link.publish_state(moving(t, RATE_Hz, stamp=now))
            self.link.publish_heard(Heard(commands=(msgspec.structs.replace(judged(self.tick, t), stamp=now),)))
            self.tick += 1


@pytest.fixture
def robot() -> Iterator[Robot]:
    with Robot() as robot:
        yield robot


def test_what_the_robot_publishes_is_recorded_and_it_has_no_console_by_that(robot, tmp_path):
    recorder = Recorder("cobra", robot.endpoint, tmp_path)
    recorder.start()
    first = robot.tick
    wait_for("a second of states", lambda: robot.tick > first + 100)
    event = Event(stamp=time.monotonic(), level="alarm", text="fault: drive E1")
    robot.link.publish_event(event)
    wait_for("the event", lambda: recorder._events)
    recorder.backlog([event])  # known already
    assert robot.link.consoles == 0
    recorder.stop()
    with Recording(recorder.path) as recording:
        ticks = [state.tick for _, state in recording.states()]
        assert ticks == list(range(ticks[0], ticks[-1] + 1))
        assert len(ticks) >= 85
        assert len(list(recording.commands())) == pytest.approx(len(ticks), abs=20)
        assert [event.text for _, event in recording.events()] == ["fault: drive E1"]
        assert recording.description is not None


def start_process(robot: Robot, path: Path) -> "subprocess.Popen[bytes]":
    command = [sys.executable, "-m", "app", "record", "--robot-name", "cobra", "--file", str(path), "--feed"]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert process.stdin is not None
    process.stdin.write(msgspec.json.encode(FeedLine(connect=robot.endpoint)) + b"\n")
    process.stdin.flush()
    return process


def kill_and_recover(robot: Robot, path: Path, after_s: float) -> float:
    """Record, kill -9 that long after the first chunk, recover; gives the seconds between the last state and the kill."""
    process = start_process(robot, path)
    wait_for("the first chunk", lambda: path.exists() and path.stat().st_size > 30_000)
    time.sleep(after_s)  # the moment is what is tested
    process.kill()
    killed_ns = time.time_ns()
    process.wait()
    recovery = recover(path, default_target(path))
    with Recording(recovery.path) as recording:
        assert recording.closed
        ticks = [state.tick for _, state in recording.states()]
        assert ticks == list(range(ticks[0], ticks[-1] + 1))
    return (killed_ns - recovery.end_ns) * 1e-9


def test_after_a_sigkill_all_but_the_last_second_is_there(robot, tmp_path):
    lost = [kill_and_recover(robot, tmp_path / f"{i}.mcap", random.random()) for i in range(2)]
    assert max(lost) < 1.0, lost


@pytest.mark.long
def test_ten_sigkills_at_random_moments_ten_files_recovered(robot, tmp_path):
    lost = [kill_and_recover(robot, tmp_path / f"{i}.mcap", 2.0 * random.random()) for i in range(10)]
    print(f"\nten SIGKILLs: recovered up to {', '.join(f'{1e3 * s:.0f}' for s in sorted(lost))} ms before the kill")
    assert max(lost) < 1.0, lost


def test_it_reports_to_its_console_and_ends_in_order_when_told(robot, tmp_path):
    process = start_process(robot, tmp_path / "a.mcap")
    assert process.stdin is not None
    assert process.stdout is not None
    report = msgspec.json.decode(process.stdout.readline(), type=Report)
    assert report.path == str(tmp_path / "a.mcap")
    process.stdin.write(msgspec.json.encode(FeedLine(end=True)) + b"\n")
    process.stdin.flush()
    assert process.wait(15) == 0
    process.stdout.close()
    process.stdin.close()
    with Recording(tmp_path / "a.mcap") as recording:
        assert recording.closed


def test_it_outlives_its_console_and_ends_with_the_robot(tmp_path):
    with Robot() as robot:
        process = start_process(robot, tmp_path / "a.mcap")
        assert process.stdin is not None
        assert process.stdout is not None
        msgspec.json.decode(process.stdout.readline(), type=Report)
        process.stdin.close()  # as when the console is killed
        seen = robot.tick
        wait_for("more states", lambda: robot.tick > seen + 150)
        assert process.poll() is None
        last = robot.tick
    assert process.wait(15) == 0
    process.stdout.close()
    with Recording(tmp_path / "a.mcap") as recording:
        state = recording.state_at(1e9)
        assert state is not None
        assert state.tick >= last - 5


def test_a_folder_that_cannot_be_written_is_one_clear_line(tmp_path):
    (tmp_path / "file").write_text("no folder")
    command = [sys.executable, "-m", "app", "record", "--endpoint", "tcp/127.0.0.1:9", "--record"]
    done = subprocess.run([*command, str(tmp_path / "file" / "x")], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "no recordings can be kept there" in done.stderr


def test_without_a_robot_it_says_how_to_name_one(tmp_path):
    environment = {**os.environ, "COBRA_TELEOP_RUNTIME_DIR": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-m", "app", "record"], capture_output=True, text=True, env=environment, check=False
    )
    assert done.returncode == 2
    assert "give its --endpoint" in done.stderr


def test_sigterm_closes_the_file(robot, tmp_path):
    process = start_process(robot, tmp_path / "a.mcap")
    assert process.stdout is not None
    process.stdout.readline()
    process.send_signal(signal.SIGTERM)
    assert process.wait(15) == 0
    with Recording(tmp_path / "a.mcap") as recording:
        assert recording.closed
