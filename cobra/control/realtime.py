"""Real-time scheduling, where the machine grants it."""

import os
import sys

REALTIME_PRIORITY = 40


def ask_for_realtime() -> bool:
    """Ask for SCHED_FIFO for the calling thread; returns whether it was given."""
    if not sys.platform.startswith("linux"):
        return False
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(REALTIME_PRIORITY))
    except (PermissionError, OSError):
        return False
    return True
