"""What the motors of one channel have in common, whatever they speak: `MotorChannel` but for the protocol."""

from abc import ABC, abstractmethod
from collections import Counter
from types import TracebackType
from typing import Final, Self

from cobra.motors.bus import ChannelHealth, Feedback, Floats
from cobra.motors.cell_readings import LoadCells
from cobra.motors.channel import Channel, Record

REPLY_LATENCY_S: Final = 0.003
"""A drive may take so long to answer; 1.1 to 2 ms are seen on real ones."""
WAIT: Final = 0.7
"""Part of a tick in which replies are waited for."""


def reply_window_s(wire_time_s: float, most_s: float, period_s: float) -> float:
    """How long replies are waited for, from when they were asked for.

    Waiting costs only when a reply is missing; a serial adapter or a busy machine may need long.
    """
    return max(WAIT * period_s, min(wire_time_s + REPLY_LATENCY_S, most_s))


class ChannelBus(ABC):
    """Opens and closes its channel, splits an exchange in its parts, and hands over what is not for the drives."""

    indices: tuple[int, ...]
    """Position of each drive in the description."""

    def __init__(self, channel: Channel, counts: Counter[str]) -> None:
        self._port = channel
        self._count = counts
        self.counts: dict[str, int] = counts

    @property
    def notes(self) -> tuple[str, ...]:
        """What people should know about these drives."""
        return ()

    @property
    def waited_s(self) -> float:
        return self._port.waited_s

    @property
    def health(self) -> ChannelHealth:
        return self._port.health

    def record_to(self, record: Record | None) -> None:
        """Show every frame, sent and received, to `record`."""
        self._port.record = record

    def listen_for(self, cells: LoadCells) -> None:
        """Hand over the frames of the load cells on this channel."""
        self._port.listeners = {**cells.listeners(self._port.described.name, self._count)}

    @abstractmethod
    def open(self) -> None:
        """Raises BusError."""

    @abstractmethod
    def close(self) -> None: ...

    @abstractmethod
    def burst(self, angles: Floats | None) -> None:
        """The sending half of an exchange. Raises BusError."""

    @abstractmethod
    def gather(self) -> None:
        """Take what arrives in time; what it says is `told`. Raises BusError."""

    @abstractmethod
    def told(self) -> Feedback:
        """What was gathered last. Raises BusError."""

    def exchange(self, angles: Floats | None) -> Feedback:
        """Setpoints [rad, (n,)] out, then all replies in. Raises BusError if the channel is gone."""
        self.burst(angles)
        return self.collect()

    def collect(self) -> Feedback:
        """The receiving half. Raises BusError."""
        self.gather()
        return self.told()

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
