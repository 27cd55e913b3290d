"""Claims about who goes first on a busy machine: the robot, then the console with its driver, then everybody else."""

import os
import subprocess
import sys
from pathlib import Path

import psutil
import pytest

from cobra.control.realtime import FIRST_NICENESS, LOOP_PRIORITY, OTHERS_PRIORITY, realtime
from tests.stack import Stack, wait_for

pytestmark = pytest.mark.skipif(not hasattr(os, "SCHED_FIFO"), reason="only Linux gives each thread its own precedence")


def threads(pid: int) -> list[int]:
    """Of a process, but those of Zenoh that watch over its memory."""
    tasks = Path(f"/proc/{pid}/task").iterdir()
    return [int(task.name) for task in tasks if "Watchdog" not in (task / "comm").read_text()]


def priority(thread: int) -> int:
    """0 where it is an ordinary one."""
    realtime = os.sched_getscheduler(thread) == os.SCHED_FIFO
    return os.sched_getparam(thread).sched_priority if realtime else 0


def niceness(thread: int) -> int:
    return os.getpriority(os.PRIO_PROCESS, thread)


def session(pid: int) -> int:
    """Niceness of its session; as wanted where the kernel does not group programs by sessions."""
    try:
        return int(Path(f"/proc/{pid}/autogroup").read_text().split()[-1])
    except OSError:
        return FIRST_NICENESS


def test_no_thread_of_robot_or_console_waits_behind_other_programs_and_the_recorder_does(tmp_path):
    with realtime(1) as granted:
        pass
    if not granted:
        pytest.skip("this machine does not grant precedence")
    stack = Stack(tmp_path)
    stack.environment["OPENBLAS_NUM_THREADS"] = "1"  # its pool begins with the import of numpy
    with stack.start():
        robot, console = stack.running("robot").pid, stack.running("console").pid
        wait_for("the loop's precedence", lambda: LOOP_PRIORITY in map(priority, threads(robot)))
        assert min(map(priority, threads(robot))) == OTHERS_PRIORITY
        assert all(priority(thread) or niceness(thread) == FIRST_NICENESS for thread in threads(console))
        assert session(console) == FIRST_NICENESS
        (recorder,) = (child.pid for child in psutil.Process(console).children() if "record" in child.cmdline())
        wait_for("the recorder's step back", lambda: min(map(niceness, threads(recorder))) > 0)
        assert not any(map(priority, threads(recorder)))


PRECEDENCE = """
import os
import subprocess
import sys
from pathlib import Path
from cobra.control.realtime import ahead_of_others
grouped = Path("/proc/self/autogroup")
def niceness():
    return os.getpriority(os.PRIO_PROCESS, 0), grouped.read_text().split()[-1] if grouped.exists() else None
before = niceness()
with ahead_of_others():
    during = niceness()
print(before == niceness(), before != during)
"""


def test_whoever_uses_the_terminal_after_the_console_has_no_precedence():
    told = subprocess.run(
        [sys.executable, "-c", PRECEDENCE], start_new_session=True, capture_output=True, text=True, check=True
    ).stdout
    came_back, was_granted = told.split()
    assert came_back == "True"
    with realtime(1) as granted:
        pass
    assert was_granted == str(granted)
