"""Whoever listens to the loop cannot end it: a callback that fails is counted, logged once, and called again next time."""

import logging
from collections import Counter
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")

log = logging.getLogger("cobra.loop")


def guarded(what: str, callback: Callable[[T], None], failures: Counter[str]) -> Callable[[T], None]:
    """`callback` as one that never raises; each failure is counted in `failures` under what it was and its kind."""

    def call(value: T) -> None:
        try:
            callback(value)
        except Exception as fault:
            reason = f"{what} failed: {type(fault).__name__}"
            if reason not in failures:
                log.exception("%s", reason)
            failures[reason] += 1

    return call
