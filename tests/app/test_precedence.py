"""Claims about who goes first on a busy machine: the robot, then the console with its driver, then everybody else."""

import os
from pathlib import Path

import psutil
import pytest

from cobra.control.realtime import CONSOLE_PRIORITY, LOOP_PRIORITY, OTHERS_PRIORITY, realtime
from tests.stack import Stack, wait_for

pytestmark = pytest.mark.skipif(not hasattr(os, "SCHED_FIFO"), reason="only Linux gives threads real-time scheduling")


def priorities(pid: int) -> list[int]:
    """Of every thread of a process but those of Zenoh that watch over its memory: 0 where it is an ordinary one."""
    tasks = Path(f"/proc/{pid}/task").iterdir()
    threads = [int(task.name) for task in tasks if "Watchdog" not in (task / "comm").read_text()]
    return [
        os.sched_getparam(thread).sched_priority if os.sched_getscheduler(thread) == os.SCHED_FIFO else 0
        for thread in threads
    ]


def test_no_thread_of_robot_or_console_waits_behind_other_programs_and_the_recorder_does(tmp_path):
    with realtime(1) as granted:
        pass
    if not granted:
        pytest.skip("this machine does not grant real-time scheduling")
    stack = Stack(tmp_path)
    stack.environment["OPENBLAS_NUM_THREADS"] = "1"  # its pool begins with the import of numpy
    with stack.start():
        robot, console = stack.running("robot").pid, stack.running("console").pid
        wait_for("the loop's precedence", lambda: LOOP_PRIORITY in priorities(robot))
        assert min(priorities(robot)) == OTHERS_PRIORITY
        assert min(priorities(console)) == CONSOLE_PRIORITY
        (recorder,) = (child.pid for child in psutil.Process(console).children() if "record" in child.cmdline())
        wait_for("the recorder's step back", lambda: max(priorities(recorder)) == 0)
