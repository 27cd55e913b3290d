"""Numbers from a CSV with named columns. Whatever is wrong is told with file, row and column; rows are left out only on request."""

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cobra.errors import OperatorError

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

MIXED = 1000.0
MIXED_APART = 30.0
"""A row in another unit is this many times larger or smaller than is usual,"""
MIXED_FIT = 0.5
"""and scaled by a thousand it is nearer to its neighbours, to this share of how far off it was."""


class RecordingError(OperatorError):
    """A recording that cannot be used. The message names file, row and column, and what would be right."""


@dataclass(frozen=True)
class Table:
    """Columns of a CSV, all of one length."""

    source: str
    numbers: dict[str, Floats]
    text: dict[str, tuple[str, ...]]
    rows: Indices
    """Row of the file in which each entry stands; the column names are row 1."""
    skipped: tuple[str, ...]
    """Why each row was left out."""


def read_table(
    path: Path,
    numbers: Sequence[str],
    *,
    text: Sequence[str] = (),
    increasing: str | None = None,
    skip_bad_rows: bool = False,
) -> Table:
    """Read the named columns; others are passed over.

    Values of the column `increasing` (time) must grow from row to row.

    Raises:
        RecordingError: the file cannot be read, has no rows, or lacks a column; or a row is short, has something other
            than a finite number, or repeats or goes back in time, unless such rows are to be skipped.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            lines = [(number, row) for number, row in enumerate(csv.reader(file), start=1) if row]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise RecordingError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})") from None
    if not lines:
        raise RecordingError(f"{path}: is empty; it must begin with a row of column names")
    header = [name.strip() for name in lines[0][1]]
    places = _places(path, header, [*numbers, *text])
    kept: list[tuple[int, list[float], list[str]]] = []
    skipped: list[str] = []
    for number, row in lines[1:]:
        try:
            values = _numbers(header, row, [(name, places[name]) for name in numbers])
            if increasing is not None and kept:
                _check_order(increasing, values[numbers.index(increasing)], *_last(kept, numbers.index(increasing)))
        except ValueError as error:
            if not skip_bad_rows:
                raise RecordingError(f"{path}: row {number}: {error}") from None
            skipped.append(f"row {number}: {error}")
            continue
        kept.append((number, values, [row[places[name]].strip() for name in text]))
    if not kept:
        raise RecordingError(f"{path}: has no usable row below its column names")
    table = np.array([values for _, values, _ in kept], dtype=np.float64).reshape(len(kept), len(numbers))
    return Table(
        str(path),
        {name: table[:, i] for i, name in enumerate(numbers)},
        {name: tuple(words[i] for _, _, words in kept) for i, name in enumerate(text)},
        np.array([number for number, _, _ in kept], dtype=np.int64),
        tuple(skipped),
    )


def read_quantities(
    path: Path,
    wanted: Mapping[str, Mapping[str, float]],
    *,
    text: Sequence[str] = (),
    increasing: str | None = None,
    skip_bad_rows: bool = False,
) -> tuple[Table, dict[str, str]]:
    """Read columns whose names end with their unit (time_s, angle_deg) in SI units, under their names without it.

    `wanted` maps such a name to its units and their factors to SI. Also returns the name of each column as it stands in
    the file.

    Raises:
        RecordingError: as `read_table`; also where a quantity has no column, or one in each of two units.
    """
    header = column_names(path)
    columns = {name: with_unit(path, header, name, tuple(units)) for name, units in wanted.items()}
    table = read_table(
        path,
        tuple(columns.values()),
        text=text,
        increasing=None if increasing is None else columns[increasing],
        skip_bad_rows=skip_bad_rows,
    )
    scaled = {
        name: table.numbers[column] * wanted[name][column.removeprefix(f"{name}_")] for name, column in columns.items()
    }
    return replace(table, numbers=scaled), columns


def column_names(path: Path) -> tuple[str, ...]:
    """The first row of a CSV.

    Raises:
        RecordingError: the file cannot be read, or is empty.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            return tuple(name.strip() for name in next(csv.reader(file), ()))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise RecordingError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})") from None


