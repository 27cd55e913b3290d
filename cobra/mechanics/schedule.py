"""Values over time: cable commands and external forces of a load case."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, Self

import numpy as np
from numpy.typing import ArrayLike

from cobra.mechanics.chain import Floats

CommandKind = Literal["forces", "lengths"]


@dataclass(frozen=True, slots=True)
class Schedule:
    """Values (times, ...) from their times on: held until the next, or joined by straight lines.

    Before the first time it is `before` (nothing acts, unless said otherwise); after the last its value stays.

    Raises:
        ValueError: no times, times that do not increase, a value that is not finite, or not one value a time.
    """

    time_s: Floats
    values: Floats
    linear: bool = False
    before: float = 0.0

    def __post_init__(self) -> None:
        if self.time_s.ndim != 1 or len(self.time_s) == 0 or len(self.values) != len(self.time_s):
            raise ValueError(
                f"{len(self.values)} values at {len(self.time_s)} times: there must be one value for each time"
            )
        if not (np.isfinite(self.time_s).all() and np.isfinite(self.values).all() and np.isfinite(self.before)):
            raise ValueError("times and values must be finite numbers")
        for earlier, later in zip(self.time_s[:-1], self.time_s[1:], strict=True):
            if later <= earlier:
                raise ValueError(f"time {later:g} s follows {earlier:g} s: times must increase")

    @classmethod
    def constant(cls, value: ArrayLike) -> Self:
        """The same value from 0 s on."""
        return cls(np.zeros(1), np.asarray(value, dtype=np.float64)[None])

    def over(self, marks_s: Floats) -> Floats:
        """Values at the beginning and end of each interval between marks (marks − 1, 2, ...), jumps taken at the marks."""
        begin, end = marks_s[:-1], marks_s[1:]
        index = np.searchsorted(self.time_s, 0.5 * (begin + end), side="right") - 1
        acts = (index >= 0).reshape(-1, *([1] * (self.values.ndim - 1)))
        if not self.linear:
            held = np.where(acts, self.values[np.maximum(index, 0)], self.before)
            return np.stack([held, held], axis=1)
        flat = self.values.reshape(len(self.values), -1)
        shape = (len(begin), *self.values.shape[1:])
        ends = [
            np.stack([np.interp(t, self.time_s, column) for column in flat.T], axis=-1).reshape(shape)
            for t in (begin, end)
        ]
        return np.stack([np.where(acts, value, self.before) for value in ends], axis=1)


@dataclass(frozen=True, slots=True)
class Cables:
    """What the motors do: forces [N] or cable lengths L_d [m], a schedule of plain numbers for each cable."""

    schedules: tuple[Schedule, ...]
    kind: CommandKind = "forces"

    @classmethod
    def table(
        cls, time_s: Sequence[float], values: ArrayLike, kind: CommandKind = "forces", *, linear: bool = False
    ) -> Self:
        """From rows (times, cables)."""
        columns = np.asarray(values, dtype=np.float64).T
        return cls(tuple(Schedule(np.asarray(time_s, dtype=np.float64), column, linear) for column in columns), kind)

    @classmethod
    def constant(cls, values: ArrayLike, kind: CommandKind = "forces") -> Self:
        """The same values (cables,) from 0 s on."""
        return cls.table([0.0], np.asarray(values, dtype=np.float64)[None], kind)

    def over(self, marks_s: Floats) -> Floats:
        """(marks − 1, 2, cables) as `Schedule.over`."""
        return np.stack([schedule.over(marks_s) for schedule in self.schedules], axis=-1)


@dataclass(frozen=True, slots=True)
class Load:
    """An external force [N] on guider 1 … n in the axes of the base, values (times, 3)."""

    guider: int
    force: Schedule
