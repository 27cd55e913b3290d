"""Values over time: cable commands and external forces of a load case."""

from dataclasses import dataclass

import numpy as np

from cobra.mechanics.chain import Floats


@dataclass(frozen=True, slots=True)
class Schedule:
    """Values (times, ...) from their times on: held until the next, or joined by straight lines.

    Before the first time nothing acts; after the last its value stays.

    Raises:
        ValueError: no times, times that do not increase, a value that is not finite, or not one value a time.
    """

    time_s: Floats
    values: Floats
    linear: bool = False

    def __post_init__(self) -> None:
        if self.time_s.ndim != 1 or len(self.time_s) == 0 or len(self.values) != len(self.time_s):
            raise ValueError(
                f"{len(self.time_s)} times and {len(self.values)} values: there must be one value for each time"
            )
        if not (np.isfinite(self.time_s).all() and np.isfinite(self.values).all()):
            raise ValueError("times and values must be finite numbers")
        for before, after in zip(self.time_s[:-1], self.time_s[1:], strict=True):
            if after <= before:
                raise ValueError(f"time {after:g} s follows {before:g} s: times must increase")

    @classmethod
    def constant(cls, value: object) -> "Schedule":
        """The same value from 0 s on."""
        return cls(np.zeros(1), np.asarray(value, dtype=np.float64)[None])

    def over(self, marks_s: Floats) -> Floats:
        """Values at the beginning and end of each interval between marks (marks − 1, 2, ...), jumps taken at the marks."""
        begin, end = marks_s[:-1], marks_s[1:]
        shape = (-1, *([1] * (self.values.ndim - 1)))
        index = np.searchsorted(self.time_s, 0.5 * (begin + end), side="right") - 1
        acts = (index >= 0).reshape(shape)
        held = np.where(acts, self.values[np.maximum(index, 0)], 0.0)
        if not self.linear:
            return np.stack([held, held], axis=1)
        flat = self.values.reshape(len(self.values), -1)
        ends = [
            np.stack([np.interp(t, self.time_s, column) for column in flat.T], axis=-1).reshape(held.shape)
            for t in (begin, end)
        ]
        return np.stack([np.where(acts, value, 0.0) for value in ends], axis=1)
