"""The 3D view in both details. The thin one is opened when somebody first asks for it: most robots are never looked at so."""

import threading
from collections.abc import Callable
from typing import NamedTuple

from app.console.detail import FULL, Detail, thin
from app.console.viewer import Viewer
from cobra.messages import Touch, Walls


class ViewAddress(NamedTuple):
    """Where a viser server listens on loopback, and what it wants to see of whoever connects."""

    port: int
    secret: str


class Views:
    """Owns one or two viewers of the same robot."""

    def __init__(self, sections: int, make: Callable[[Detail], Viewer]) -> None:
        """`make` gives a viewer that is not started yet."""
        self._make = make
        self._sections = sections
        self._lock = threading.Lock()
        self._full = make(FULL)
        self._thin: Viewer | None = None
        self._surroundings: tuple[Walls, Callable[[], Touch | None]] | None = None

    def start(self) -> None:
        self._full.start()

    def stop(self) -> None:
        with self._lock:
            for viewer in filter(None, (self._full, self._thin)):
                viewer.stop()
            self._thin = None

    def surround(self, walls: Walls, touch: Callable[[], Touch | None]) -> None:
        """Draw what surrounds a simulated robot, see `Viewer.surround`."""
        with self._lock:
            self._surroundings = walls, touch
            for viewer in filter(None, (self._full, self._thin)):
                viewer.surround(walls, touch)

    @property
    def full(self) -> ViewAddress:
        return ViewAddress(self._full.port, self._full.secret)

    def thin(self) -> ViewAddress:
        """Opens it at the first call, which takes a moment. From any thread."""
        with self._lock:
            if self._thin is None:
                viewer = self._make(thin(self._sections))
                viewer.start()
                if self._surroundings:
                    viewer.surround(*self._surroundings)
                self._thin = viewer
            return ViewAddress(self._thin.port, self._thin.secret)
