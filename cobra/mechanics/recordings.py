"""Recordings for calibration: motor positions against measured tip poses, from a CSV and a map of its columns."""

import math
import tomllib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta

from cobra.description import RobotDescription
from cobra.mechanics.tables import (
    Floats,
    Indices,
    RecordingError,
    Table,
    column_names,
    first_fault,
    read_table,
    rows_in_another_unit,
    with_unit,
    without,
)

LENGTH_UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}
ANGLE_UNITS = {"rad": 1.0, "deg": math.pi / 180.0}
TIME_UNITS = {"s": 1.0, "ms": 1e-3}
FARTHEST = 2.5
"""Tips farther apart than this many lengths of the robot are in another unit than declared."""
NEAREST = 0.005
"""So are tips that all stay within this share of its length."""
LEAST_TRAVEL = 0.02
"""And tendons that all stay within this share of their radius."""
JUMP = 0.1
"""A row in metres among rows in millimetres jumps by at least this share of the robot's length (or of all travel)."""
BLOCK_ROWS = 25
"""Rows of a block where the recording names none."""
UNIT_QUATERNION = 0.05


class ColumnMap(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Which column of a recording means what, and in which unit."""

    time: str
    time_unit: Literal["s", "ms"] = "s"
    tendons: Annotated[tuple[tuple[str, ...], ...], Meta(min_length=1)]
    """Columns of each section's tendons, base section first, in the order of the description's names."""
    travel_unit: Literal["m", "cm", "mm", "in", "rad", "deg"]
    """Of the tendon's travel, or of the motor's output shaft."""
    travel_positive: Literal["wound-in", "paid-out", "unknown"]
    """Unknown: the calibration finds out."""
    tip: tuple[str, str, str]
    tip_unit: Literal["m", "cm", "mm", "in"]
    tip_quaternion: tuple[str, str, str, str] | None = None
    """w, x, y, z."""
    block: str | None = None
    """Names the motion to which a row belongs."""


@dataclass(frozen=True)
class Recording:
    """N samples in the order in which they were taken."""

    source: str
    time_s: Floats
    """(N,)"""
    paid_out_m: Floats
    """(N, tendons) travel of each tendon; wound in is negative."""
    sign_known: bool
    """False: the travel of all tendons may have the other sign."""
    of_shafts: bool
    """The travel was given as angles of the drives' shafts."""
    tip_m: Floats
    """(N, 3) in the frame of the measurement."""
    tip_wxyz: Floats | None
    """(N, 4)"""
    block: Indices
    """(N,) index of the contiguous block (one motion) to which a sample belongs."""
    block_names: tuple[str, ...]
    rows: Indices
    """(N,) row of the file."""
    skipped: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.time_s)


def conventional_columns(path: Path, description: RobotDescription) -> ColumnMap:
    """The map of a recording whose columns are named as this program names things.

    time_s (or _ms); each tendon by its name with a unit, as S1_mm for travel or S1_rad for the drive's shaft, paid out or
    turned as the description counts it; tip_x_mm, tip_y_mm, tip_z_mm; if there, tip_qw, tip_qx, tip_qy, tip_qz and motion.

    Raises:
        RecordingError: the file cannot be read, or a column is missing or there in two units.
    """
    header = column_names(path)

    def one_unit(names: tuple[str, ...], units: tuple[str, ...]) -> tuple[tuple[str, ...], str]:
        found = [with_unit(path, header, name, units) for name in names]
        unit = found[0].removeprefix(f"{names[0]}_")
        for name, column in zip(names, found, strict=True):
            if column != f"{name}_{unit}":
                raise RecordingError(f"{path}: column {column!r} is in another unit than {found[0]!r}; give one unit")
        return tuple(found), unit

    (time,), time_unit = one_unit(("time",), tuple(TIME_UNITS))
    tendons, travel_unit = one_unit(description.tendon_names, (*LENGTH_UNITS, *ANGLE_UNITS))
    tip, tip_unit = one_unit(("tip_x", "tip_y", "tip_z"), tuple(LENGTH_UNITS))
    quaternion = ("tip_qw", "tip_qx", "tip_qy", "tip_qz")
    groups, at = [], 0
    for section in description.sections:
        if section.routing is not None:
            count = len(section.routing.names)
            groups.append(tendons[at : at + count])
            at += count
    return msgspec.convert(
        {
            "time": time,
            "time_unit": time_unit,
            "tendons": groups,
            "travel_unit": travel_unit,
            "travel_positive": "paid-out",
            "tip": tip,
            "tip_unit": tip_unit,
            "tip_quaternion": quaternion if any(name in header for name in quaternion) else None,
            "block": "motion" if "motion" in header else None,
        },
        ColumnMap,
    )


