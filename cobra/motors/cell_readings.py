"""What the load cells say of the tendons' tension, and whether it can be believed: a dead cell never reads as no tension."""

import math
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final

import msgspec
import numpy as np

from cobra.clock import Clock
from cobra.description import LoadCell, RobotDescription
from cobra.motors.bus import CellReadings
from cobra.motors.load_cells import FORMATS, INTEGER_LIMITS, decode_reading

STALE_PERIODS: Final = 4.0
"""A cell that missed so many of its frames is silent."""
STALE_S: Final = 0.25
"""At least: a busy machine may look late, and currents that stand in for a moment bring their gears' friction with them."""
STUCK_READINGS: Final = 50
"""Exactly alike one after the other, from a cell whose described noise is more than a count, …"""
STUCK_S: Final = 1.0
"""… over at least this long."""
BELOW_NOTHING: Final = 0.05
"""Of the highest tension: a cell that reads further below zero is wrong, since no tendon can push."""
BELOW_NOTHING_N: Final = 1.0

MENDED_BY_TARING: Final = "tare it"
"""What is wrong with a cell says so where only that helps."""

Take = Callable[[bytes | bytearray], None]


class CellCalibration(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """tension = gain · (reading − offset_N)."""

    offset_N: float
    """What it reads without tension, by its described scale."""
    gain: float = 1.0
    """Found with a known force; 1 as long as only tared."""


@dataclass(slots=True)
class _Cell:
    described: LoadCell
    tendon: int
    calibration: CellCalibration | None = None
    reading_N: float = math.nan
    heard_s: float = -math.inf
    alike: int = 0
    alike_since_s: float = 0.0
    saturated: bool = False
    ends: tuple[float, float] = field(default=(-math.inf, math.inf))


class LoadCells:
    """All load cells of a robot; each channel hands over their frames as they come."""

    def __init__(self, description: RobotDescription, clock: Clock) -> None:
        self._clock = clock
        self._tendons = len(description.tendon_names)
        self._highest_N = description.tendon.max_tension_N if description.tendon else 0.0
        self._cells = [
            _Cell(cell, description.tendon_names.index(cell.tendon), ends=_ends(cell))
            for cell in description.load_cells
        ]

    def __len__(self) -> int:
        return len(self._cells)

    def calibrate(self, calibrations: Mapping[str, CellCalibration]) -> None:
        """Take these from now on, by tendon; a cell without one is not believed."""
        for cell in self._cells:
            cell.calibration = calibrations.get(cell.described.tendon)

    def listeners(self, bus: str, counts: Counter[str]) -> dict[int, Take]:
        """For one bus, by frame id, who takes the frame's data."""
        frames: dict[int, list[_Cell]] = {}
        for cell in self._cells:
            if cell.described.bus == bus:
                frames.setdefault(cell.described.frame_id, []).append(cell)

        def taking(cells: list[_Cell]) -> Take:
            def take(data: bytes | bytearray) -> None:
                for cell in cells:
                    try:
                        self._hear(cell, decode_reading(cell.described, bytes(data)))
                    except ValueError:
                        counts["short load cell frame"] += 1

            return take

        return {frame_id: taking(cells) for frame_id, cells in frames.items()}

    def readings(self) -> CellReadings:
        """What is known now."""
        tension, raw, age = (np.full(self._tendons, value) for value in (np.nan, np.nan, np.inf))
        trouble, fitted = [""] * self._tendons, np.zeros(self._tendons, dtype=bool)
        now = self._clock.now()
        for cell in self._cells:
            i, fitted[cell.tendon] = cell.tendon, True
            raw[i], age[i] = cell.reading_N, now - cell.heard_s
            trouble[i] = self._trouble(cell, now)
            if not trouble[i] and cell.calibration is not None:
                tension[i] = _tension(cell.calibration, cell.reading_N)
        return CellReadings(tension=tension, raw=raw, age=age, trouble=tuple(trouble), fitted=fitted)

    def _hear(self, cell: _Cell, reading_N: float) -> None:
        now = cell.heard_s = self._clock.now()
        if reading_N == cell.reading_N:
            cell.alike += 1
        else:
            cell.alike, cell.alike_since_s = 0, now
        low, high = cell.ends
        cell.saturated = not low < reading_N < high
        cell.reading_N = reading_N

    def _trouble(self, cell: _Cell, now: float) -> str:
        age, described = now - cell.heard_s, cell.described
        if math.isinf(age):
            return "nothing was heard from it yet: check its power, cable and frame_id"
        if age > max(STALE_PERIODS / described.rate_Hz, STALE_S):
            return "silent: check its cable and power"
        if cell.saturated:
            return "at the end of its range: overloaded, or a wire is broken"
        noisy = described.noise_N > described.scale_N
        if noisy and cell.alike >= STUCK_READINGS and now - cell.alike_since_s >= STUCK_S:
            return "its reading does not change any more: check its amplifier"
        if cell.calibration is None:
            return f"not tared yet: slacken its tendon and {MENDED_BY_TARING}"
        least = -max(BELOW_NOTHING * self._highest_N, BELOW_NOTHING_N)
        if (tension := _tension(cell.calibration, cell.reading_N)) < least:
            return (
                f"reads {tension:.1f} N, which no tendon can: slacken it and {MENDED_BY_TARING}, or look at its wires"
            )
        return ""


def _tension(calibration: CellCalibration, reading_N: float) -> float:
    return calibration.gain * (reading_N - calibration.offset_N)


def _ends(cell: LoadCell) -> tuple[float, float]:
    """Readings [N] at and beyond which it is saturated."""
    form = FORMATS[cell.type][1]
    low, high = INTEGER_LIMITS.get(form, (-math.inf, math.inf))
    # An unsigned reading of nothing is no end: that is where a slack tendon may be.
    low_N = -math.inf if low == 0 else low * cell.scale_N
    high_N = high * cell.scale_N
    limit = cell.limit_N if cell.limit_N is not None else math.inf
    return max(low_N, -limit), min(high_N, limit)