def with_unit(path: Path, header: Sequence[str], name: str, units: Sequence[str]) -> str:
    """The column of the header that is the name with one of the units.

    Raises:
        RecordingError: there is none, or more than one.
    """
    found = [f"{name}_{unit}" for unit in units if f"{name}_{unit}" in header]
    if not found:
        raise RecordingError(
            f"{path}: column {' or '.join(repr(f'{name}_{unit}') for unit in units)} is missing; "
            f"there are {', '.join(header) or 'none'}"
        )
    if len(found) > 1:
        raise RecordingError(f"{path}: has columns {' and '.join(map(repr, found))}; give one of them")
    return found[0]


def rows_in_another_unit(what: str, unit: str, values: Floats, jump: float) -> dict[int, str]:
    """Rows of values (N, d) that jump by more than `jump` away from the motion so far, and fit it once scaled by a
    thousand: a row in metres among rows in millimetres, or the reverse."""
    size = np.linalg.norm(values, axis=-1)
    usual = float(np.quantile(size, 0.9))
    faults: dict[int, str] = {}
    # From a row of usual size both ways, so that a first row in another unit does not accuse all others.
    start = int(np.argmin(np.abs(size - np.median(size))))
    for order in (range(start, len(values)), range(start, -1, -1)):
        last, trend = values[start], np.zeros(values.shape[1])
        for i in order:
            value = values[i]
            off = min(float(np.linalg.norm(value - last)), float(np.linalg.norm(value - last - trend)))
            scale = MIXED if size[i] < usual / MIXED_APART else 1.0 / MIXED if size[i] > usual * MIXED_APART else 1.0
            after = values[min(max(i + order.step, 0), len(values) - 1)]
            if scale != 1.0 and off > jump and _from_segment(scale * value, last, after) < MIXED_FIT * off:
                faults[i] = f"{what} fits its neighbours only when multiplied by {scale:g}; is this row not in {unit}?"
            else:
                last, trend = value, value - last
    return faults


def _from_segment(point: Floats, a: Floats, b: Floats) -> float:
    along = b - a
    length2 = float(along @ along)
    share = min(max(float((point - a) @ along) / length2, 0.0), 1.0) if length2 > 0.0 else 0.0
    return float(np.linalg.norm(point - a - share * along))


def first_fault(path: Path, table: Table, faults: Mapping[int, str]) -> RecordingError:
    """The error that names the first of some faulty entries of a table."""
    i = min(faults)
    return RecordingError(f"{path}: row {table.rows[i]}: {faults[i]}")


def without(table: Table, faults: Mapping[int, str]) -> Table:
    """The table without some faulty entries."""
    keep = [i for i in range(len(table.rows)) if i not in faults]
    return Table(
        table.source,
        {name: column[keep] for name, column in table.numbers.items()},
        {name: tuple(words[i] for i in keep) for name, words in table.text.items()},
        table.rows[keep],
        (*table.skipped, *(f"row {table.rows[i]}: {faults[i]}" for i in sorted(faults))),
    )


def _places(path: Path, header: list[str], wanted: list[str]) -> dict[str, int]:
    missing = [name for name in wanted if name not in header]
    if missing:
        which = f"column {missing[0]!r} is" if len(missing) == 1 else f"columns {', '.join(map(repr, missing))} are"
        raise RecordingError(f"{path}: {which} missing; there are {', '.join(header)}")
    twice = [name for name in wanted if header.count(name) > 1]
    if twice:
        raise RecordingError(f"{path}: column {twice[0]!r} is there {header.count(twice[0])} times; once is needed")
    return {name: header.index(name) for name in wanted}


def _numbers(header: list[str], row: list[str], wanted: list[tuple[str, int]]) -> list[float]:
    if len(row) != len(header):
        raise ValueError(f"has {len(row)} values for {len(header)} columns")
    values = []
    for name, place in wanted:
        try:
            value = float(row[place])
        except ValueError:
            raise ValueError(f"{name} = {row[place]!r} is not a number") from None
        if not math.isfinite(value):
            raise ValueError(f"{name} = {row[place].strip()} is not a finite number")
        values.append(value)
    return values


def _last(kept: list[tuple[int, list[float], list[str]]], place: int) -> tuple[float, int]:
    number, values, _ = kept[-1]
    return values[place], number


def _check_order(name: str, value: float, before: float, number: int) -> None:
    if value <= before:
        what = "repeats" if value == before else "goes back behind"
        raise ValueError(f"{name} = {value!r} {what} row {number} ({before!r}); it must increase from row to row")
