"""The driver's seat of this console: on whose behalf it holds the robot's lease, and which inputs are theirs."""

import threading
from dataclasses import dataclass

PAD = "pad"
"""Key, among the pilot's sources, of the pad plugged into the console's computer."""


@dataclass(frozen=True, slots=True)
class Occupant:
    """Who sits there: a person, at one page."""

    name: str
    page: str


class Seat:
    """Safe from any thread.

    A `shared` seat is everybody's who comes: that is the console of one person on their own machine, where every page
    and the pad are theirs. Otherwise one page sits in it, and the console's pad drives only when that page says so.
    """

    def __init__(self, host: str, shared: bool) -> None:
        """`host`: who started the console."""
        self.host = host
        self.shared = shared
        self._lock = threading.Lock()
        self._occupant: Occupant | None = None
        self._pad = shared

    @property
    def occupant(self) -> Occupant | None:
        return self._occupant

    @property
    def holder(self) -> str:
        """In whose name the lease is held; empty when the seat is free."""
        if self.shared:
            return self.host
        return self._occupant.name if self._occupant else ""

    @property
    def pad(self) -> bool:
        """Whether the console's pad drives."""
        return self._pad

    def take(self, occupant: Occupant) -> None:
        with self._lock:
            self._occupant, self._pad = occupant, self.shared

    def leave(self) -> None:
        with self._lock:
            self._occupant, self._pad = None, self.shared

    def sits(self, page: str) -> bool:
        """Whether a page may act as the driver."""
        occupant = self._occupant
        return self.shared or (occupant is not None and occupant.page == page)

    def use_pad(self, page: str, wanted: bool) -> str:
        """Choose whether the console's pad drives; returns why it was refused, or an empty string."""
        with self._lock:
            if not self.sits(page):
                return "take the controls first"
            self._pad = wanted
            return ""

    def admits(self, source: str) -> bool:
        """Whether an input may drive."""
        return self._pad if source == PAD else self.sits(source)
