"""Measured trajectories of guiders, read from CSV, beside a simulated motion."""

import csv
import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cobra.errors import OperatorError
from cobra.mechanics.chain import Floats, SrcBotParameters
from cobra.mechanics.dynamics import Motion

COLUMN = re.compile(r"(?:([xyz])(\d+)_(mm|m)|tilt_([xy])(\d+)_(deg|rad))\Z")
"""x3_mm: position of guider 3; tilt_x3_deg: tilt of its axis towards x. As the simulation writes them."""
OURS = re.compile(
    r"(bend_[xy]|twist|length|locked)\d+(_deg|_m)?\Z|cable\d+_(top_N|motor_N|length_m)\Z|load_[xyz]\d+_N\Z"
)
"""Columns that a simulation writes besides these; they are passed over."""
FARTHEST = 3.0
NEAREST = 0.01
"""Positions beyond the first, or all under the second, in lengths of the robot, are in another unit than declared."""


class MeasuredError(OperatorError):
    """A recording that cannot be used. The message names file, row and column."""


@dataclass(frozen=True)
class Measured:
    """Positions and tilts of guiders over time; NaN where the recording has no such column."""

    name: str
    time_s: Floats
    """(m,)"""
    positions_m: Floats
    """(m, n, 3)"""
    tilt_rad: Floats
    """(m, n, 2)"""
    skipped: int
    """Rows left out on request."""


@dataclass(frozen=True)
class Difference:
    """Measured minus simulated, as the paper gives its errors, at the measured times within the simulated ones."""

    time_s: Floats
    positions_m: Floats
    """(m, n, 3)"""
    tilt_rad: Floats
    """(m, n, 2)"""


def read_measured(path: Path, parameters: SrcBotParameters, *, skip_bad_rows: bool = False) -> Measured:
    """Read a CSV with a column time_s and some of x1_mm, y1_mm, z1_mm, tilt_x1_deg, tilt_y1_deg, … (or _m, _rad).

    Raises:
        MeasuredError: a column is missing, unknown or given twice, values are not in the declared unit, or a row is short,
            not a finite number or repeats a time, unless such rows are to be skipped.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.reader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise MeasuredError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})") from None
    if not rows:
        raise MeasuredError(f"{path}: is empty; it must begin with a row of column names")
    names = [name.strip() for name in rows[0]]
    places = _places(path, names, parameters.segments)
    good: list[list[float]] = []
    skipped = 0
    for number, row in enumerate(rows[1:], start=2):
        try:
            values = _numbers(names, row)
            time = values[names.index("time_s")]
            if good and time <= good[-1][names.index("time_s")]:
                raise ValueError(
                    f"time_s = {time:g} does not follow {good[-1][names.index('time_s')]:g}; times must increase"
                )
            good.append(values)
        except ValueError as error:
            if not skip_bad_rows:
                raise MeasuredError(f"{path}: row {number}: {error}") from None
            skipped += 1
    if not good:
        raise MeasuredError(f"{path}: has no usable row below its column names")
    table = np.array(good)
    positions = np.full((len(table), parameters.segments, 3), np.nan)
    tilts = np.full((len(table), parameters.segments, 2), np.nan)
    for name, (angle, guider, axis, scale) in places.items():
        column = table[:, names.index(name)] * scale
        if not angle:
            _check_unit(path, name, column, parameters)
        (tilts if angle else positions)[:, guider, axis] = column
    return Measured(path.name, table[:, names.index("time_s")], positions, tilts, skipped)


def difference(motion: Motion, measured: Measured) -> Difference:
    """Measured minus simulated, the motion interpolated at the measured times.

    Raises:
        MeasuredError: no measured time lies within the motion.
    """
    inside = (measured.time_s >= motion.time_s[0]) & (measured.time_s <= motion.time_s[-1])
    if not inside.any():
        raise MeasuredError(
            f"{measured.name}: covers {measured.time_s[0]:g} to {measured.time_s[-1]:g} s, "
            f"the case {motion.time_s[0]:g} to {motion.time_s[-1]:g} s"
        )
    time = measured.time_s[inside]
    positions = _at(time, motion.time_s, motion.positions_m[:, 1:])
    tilts = _at(time, motion.time_s, motion.tilt_rad[:, 1:])
    return Difference(time, measured.positions_m[inside] - positions, measured.tilt_rad[inside] - tilts)


def _at(time: Floats, times: Floats, values: Floats) -> Floats:
    flat = values.reshape(len(values), -1)
    return np.stack([np.interp(time, times, column) for column in flat.T], axis=-1).reshape(
        len(time), *values.shape[1:]
    )


def _places(path: Path, names: list[str], n: int) -> dict[str, tuple[bool, int, int, float]]:
    """Column → (is an angle, guider, axis, factor to SI)."""
    if "time_s" not in names:
        raise MeasuredError(f"{path}: column time_s is missing; there are {', '.join(names)}")
    places: dict[str, tuple[bool, int, int, float]] = {}
    for name in names:
        if (name == "time_s" and names.count(name) == 1) or OURS.match(name):
            continue
        found = COLUMN.match(name)
        if found is None or not 1 <= int(found[2] or found[5]) <= n:
            raise MeasuredError(
                f"{path}: column {name!r} is unknown; there may be time_s and, for the guiders 1 to {n}, "
                "x1_mm, y1_mm, z1_mm, tilt_x1_deg, tilt_y1_deg, … (or _m and _rad)"
            )
        angle = found[1] is None
        place = (angle, int(found[2] or found[5]) - 1, "xyz".index(found[1] or found[4]))
        if any(place == other[:3] for other in places.values()):
            raise MeasuredError(f"{path}: column {name!r} is there twice")
        places[name] = (*place, {"mm": 1e-3, "m": 1.0, "deg": math.pi / 180.0, "rad": 1.0}[found[3] or found[6]])
    if not places:
        raise MeasuredError(f"{path}: has no column of a guider, such as x{n}_mm or tilt_x{n}_deg")
    return places


def _numbers(names: list[str], row: list[str]) -> list[float]:
    if len(row) != len(names):
        raise ValueError(f"has {len(row)} values for {len(names)} columns")
    values = []
    for name, text in zip(names, row, strict=True):
        if OURS.match(name):
            values.append(math.nan)
            continue
        try:
            value = float(text)
        except ValueError:
            raise ValueError(f"{name} = {text!r} is not a number") from None
        if not math.isfinite(value):
            raise ValueError(f"{name} = {text} is not a finite number")
        values.append(value)
    return values


def _check_unit(path: Path, name: str, column: Floats, parameters: SrcBotParameters) -> None:
    reach = parameters.segments * parameters.rest_length_m
    largest = float(np.abs(column).max())
    if largest > FARTHEST * reach:
        raise MeasuredError(
            f"{path}: column {name} reaches {largest:.4g} m, but the robot is {reach:.4g} m long; is it in another unit?"
        )
    if name.startswith("z") and name.endswith("_mm") and largest < NEAREST * reach:
        raise MeasuredError(f"{path}: column {name} stays under {largest * 1e3:.3g} mm; is it in metres?")
