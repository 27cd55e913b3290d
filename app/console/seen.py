"""What a page's session needs of a robot and of whoever sits at its controls, be it here or only watched."""

from collections.abc import Mapping, Sequence
from typing import Protocol

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

    def restart(self) -> Reply:
        """End what is left of the robot process and start it anew, disarmed."""


class Seat(Protocol):
    """Who drives, asks and stops in the name of the people at the pages."""

    @property
    def errors(self) -> Mapping[str, int]:
        """What could not be sent, by reason."""

    def wake(self) -> None:
        """There is new input."""

    def halt(self, who: str, reason: str = "") -> None:
        """STOP. Safe from any thread."""

    def ask(self, request: Request) -> Reply:
        """Make a request of the robot."""
