"""The one interface to motors, whatever the protocol and whether they are real."""

from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from cobra.errors import OperatorError

Floats = NDArray[np.float64]


class BusError(OperatorError):
    """The bus cannot be opened or is gone. The message says what was tried, what is missing and what to do."""


HOME_AGAIN = "home again"
"""A fault that says so means that where the drive's travel is zero is not known any more."""


@dataclass(frozen=True, slots=True)
class CellReadings:
    """What the load cells say, one entry a tendon (m,) in the order of the description."""

    tension: Floats
    """[N], tared and scaled; NaN where there is no cell, or none that can be believed."""
    raw: Floats
    """[N] by the described scale alone; NaN until first heard."""
    age: Floats
    """[s] since its last frame; inf before the first."""
    trouble: tuple[str, ...]
    """Why it cannot be believed, in words with what to do; empty where it can, and where there is none."""
    fitted: NDArray[np.bool_]
    """Where there is a cell."""


_NONE = np.zeros(0)
NO_CELLS = CellReadings(tension=_NONE, raw=_NONE, age=_NONE, trouble=(), fitted=np.zeros(0, dtype=bool))
"""Of a bus that knows of no load cells."""


@dataclass(frozen=True, slots=True)
class Feedback:
    """What the motors said, one entry a drive in the order of the description; all at the output shaft.

    `angle` is multi-turn and counts from wherever the motor booted. A motor that did not answer keeps its last values,
    with `valid` False and a growing `age`: one lost reply is not an exception.
    """

    angle: Floats
    """[rad]; this, velocity and current are NaN until first read."""
    velocity: Floats
    """[rad/s]"""
    current: Floats
    """[A]; positive drives the shaft in its positive direction."""
    temperature: Floats
    """[°C]; NaN until first read."""
    voltage: Floats
    """[V]; NaN until first read."""
    age: Floats
    """[s] since the last reply that carried an angle; inf before the first."""
    valid: NDArray[np.bool_]
    """Answered in this exchange."""
    missed: NDArray[np.int64]
    """Replies missed in a row."""
    faults: tuple[str, ...]
    """In words; empty where there is none."""
    cells: CellReadings = NO_CELLS
    """Of the load cells, by tendon."""


@dataclass(frozen=True, slots=True)
class ChannelHealth:
    """How one CAN channel does."""

    name: str
    load: float
    """Part of the bit rate that frames took over the last second, 0…1."""
    frame_rate_Hz: float
    trouble: str
    """In words with what to do; empty when all is well."""


class MotorBus(Protocol):
    """All motors of a robot behind one burst-then-collect exchange."""

    @property
    def counts(self) -> dict[str, int]:
        """Every frame that could not be used, by reason (unknown id, short frame, late reply, …)."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What people should know about these motors, in words."""

    @property
    def health(self) -> tuple[ChannelHealth, ...]:
        """One entry a channel."""

    @property
    def waited_s(self) -> float:
        """Seconds spent in the adapters so far, handing over and waiting for frames: the rest of an exchange is computation."""

    def open(self) -> None:
        """Open the channels and find the motors.

        Raises:
            BusError: with what was tried and what to do.
        """

    def close(self) -> None:
        """Close the channels; the motors keep what they were last told."""

    def enable(self) -> tuple[str, ...]:
        """Let the motors take setpoints. Returns what prevents it, in words; empty when all are enabled."""

    def disable(self) -> None:
        """Torque off."""

    def hold(self) -> None:
        """Stop where they are, with torque."""

    def exchange(self, angles: Floats | None) -> Feedback:
        """Send all setpoints [rad, output shaft], then collect all replies within the reply timeout.

        With None nothing is commanded; the motors are only read. Never raises for what arrives on the wire.

        Raises:
            BusError: the channel itself is gone.
        """

    def burst(self, angles: Floats | None) -> None:
        """The sending half of `exchange`, for who computes while the frames are on the wire."""

    def collect(self) -> Feedback:
        """The receiving half. Raises BusError: a channel is gone."""

    def gather(self) -> None:
        """Of the receiving half what must wait for frames; what they say is told by `told`, also after the next burst."""

    def told(self) -> Feedback:
        """What the frames say that `gather` took last. Raises BusError: a channel was gone."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...
