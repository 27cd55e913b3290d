"""Claims about processes that die: the robot holds, a new console adopts it, and everybody is told."""

import os
import signal
import subprocess
import sys
import time

import msgspec
import pytest

from tests.stack import Observer, Page, Stack, running, wait_for

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
SLOWED_DOWN_S = 0.5
"""After this time at the latest nothing that was driven moves any more."""


@pytest.fixture
def stack(tmp_path):
    with running(tmp_path, "--twin", "ideal") as stack:  # it homes in half the time
        yield stack


def drive(page: Page, stack: Stack) -> None:
    page.arm()
    page.press()
    page.hold(left=[1, 0])
    before = stack.observer.state.commanded[2]
    stack.observer.wait("motion", lambda state: state.commanded[2] > before + 0.05)


def test_a_killed_console_leaves_a_robot_that_holds_and_the_next_console_adopts_it(stack):
    with Page(stack.url) as page:
        drive(page, stack)
        pid = stack.running("robot").pid
        stack.process.kill()
        killed = stack.observer.state.stamp
        holding = stack.observer.wait("holding", lambda state: state.phase == "holding")
        print(f"the robot held {1e3 * (holding.stamp - killed):.0f} ms after the console was killed")
        assert holding.stamp - killed < 0.25
        assert "commands stopped arriving" in holding.cause
    stack.process.wait()
    at_rest = stack.observer.wait("rest", lambda state: state.stamp > holding.stamp + SLOWED_DOWN_S)
    assert max(map(abs, at_rest.drives.velocity)) < 1e-4

    stack.start()
    assert stack.running("robot").pid == pid
    wait_for("the word of adoption", lambda: "adopted" in stack.output.read_text())
    with Page(stack.url) as page:
        page.until_phase("ready")
        assert stack.observer.state.commanded == at_rest.commanded
        page.press()


def test_a_killed_robot_process_is_told_at_once_and_can_be_restarted_disarmed(stack):
    with Page(stack.url) as page:
        page.arm()
        pid = stack.running("robot").pid
        os.kill(pid, signal.SIGKILL)
        killed = time.monotonic()
        wait_for("word of it", lambda: not page.snapshot["link"]["robot"], 5.0)
        print(f"the page knew {1e3 * (time.monotonic() - killed):.0f} ms after the robot process was killed")
        assert "robot process is gone" in page.snapshot["cause"]
        assert not page.ask("arm")["ok"]
        assert page.ask("restart_robot")["ok"]
        page.until_phase("disarmed")
        assert stack.running("robot").pid != pid
        page.arm()


def test_ctrl_c_ends_both_processes_cleanly(stack):
    pid = stack.running("robot").pid
    assert stack.end() == 0
    wait_for("the end of the robot process", lambda: not os.path.exists(f"/proc/{pid}"))
    assert "Traceback" not in stack.output.read_text()
    assert "Traceback" not in (stack.folder / "robot-cobra.log").read_text()


def test_sigterm_and_the_pages_quit_end_both_processes(stack):
    pid = stack.running("robot").pid
    with Page(stack.url) as page:
        assert page.ask("quit")["ok"]
    assert stack.process.wait(20) == 0
    wait_for("the end of the robot process", lambda: not os.path.exists(f"/proc/{pid}"))


def test_a_second_start_says_who_holds_the_robot(stack):
    second = subprocess.run(
        [sys.executable, "-m", "app", "--no-open", "--no-pad"],
        env=stack.environment,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert second.returncode == 2
    assert str(stack.process.pid) in second.stderr
    assert stack.url in second.stderr
    assert "Traceback" not in second.stderr


def test_stop_latches_for_every_page_and_only_clearing_it_goes_on(stack):
    with Page(stack.url) as driver, Page(stack.url) as other:
        drive(driver, stack)
        assert other.ask("stop")["ok"]
        stopped = stack.observer.wait("stopped", lambda state: state.phase == "stopped")
        assert stopped.lease.holder == ""
        driver.until_phase("stopped")
        at_rest = stack.observer.wait("rest", lambda state: state.stamp > stopped.stamp + SLOWED_DOWN_S)
        stood = at_rest.commanded
        driver.release()
        assert driver.ask("clear")["ok"]
        driver.until_phase("ready")
        assert stack.observer.state.commanded == stood
        driver.hold()
        driver.until_phase("driving")


def test_an_orphaned_robot_process_takes_its_final_action_and_exits(tmp_path):
    command = [sys.executable, "-m", "app", "robot", "--orphaned-after", "1", "--leave-when-orphaned"]
    environment = {**os.environ, "COBRA_TELEOP_RUNTIME_DIR": str(tmp_path)}
    with subprocess.Popen(command, env=environment) as process:
        try:
            entry = tmp_path / "robot-cobra.json"
            wait_for("the robot process", entry.exists, 60.0)
            observer = Observer("cobra", msgspec.json.decode(entry.read_bytes())["endpoint"])
            observer.wait("a console's absence has not begun", lambda state: state.tick > 150)
            assert process.poll() is None, "while a console is there it stays"
            observer.close()
            assert process.wait(10) == 0
            assert not entry.exists()
        finally:
            process.kill()
