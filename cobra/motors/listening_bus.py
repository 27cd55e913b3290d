"""A channel that carries load cells and no drives: it is only listened to."""

from collections import Counter
from typing import Any, Final

import numpy as np

from cobra.clock import Clock
from cobra.description import Bus, RobotDescription
from cobra.motors.bus import BusError, Feedback, Floats
from cobra.motors.channel import Channel
from cobra.motors.channel_bus import ChannelBus

_NOTHING: Final = np.zeros(0)


class ListeningBus(ChannelBus):
    """`MotorChannel` without drives. What is not a load cell's is counted."""

    indices: tuple[int, ...] = ()

    def __init__(self, description: RobotDescription, bus: Bus, clock: Clock, options: dict[str, Any]) -> None:
        count: Counter[str] = Counter()
        super().__init__(Channel(bus, clock, options, count), count)

    def open(self) -> None:
        """Raises BusError."""
        self._port.open()
        try:
            self._port.purge()
        except BusError:
            self._port.close()
            raise

    def close(self) -> None:
        self._port.close()

    def enable(self) -> tuple[str, ...]:
        """There is nothing to enable. Raises BusError while the channel is gone."""
        self._port.interrupted = False
        self._port.check_open()
        return ()

    def refuse_setpoints(self) -> None: ...
    def disable(self) -> None: ...
    def hold(self) -> None: ...

    def burst(self, angles: Floats | None) -> None:
        """Raises BusError while the channel is gone."""
        self._port.check_open()

    def gather(self) -> None:
        """Take what has come. Raises BusError."""
        self._port.drain(self._stranger)

    def told(self) -> Feedback:
        """There are no drives."""
        return Feedback(
            angle=_NOTHING, velocity=_NOTHING, current=_NOTHING, temperature=_NOTHING, voltage=_NOTHING, age=_NOTHING,
            valid=np.zeros(0, dtype=bool), missed=np.zeros(0, dtype=np.int64), faults=(),
        )  # fmt: skip

    def _stranger(self, _: Any) -> None:
        self._count["unknown id"] += 1
