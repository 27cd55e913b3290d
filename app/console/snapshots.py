"""What a page is sent of the newest snapshot: all of it, or over a slow link what changed, less often."""

import time
from collections.abc import Callable
from typing import Any

import msgspec

PERIOD_S = 0.05
THIN_PERIOD_S = 0.2
SLOW_PERIOD_S = 2.0
SLOW_PARTS = frozenset({"bus", "channels", "drives", "drops", "events", "notes", "page_drops", "recording", "timing"})
"""A thin page is sent these only so often: they are tables that somebody looks up."""

Parts = dict[str, str]
"""JSON of each part of a snapshot, by its name."""


class Snapshots:
    """One snapshot serves all pages."""

    def __init__(self, take: Callable[[], dict[str, Any]], now: Callable[[], float] = time.monotonic) -> None:
        """`take` gives a new one; `now` is its stamp [s]."""
        self._take = take
        self._now = now
        self._at = float("-inf")
        self._parts: Parts = {}
        self._whole = ""

    def whole(self) -> str:
        """The newest, as a message."""
        self._renew()
        return self._whole

    def parts(self) -> Parts:
        """The newest, part by part."""
        self._renew()
        return self._parts

    def _renew(self) -> None:
        now = self._now()
        if now - self._at > 0.8 * PERIOD_S:
            self._at = now
            snapshot = {"type": "snapshot", "stamp": now, **self._take()}
            self._parts = {name: msgspec.json.encode(value).decode() for name, value in snapshot.items()}
            self._whole = message(self._parts)


class Changes:
    """What one thin page has been sent, so that it is sent only what is new to it."""

    def __init__(self) -> None:
        self._sent: Parts = {}
        self._slow_at = float("-inf")

    def since(self, parts: Parts, now_s: float) -> str:
        """The parts that it has not got like this yet, as a message; the page puts them over what it has."""
        slow = now_s - self._slow_at >= SLOW_PERIOD_S
        if slow:
            self._slow_at = now_s
        new = {
            name: part
            for name, part in parts.items()
            if part != self._sent.get(name) and (slow or name not in SLOW_PARTS)
        }
        self._sent.update(new)
        return message({"type": parts["type"], **new})


def message(parts: Parts) -> str:
    """JSON of an object with these parts."""
    return "{" + ",".join(f'"{name}":{part}' for name, part in parts.items()) + "}"
