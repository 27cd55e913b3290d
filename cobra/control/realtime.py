"""Real-time scheduling, where the machine grants it."""

import contextlib
import os
import sys
from collections.abc import Iterator

LOOP_PRIORITY = 40
OTHERS_PRIORITY = 10
"""For the process's other threads: one that holds the interpreter's lock and is not scheduled would stop the loop too."""

PAGES_PRIORITY = 5
"""For the thread that takes what a driver's page sends: a browser on the same machine draws with all that is left."""

CONSOLE_PRIORITY = 2
"""For everything else in the console. With a browser on the same machine a drawing thread that was waiting for a
processor, and held the interpreter's lock, held the driver's commands up for half a second. Niceness does not help:
Linux weighs it within one session only (autogroup)."""


def ask_for_realtime(priority: int) -> bool:
    """Ask for SCHED_FIFO for the calling thread and those that it starts; returns whether it was given."""
    if not sys.platform.startswith("linux"):
        return False
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except (PermissionError, OSError):
        return False
    return True


def ordinary_scheduling() -> None:
    """For the calling thread and those that it starts: no precedence any more. Processes inherit it, wanted or not."""
    if sys.platform.startswith("linux"):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


@contextlib.contextmanager
def realtime(priority: int) -> Iterator[bool]:
    """As `ask_for_realtime`, for as long as the block takes: whoever called goes on as before."""
    before = (os.sched_getscheduler(0), os.sched_getparam(0)) if sys.platform.startswith("linux") else None
    granted = ask_for_realtime(priority)
    try:
        yield granted
    finally:
        if before is not None and granted:
            os.sched_setscheduler(0, *before)
