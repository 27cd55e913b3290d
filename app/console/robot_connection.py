"""The console's connection to its robot process, over that process's deaths and restarts."""

import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from typing import Protocol

from app.console.robot_keeper import RobotStartError
from app.link.access import LinkAccess, LinkError
from app.link.console_end import ConsoleLink
from app.people.audit import Deed
from cobra.messages import Event, Meta, Push, Reply, RobotState, Touch

FIRST_STATE_S = 15.0
RATE_WINDOW = 50


class Keeper(Protocol):
    """Knows where the robot process is, and starts and ends it where it may."""

    @property
    def adopted(self) -> bool:
        """Whether it ran before we came."""

    @property
    def access(self) -> LinkAccess:
        """What its link asks of us."""

    @property
    def no_restart(self) -> str:
        """Why it cannot be restarted from here; empty where it can."""

    def launch(self) -> None:
        """Adopt or start it, without waiting for it."""

    def wait(self) -> str:
        """Wait until it is there; returns where its link is. Raises RobotStartError."""

    def end(self) -> None:
        """End it."""


class RobotConnection:
    """Adopts or starts the robot process, holds the link to it, and notices at once when it is gone."""

    def __init__(self, keeper: Keeper, name: str) -> None:
        self._keeper = keeper
        self._name = name
        self._link: ConsoleLink | None = None
        self._lock = threading.Lock()
        self._arrivals: deque[tuple[int, float]] = deque(maxlen=RATE_WINDOW)
        self.events: deque[Event] = deque(maxlen=200)
        self.event_counts: Counter[str] = Counter()
        """Events by level, also those before a restart."""
        self.present = False
        """Whether the robot process is there."""
        self.on_connect: Callable[[str], None] = lambda endpoint: None
        """Hears where the link is of every robot process that we connect to."""

    def start(self) -> Meta:
        """Connect to the process that the keeper launched; returns what it says of itself.

        Raises:
            RobotStartError, LinkError: it did not come up, or does not answer.
        """
        endpoint = self._keeper.wait()
        link = ConsoleLink(self._name, endpoint, self._alive, self._keeper.access)
        link.events, link.event_counts = self.events, self.event_counts
        link.start()
        try:
            link.wait_for_state(FIRST_STATE_S)
            meta = link.meta()
            # On hardware nobody tells it.
            link.watch_truth()
        except LinkError:
            link.stop()
            raise
        self._link, self.present = link, True
        self.on_connect(endpoint)
        return meta

    def stop(self) -> None:
        link, self._link = self._link, None
        if link is not None:
            link.stop()

    @property
    def link(self) -> ConsoleLink | None:
        """The link while the robot process is there."""
        return self._link if self.present else None

    def latest(self) -> RobotState | None:
        """The newest state, also of a process that is gone by now."""
        return self._link.latest if self._link else None

    def touch(self) -> Touch | None:
        """What the twin's walls have to do with it; None without walls."""
        return self._link.touch if self._link else None

    def truth(self) -> bytes | None:
        """The twin's newest truth; None on hardware, and while the robot process is gone."""
        link = self.link
        return link.truth if link else None

    def push(self, push: Push) -> None:
        """Push on the twin, where there is one."""
        if link := self.link:
            link.push(push)

    def age(self) -> float:
        """Seconds since the newest state arrived; inf before the first."""
        return time.monotonic() - self._link.arrived if self._link and self._link.latest else float("inf")

    def warn(self, text: str) -> None:
        """Put a warning of the console's own among the robot's events."""
        state = self.latest()
        self.events.append(Event(stamp=state.stamp if state else 0.0, level="warning", text=text))
        self.event_counts["warning"] += 1

    def audit(self) -> list[Deed]:
        """The newest deeds of the robot's audit trail, oldest first."""
        return self.link.audit() if self.link else []

    def rate(self) -> float:
        """States that reached us lately [Hz]; call it regularly."""
        if self._link is None:
            return 0.0
        self._arrivals.append((self._link.received, time.monotonic()))
        (n0, t0), (n1, t1) = self._arrivals[0], self._arrivals[-1]
        return (n1 - n0) / (t1 - t0) if t1 > t0 else 0.0

    def restart(self) -> Reply:
        """End what is left of the robot process and start it anew, disarmed."""
        if self._keeper.no_restart:
            return Reply(ok=False, reasons=(self._keeper.no_restart,))
        with self._lock:
            self.stop()
            self.present = False
            self._arrivals.clear()
            self._keeper.end()
            self._keeper.launch()
            try:
                self.start()
            except (RobotStartError, LinkError) as error:
                return Reply(ok=False, reasons=(str(error),))
        return Reply(ok=True)

    def _alive(self, alive: bool) -> None:
        self.present = alive
