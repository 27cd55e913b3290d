"""Damping and friction from recorded motions: a release, a sweep back and forth, a cable through bent guiders."""

import math
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from rich.console import Console

from app.identify.figures import friction_figure, release_figure, sweep_figure
from app.identify.results import Row, estimates_table, robot_table, tell_skipped, write
from cobra.errors import OperatorError
from cobra.mechanics.identification import Quantity, fit_sweep, friction_in_guiders
from cobra.mechanics.release import coefficients, fit_release
from cobra.mechanics.tables import (
    Floats,
    RecordingError,
    Table,
    column_names,
    first_fault,
    read_quantities,
    rows_in_another_unit,
    with_unit,
    without,
)

TIME = {"s": 1.0, "ms": 1e-3}
ANGLE = {"deg": math.pi / 180.0, "rad": 1.0}
LENGTH = {"mm": 1e-3, "m": 1.0}
MOMENT = {"Nm": 1.0, "Nmm": 1e-3}
FORCE = {"N": 1.0}
JUMP = 0.1
"""A row in another unit jumps by at least this share of the whole motion."""
CHAMBER = re.compile(r"bend(\d+)_(deg|rad)\Z")
DIRECTIONS = {"in": True, "out": False}
DAMPING_KEYS: Mapping[Quantity, str] = {
    "bending": "damping_bend_Nms",
    "torsion": "damping_twist_Nms",
    "elongation": "damping_axial_Ns_m",
}


def identify_release(
    motion: Path,
    *,
    quantity: Quantity,
    stiffness: float | None,
    out: Path,
    skip_bad_rows: bool,
    console: Console | None = None,
) -> int:
    """The body of `cobra-teleop identify release`.

    Raises:
        OperatorError: the recording cannot be used, or the stiffness is not positive.
    """
    console = console or Console()
    if stiffness is not None and not (math.isfinite(stiffness) and stiffness > 0.0):
        raise OperatorError(f"--stiffness {stiffness:g}: must be positive")
    table, position = _motion(motion, quantity, {}, skip_bad_rows)
    tell_skipped(console, motion.name, table.skipped)
    time, x = table.numbers["time"], table.numbers[position]
    found = fit_release(time, x)
    unit, moment = ("m", "N") if quantity == "elongation" else ("rad", "N m")
    swing = float(np.ptp(x))
    rows = {
        "natural frequency": Row(found.natural_rad_s, "rad/s"),
        "damping ratio": Row(found.damping_ratio, ""),
        "friction band, half": Row(found.friction, unit, swing),
        "rest": Row(found.rest, unit, swing),
    }
    texts = {}
    if stiffness is not None:
        numbers = coefficients(found, stiffness)
        rows["damping"] = Row(numbers.damping, f"{moment} s/{unit}")
        rows["Coulomb friction"] = Row(numbers.friction, moment, stiffness * swing)
        texts["damping.toml"] = robot_table({DAMPING_KEYS[quantity]: numbers.damping.value}, motion.name)
    console.print(estimates_table(rows))
    if stiffness is None:
        console.print("with --stiffness (load per deflection) these become damping, friction and inertia")
    else:
        console.print(f"inertia {numbers.inertia:.5g} {'kg' if unit == 'm' else 'kg m2'}", highlight=False)
    write(console, out, texts, {"release.png": release_figure(time, x, found, unit)})
    return 0


