"""Numbers from a CSV with named columns. Whatever is wrong is told with file, row and column; rows are left out only on request."""

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cobra.errors import OperatorError

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


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
