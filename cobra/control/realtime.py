"""Real-time scheduling, where the machine grants it."""

import os
import sys

LOOP_PRIORITY = 40
OTHERS_PRIORITY = 10
"""For the process's other threads: one that holds the interpreter's lock and is not scheduled would stop the loop too."""


def ask_for_realtime(priority: int) -> bool:
    """Ask for SCHED_FIFO for the calling thread and those that it starts; returns whether it was given."""
    if not sys.platform.startswith("linux"):
        return False
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except (PermissionError, OSError):
        return False
    return True
