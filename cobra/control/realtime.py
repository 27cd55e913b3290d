"""Real-time scheduling, where the machine grants it."""

import contextlib
import os
import sys
from collections.abc import Iterator
from pathlib import Path

LOOP_PRIORITY = 40
OTHERS_PRIORITY = 10
"""For the process's other threads: one that holds the interpreter's lock and is not scheduled would stop the loop too."""

PAGES_PRIORITY = 5
"""For the thread that takes what a driver's page sends: a browser on the same machine draws with all that is left."""

FIRST_NICENESS = -20
_AUTOGROUP = Path("/proc/self/autogroup")
"""Linux weighs niceness within a session, and sessions (terminals, services, browsers) by a niceness of their own."""


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


@contextlib.contextmanager
def ahead_of_others() -> Iterator[None]:
    """Let this process's ordinary threads go before other programs, where the machine grants it.

    Real-time threads of a process wait for its ordinary ones: one that holds the interpreter's lock and waits for a
    processor, beside a browser that draws in software, stopped a driver's commands for half a second. As real-time
    threads, all of them would get into the robot's way.
    """
    niceness = os.getpriority(os.PRIO_PROCESS, 0) if hasattr(os, "getpriority") else 0
    session = _session_niceness()
    _be_nice(FIRST_NICENESS, FIRST_NICENESS)
    try:
        yield
    finally:
        _be_nice(niceness, session)


def as_others() -> None:
    """For a thread that starts another program: what it inherits is no precedence."""
    if sys.platform.startswith("linux"):  # elsewhere niceness is the whole process's
        _be_nice(0, None)


def _session_niceness() -> int | None:
    """None where sessions have none."""
    try:
        return int(_AUTOGROUP.read_text().split()[-1])
    except (OSError, ValueError, IndexError):
        return None


def _be_nice(own: int, session: int | None) -> None:
    """The calling thread, with those that it starts, and the session."""
    with contextlib.suppress(OSError, AttributeError):
        os.setpriority(os.PRIO_PROCESS, 0, own)
    if session is not None:
        with contextlib.suppress(OSError):
            _AUTOGROUP.write_text(str(session))
