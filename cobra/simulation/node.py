"""What a simulated drive is to the bus: something that hears frames and sends frames."""

from typing import Protocol

Frame = tuple[int, bytes]
"""11-bit id and up to 8 bytes."""


class Node(Protocol):
    """One device on a bus. Nothing it is sent may raise."""

    @property
    def listens(self) -> frozenset[int]:
        """The ids it takes."""

    @property
    def speaks(self) -> bool:
        """Whether it may ever send something unasked."""

    def hear(self, arbitration_id: int, data: bytes) -> list[Frame]:
        """Take a frame; what it answers."""

    def unasked(self) -> list[Frame]:
        """What it sends by itself now: alarms, heartbeats."""


class DriveNode(Node, Protocol):
    """A drive among the devices."""

    def slip(self, degrees: float) -> None:
        """The encoder slips on its shaft, by degrees of the output."""
