"""Equivalent stiffness from load tests (S-38), drawn as figure 8 of the SRC-Bot paper."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table as Shown

from app.identify.figures import stiffness_figure
from app.identify.results import robot_table, shown, tell_skipped, write
from cobra.errors import OperatorError
from cobra.mechanics.identification import (
    SYMBOLS,
    Quantity,
    StiffnessTest,
    points_in_another_unit,
    stiffness_from_load_test,
)
from cobra.mechanics.tables import (
    Floats,
    Indices,
    RecordingError,
    Table,
    column_names,
    first_fault,
    read_quantities,
    without,
)

MOMENT = {"Nm": 1.0, "Nmm": 1e-3}
ANGLE = {"deg": math.pi / 180.0, "rad": 1.0}
FORCE = {"N": 1.0}
LENGTH = {"mm": 1e-3, "m": 1.0}
COLUMNS: Mapping[Quantity, tuple[tuple[str, Mapping[str, float]], tuple[str, Mapping[str, float]]]] = {
    "bending": (("moment", MOMENT), ("angle", ANGLE)),
    "torsion": (("moment", MOMENT), ("angle", ANGLE)),
    "elongation": (("force", FORCE), ("elongation", LENGTH)),
}
KEYS: Mapping[Quantity, str] = {
    "bending": "bending_stiffness_Nm2",
    "torsion": "torsional_stiffness_Nm2",
    "elongation": "axial_stiffness_N_m",
}
LARGEST_ANGLE = 2.0 * math.pi
SETS_SHOWN = 12


@dataclass(frozen=True)
class Measured:
    """A load test as it was measured, and what came out."""

    result: StiffnessTest
    load: Floats
    """(N,) [N·m or N]"""
    deflection: Floats
    """(N,) [rad or m]"""
    group: Indices
    """(N,) index of the set"""


def identify_stiffness(
    tests: Mapping[Quantity, Path],
    *,
    rest_length_mm: float | None,
    out: Path,
    skip_bad_rows: bool,
    console: Console | None = None,
) -> int:
    """The body of `cobra-teleop identify stiffness`.

    Raises:
        OperatorError: no test is given, or one cannot be used.
    """
    console = console or Console()
    if not tests:
        raise OperatorError("give at least one load test: --bending, --torsion or --elongation with a CSV")
    if any(quantity != "elongation" for quantity in tests) and rest_length_mm is None:
        raise OperatorError(
            "bending and torsion need --rest-length-mm, the natural length L0 of what was loaded (S-38)"
        )
    if rest_length_mm is not None and not (math.isfinite(rest_length_mm) and rest_length_mm > 0.0):
        raise OperatorError(f"--rest-length-mm {rest_length_mm:g}: must be positive")
    measured = {
        quantity: _measure(console, quantity, path, (rest_length_mm or 1.0) * 1e-3, skip_bad_rows)
        for quantity, path in tests.items()
    }
    table = Shown("", "value", "95 % interval", "unit", "from", "lines leave")
    for test in measured.values():
        result = test.result
        symbol, unit = SYMBOLS[result.quantity]
        count = len(result.set_names)
        table.add_row(
            f"{result.quantity} {symbol}",
            f"{result.stiffness.value:.5g}",
            shown(result.stiffness),
            unit,
            f"{count} sets" if count > 1 else "one line",
            f"{100.0 * result.nonlinearity:.1f} % of the largest load",
        )
        for name, value in (
            [*zip(result.set_names, result.set_stiffness, strict=True)][:SETS_SHOWN] if count > 1 else []
        ):
            table.add_row(f"  set {name}", f"{value:.5g}", "", unit, "", "")
    console.print(table)
    numbers = {KEYS[quantity]: test.result.stiffness.value for quantity, test in measured.items()}
    if rest_length_mm is not None:
        numbers["rest_length_m"] = rest_length_mm * 1e-3
    sources = ", ".join(path.name for path in tests.values())
    write(
        console,
        out,
        {"stiffness.toml": robot_table(numbers, sources)},
        {"stiffness.png": stiffness_figure([(m.result, m.load, m.deflection, m.group) for m in measured.values()])},
    )
    return 0


def _measure(console: Console, quantity: Quantity, path: Path, length_m: float, skip_bad_rows: bool) -> Measured:
    wanted = dict(COLUMNS[quantity])
    sets = ["set"] if "set" in column_names(path) else []
    table, columns = read_quantities(path, wanted, text=sets, skip_bad_rows=skip_bad_rows)
    load, deflection = wanted
    table = _usable(path, table, table.numbers[load], table.numbers[deflection], columns[deflection], skip_bad_rows)
    tell_skipped(console, path.name, table.skipped)
    f, x = table.numbers[load], table.numbers[deflection]
    names = np.array(table.text["set"]) if sets else np.full(len(f), "")
    result = stiffness_from_load_test(quantity, f, x, rest_length_m=length_m, sets=names)
    group = np.array([result.set_names.index(name) for name in names.tolist()], dtype=np.int64)
    return Measured(result, f, x, group)


def _usable(path: Path, table: Table, load: Floats, deflection: Floats, column: str, skip_bad_rows: bool) -> Table:
    if column == "angle_rad" and np.abs(deflection).max() > LARGEST_ANGLE:
        row = int(table.rows[np.argmax(np.abs(deflection))])
        raise RecordingError(
            f"{path}: row {row}: angle_rad = {np.abs(deflection).max():.4g} is more than a turn; is it in degrees?"
        )
    faults = {
        i: f"{reason}; is this row in the units of the column names?"
        for i, reason in points_in_another_unit(load, deflection).items()
    }
    if faults and not skip_bad_rows:
        raise first_fault(path, table, faults)
    return without(table, faults)
