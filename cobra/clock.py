"""Time is passed in, so that tests and faults run without sleeping."""

import time
from typing import Protocol


class Clock(Protocol):
    """Monotonic seconds from an arbitrary origin."""

    def now(self) -> float: ...

    def sleep_until(self, deadline_s: float) -> None: ...


class SystemClock:
    """The machine's monotonic clock."""

    def now(self) -> float:
        return time.monotonic()

    def sleep_until(self, deadline_s: float) -> None:
        remaining = deadline_s - time.monotonic()
        if remaining > 0:
            time.sleep(remaining)


class ManualClock:
    """A clock that moves only when told to."""

    def __init__(self, start_s: float = 1000.0) -> None:
        self._now = start_s

    def now(self) -> float:
        return self._now

    def sleep_until(self, deadline_s: float) -> None:
        self._now = max(self._now, deadline_s)

    def advance(self, seconds: float) -> None:
        self._now += seconds