def load_columns(path: Path) -> ColumnMap:
    """Read a map of columns from TOML.

    Raises:
        RecordingError: the file cannot be read, or a key is unknown, missing or of the wrong kind.
    """
    try:
        tree = tomllib.loads(path.read_text("utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise RecordingError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})") from None
    try:
        return msgspec.convert(tree, ColumnMap)
    except msgspec.ValidationError as error:
        known = ", ".join(ColumnMap.__struct_fields__)
        raise RecordingError(f"{path}: {error}; the keys are {known}") from None


def read_recording(
    path: Path, columns: ColumnMap, description: RobotDescription, *, skip_bad_rows: bool = False
) -> Recording:
    """Read a recording of the described robot.

    Raises:
        RecordingError: as `read_table`; also where the columns do not fit the robot or values the declared unit.
    """
    names = _tendon_columns(columns, description)
    quaternion = columns.tip_quaternion or ()
    table = read_table(
        path,
        [columns.time, *names, *columns.tip, *quaternion],
        text=[columns.block] if columns.block else [],
        increasing=columns.time,
        skip_bad_rows=skip_bad_rows,
    )
    travel = np.stack([table.numbers[name] for name in names], axis=-1) * _travel_scale(columns, description)
    tip = np.stack([table.numbers[name] for name in columns.tip], axis=-1) * LENGTH_UNITS[columns.tip_unit]
    wxyz = np.stack([table.numbers[name] for name in quaternion], axis=-1) if quaternion else None
    faults = _faults(columns, description, travel, tip, wxyz)
    if faults and not skip_bad_rows:
        raise first_fault(path, table, faults)
    keep = np.array([i for i in range(len(tip)) if i not in faults], dtype=np.int64)
    table = without(table, faults)
    _check_units(str(path), columns, description, travel[keep], tip[keep])
    block, block_names = _blocks(table, columns)
    return Recording(
        source=path.name,
        time_s=table.numbers[columns.time] * TIME_UNITS[columns.time_unit],
        paid_out_m=(-travel if columns.travel_positive == "wound-in" else travel)[keep],
        sign_known=columns.travel_positive != "unknown",
        of_shafts=columns.travel_unit in ANGLE_UNITS,
        tip_m=tip[keep],
        tip_wxyz=None if wxyz is None else (wxyz / np.linalg.norm(wxyz, axis=-1, keepdims=True))[keep],
        block=block,
        block_names=block_names,
        rows=table.rows,
        skipped=table.skipped,
    )


def thinned(recording: Recording, most: int) -> Recording:
    """Every k-th sample, so that at most `most` are left; the recording itself where it is no longer."""
    step = -(-len(recording) // most)
    if step <= 1:
        return recording
    kept = recording.block[::step]
    present, block = np.unique(kept, return_inverse=True)
    return replace(
        recording,
        time_s=recording.time_s[::step],
        paid_out_m=recording.paid_out_m[::step],
        tip_m=recording.tip_m[::step],
        tip_wxyz=None if recording.tip_wxyz is None else recording.tip_wxyz[::step],
        block=block.astype(np.int64),
        block_names=tuple(recording.block_names[i] for i in present),
        rows=recording.rows[::step],
    )


def _tendon_columns(columns: ColumnMap, description: RobotDescription) -> list[str]:
    routings = [section.routing for section in description.sections if section.routing is not None]
    wanted = [len(routing.names) for routing in routings]
    given = [len(group) for group in columns.tendons]
    if given != wanted:
        raise RecordingError(
            f"tendons: the map of columns has {given} columns a section, but {description.name} has {wanted} tendons: "
            + "; ".join(", ".join(routing.names) for routing in routings)
        )
    return [name for group in columns.tendons for name in group]


def _travel_scale(columns: ColumnMap, description: RobotDescription) -> Floats:
    if columns.travel_unit in LENGTH_UNITS:
        return np.full(len(description.tendon_names), LENGTH_UNITS[columns.travel_unit])
    drives = [description.drives[i] for i in description.tendon_drives]
    return np.array([drive.travel_per_rad for drive in drives]) * ANGLE_UNITS[columns.travel_unit]


def _blocks(table: Table, columns: ColumnMap) -> tuple[Indices, tuple[str, ...]]:
    """A new block begins wherever the name changes, so that a motion done twice is two blocks."""
    if columns.block is None:
        block = np.arange(len(table.rows)) // BLOCK_ROWS
        return block.astype(np.int64), tuple(f"from row {row}" for row in table.rows[::BLOCK_ROWS])
    labels = np.array(table.text[columns.block])
    begins = np.concatenate([[True], labels[1:] != labels[:-1]])
    return (np.cumsum(begins) - 1).astype(np.int64), tuple(str(label) for label in labels[begins])


def _faults(
    columns: ColumnMap, description: RobotDescription, travel: Floats, tip: Floats, wxyz: Floats | None
) -> dict[int, str]:
    """Rows that cannot be right, and why."""
    tendons = ", ".join(name for group in columns.tendons for name in group)
    what = f"the tip ({', '.join(columns.tip)})"
    faults = rows_in_another_unit(what, columns.tip_unit, tip, JUMP * description.active_length_m)
    moved = float(np.ptp(travel, axis=0).max())
    faults |= rows_in_another_unit(f"the travel ({tendons})", columns.travel_unit, travel, JUMP * moved)
    if wxyz is not None:
        norm = np.linalg.norm(wxyz, axis=-1)
        for i in np.flatnonzero(np.abs(norm - 1.0) > UNIT_QUATERNION):
            faults[int(i)] = (
                f"{', '.join(columns.tip_quaternion or ())} is no unit quaternion (its norm is {norm[i]:.3g})"
            )
    return faults


def _check_units(source: str, columns: ColumnMap, description: RobotDescription, travel: Floats, tip: Floats) -> None:
    length = description.active_length_m
    radius = min(section.routing.radius_m for section in description.sections if section.routing)
    moved = float(np.ptp(travel, axis=0).max())
    reach = float(np.linalg.norm(tip - np.median(tip, axis=0), axis=-1).max())
    tips = f"the tip ({', '.join(columns.tip)})"
    tendons = f"the tendons ({', '.join(name for group in columns.tendons for name in group)})"
    robot = f"{description.name} is {length:.4g} m long"
    complaints = {
        f"{tips} moves {reach:.4g} m from its middle, but {robot}; is it in {columns.tip_unit}?": reach
        > FARTHEST * length,
        f"{tips} stays within {reach:.3g} m of its middle, but {robot}; is it in {columns.tip_unit}?": reach
        < NEAREST * length,
        f"{tendons} travel {moved:.4g} m, but {robot}; are they in {columns.travel_unit}?": moved > length,
        f"{tendons} travel at most {moved:.3g} m at {radius:.3g} m from the backbone; are they in {columns.travel_unit}?": (
            moved < LEAST_TRAVEL * radius
        ),
    }
    for complaint, true in complaints.items():
        if true:
            raise RecordingError(f"{source}: {complaint}")
