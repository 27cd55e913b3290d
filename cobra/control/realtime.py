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


def ask_for_realtime(priority: int) -> bool:
    """Ask for SCHED_FIFO for the calling thread and those that it starts; returns whether it was given."""
    if not sys.platform.startswith("linux"):
        return False
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except (PermissionError, OSError):
        return False
    return True


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