def identify_sweep(
    motion: Path, *, quantity: Quantity, out: Path, skip_bad_rows: bool, console: Console | None = None
) -> int:
    """The body of `cobra-teleop identify sweep`.

    Raises:
        OperatorError: the recording cannot be used.
    """
    console = console or Console()
    load = ("force", FORCE) if quantity == "elongation" else ("moment", MOMENT)
    table, position = _motion(motion, quantity, dict([load]), skip_bad_rows)
    tell_skipped(console, motion.name, table.skipped)
    time, x, f = (table.numbers[name] for name in ("time", position, load[0]))
    found = fit_sweep(time, x, f)
    unit, moment = ("m", "N") if quantity == "elongation" else ("rad", "N m")
    range_of_load = float(np.ptp(f))
    rows = {
        "stiffness": Row(found.stiffness, f"{moment}/{unit}"),
        "damping": Row(found.damping, f"{moment} s/{unit}", range_of_load / float(np.abs(found.speed).max())),
        "Coulomb friction": Row(found.friction, moment, range_of_load),
        "load at zero": Row(found.offset, moment, range_of_load),
    }
    console.print(estimates_table(rows))
    texts = {}
    if found.damping.low > 0.0:
        texts["damping.toml"] = robot_table({DAMPING_KEYS[quantity]: found.damping.value}, motion.name)
    else:
        console.print("no damping shows; sweep at several speeds to see it")
    write(console, out, texts, {"sweep.png": sweep_figure(x, f, found, unit, moment)})
    return 0


def identify_cable_friction(recording: Path, *, out: Path, skip_bad_rows: bool, console: Console | None = None) -> int:
    """The body of `cobra-teleop identify cable-friction`.

    Raises:
        OperatorError: the recording cannot be used.
    """
    console = console or Console()
    header = column_names(recording)
    chambers = sorted({int(found[1]) for name in header if (found := CHAMBER.match(name))})
    if chambers != list(range(1, len(chambers) + 1)) or not chambers:
        with_unit(recording, header, f"bend{len(chambers) + 1 if chambers else 1}", tuple(ANGLE))
        raise RecordingError(f"{recording}: bends of chambers {chambers} are there; give all from bend1 on")
    bends = {f"bend{i}": ANGLE for i in chambers}
    table, _ = read_quantities(
        recording, {"motor": FORCE, "top": FORCE, **bends}, text=["moving"], skip_bad_rows=skip_bad_rows
    )
    faults = {
        i: f"moving = {word!r}; must be 'in' (towards the motor) or 'out'"
        for i, word in enumerate(table.text["moving"])
        if word not in DIRECTIONS
    }
    if faults and not skip_bad_rows:
        raise first_fault(recording, table, faults)
    table = without(table, faults)
    tell_skipped(console, recording.name, table.skipped)
    angles = np.stack([table.numbers[name] for name in bends], axis=-1)
    winding = np.array([DIRECTIONS[word] for word in table.text["moving"]], dtype=np.bool_)
    motor, top = table.numbers["motor"], table.numbers["top"]
    eta = friction_in_guiders(motor, top, angles, winding)
    console.print(estimates_table({"friction in the guiders' holes (eta)": Row(eta, "", 1.0)}))
    write(
        console,
        out,
        {"friction.toml": robot_table({"friction": eta.value}, recording.name)},
        {"cable-friction.png": friction_figure(motor, top, angles, winding, eta)},
    )
    return 0


def _motion(
    path: Path, quantity: Quantity, more: Mapping[str, Mapping[str, float]], skip_bad_rows: bool
) -> tuple[Table, str]:
    """Time, deflection and what else is wanted; the name of the deflection."""
    position, units = ("elongation", LENGTH) if quantity == "elongation" else ("angle", ANGLE)
    table, columns = read_quantities(
        path, {"time": TIME, position: units, **more}, increasing="time", skip_bad_rows=skip_bad_rows
    )
    faults = _faults(table, columns, position, units)
    if faults and not skip_bad_rows:
        raise first_fault(path, table, faults)
    return without(table, faults), position


def _faults(table: Table, columns: Mapping[str, str], position: str, units: Mapping[str, float]) -> dict[int, str]:
    x: Floats = table.numbers[position][:, None]
    column = columns[position]
    # Of most rows: a single one in another unit would stretch the range of all.
    usual = float(np.ptp(np.quantile(x, [0.02, 0.98])))
    unit = column.removeprefix(f"{position}_")
    return rows_in_another_unit(column, unit, x, JUMP * usual) if unit in units and usual > 0.0 else {}
