"""What a page's session needs of a robot and of whoever sits at its controls, be it here or only watched."""

from collections.abc import Mapping, Sequence
from concurrent.futures import Future
from typing import Protocol

from app.console.page_socket import SeatRequest
from app.console.page_state import SeatState
from app.console.seat import Occupant
from app.people.audit import Deed
from cobra.messages import Event, Reply, Request, RobotState


class SeenRobot(Protocol):
    """A robot that states come from."""

    @property
    def present(self) -> bool:
        """Whether the robot process is there."""

    @property
    def events(self) -> Sequence[Event]:
        """The newest last."""

    def latest(self) -> RobotState | None:
        """The newest state, also of a process that is gone by now."""

    def age(self) -> float:
        """Seconds since the newest state arrived; inf before the first."""

    def rate(self) -> float:
        """States that reached us lately [Hz]; called regularly."""

    def audit(self) -> list[Deed]:
        """The newest deeds of the robot's audit trail, oldest first. Waits for its answer."""

    def restart(self) -> Reply:
        """End what is left of the robot process and start it anew, disarmed."""


class Seat(Protocol):
    """Who drives, asks and stops in the name of the people at the pages."""

    @property
    def lag_s(self) -> float:
        """Round trip to the robot process [s]."""

    @property
    def errors(self) -> Mapping[str, int]:
        """What could not be sent, by reason."""

    def wake(self) -> None:
        """There is new input."""

    def halt(self, who: str, reason: str = "") -> Future[bool]:
        """STOP. Safe from any thread. Tells whether the robot confirmed it."""

    def ask(self, request: Request, asker: Occupant) -> Reply:
        """Make a request of the robot. Waits for its answer."""

    def change(self, asker: Occupant, what: SeatRequest, text: str, yes: bool) -> Reply:
        """Take the controls, give them, ask for them, choose the pad. `text`: the reason for take, the name for grant
        and refuse; `yes`: for console_pad. Waits for the robot's answer."""

    def vacate(self, page: str) -> None:
        """A page is gone for good, and with it what it held and asked for."""

    def seat_state(self) -> SeatState:
        """Who holds the controls through this console."""
