"""A channel that carries load cells and no drives: it is only listened to."""

from collections import Counter
from types import TracebackType
from typing import Any, Final, Self

import numpy as np

from cobra.clock import Clock
from cobra.description import Bus, RobotDescription
from cobra.motors.bus import BusError, ChannelHealth, Feedback, Floats
from cobra.motors.cell_readings import LoadCells
from cobra.motors.channel import Channel, Record

_NOTHING: Final = np.zeros(0)


class ListeningBus:
    """`MotorChannel` without drives. What is not a load cell's is counted."""

    indices: tuple[int, ...] = ()
    notes: tuple[str, ...] = ()

    def __init__(self, description: RobotDescription, bus: Bus, clock: Clock, options: dict[str, Any]) -> None:
        self._count: Counter[str] = Counter()
        self.counts: dict[str, int] = self._count
        self._channel = Channel(bus, clock, options, self._count)

    @property
    def waited_s(self) -> float:
        return self._channel.waited_s

    @property
    def health(self) -> ChannelHealth:
        return self._channel.health

    def record_to(self, record: Record | None) -> None:
        """Show every frame to `record`."""
        self._channel.record = record

    def listen_for(self, cells: LoadCells) -> None:
        """Hand over the frames of the load cells on this channel."""
        self._channel.listeners = {**cells.listeners(self._channel.described.name, self._count)}

    def enable(self) -> tuple[str, ...]:
        """There is nothing to enable. Raises BusError."""
        self._channel.interrupted = False
        self._channel.check_open()
        return ()

    def refuse_setpoints(self) -> None: ...
    def disable(self) -> None: ...
    def hold(self) -> None: ...

    def burst(self, angles: Floats | None) -> None:
        """Raises BusError while the channel is gone."""
        self._channel.check_open()

    def gather(self) -> None:
        """Take what has come. Raises BusError."""
        self._channel.drain(self._stranger)

    def told(self) -> Feedback:
        """There are no drives."""
        return Feedback(
            angle=_NOTHING, velocity=_NOTHING, current=_NOTHING, temperature=_NOTHING, voltage=_NOTHING, age=_NOTHING,
            valid=np.zeros(0, dtype=bool), missed=np.zeros(0, dtype=np.int64), faults=(),
        )  # fmt: skip

    def __enter__(self) -> Self:
        self._channel.open()
        try:
            self._channel.purge()
        except BusError:
            self._channel.close()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._channel.close()

    def _stranger(self, _: Any) -> None:
        self._count["unknown id"] += 1
