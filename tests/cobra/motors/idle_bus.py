"""A motor bus whose drives stand still: for tests of what is around it."""

import numpy as np

from cobra.description import RobotDescription
from cobra.motors.bus import ChannelHealth, Feedback


class IdleBus:
    """Implements `MotorBus` without a wire."""

    def __init__(self, description: RobotDescription) -> None:
        self._n = len(description.drives)
        self.counts: dict[str, int] = {}
        self.notes: tuple[str, ...] = ()
        self.health: tuple[ChannelHealth, ...] = ()
        self.waited_s = 0.0

    def open(self) -> None: ...

    def close(self) -> None: ...

    def enable(self) -> tuple[str, ...]:
        return ()

    def disable(self) -> None: ...

    def hold(self) -> None: ...

    def exchange(self, angles: np.ndarray | None) -> Feedback:
        zeros = np.zeros(self._n) if angles is None else np.asarray(angles)
        still = np.zeros(self._n)
        return Feedback(
            angle=zeros,
            velocity=still,
            current=still,
            temperature=still + 25.0,
            voltage=still + 24.0,
            age=still,
            valid=np.ones(self._n, dtype=bool),
            missed=np.zeros(self._n, dtype=np.int64),
            faults=("",) * self._n,
        )

    def __enter__(self) -> "IdleBus":
        return self

    def __exit__(self, *_: object) -> None: ...
