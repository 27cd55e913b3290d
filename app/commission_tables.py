"""What commissioning finds, as tables for a terminal."""

import math
from collections.abc import Iterator

import numpy as np

from cobra.description import RobotDescription
from cobra.mechanics.losses import Losses
from cobra.motors.commissioning.procedure import Seen
from cobra.motors.commissioning.survey import PROTOCOL_TITLES, Found
from cobra.motors.transmission import Transmission

SCAN_COLUMNS = ("bus", "id", "drive", "protocol", "model", "firmware", "temperature", "supply", "errors")
CELL_COLUMNS = ("tendon", "cell", "current", "apart", "cell's state")


def scan_table(found: list[Found]) -> Iterator[str]:
    """Who answered, a line a motor."""
    return _lines([SCAN_COLUMNS, *(_row(item) for item in found)])


def cell_table(description: RobotDescription, seen: Seen) -> Iterator[str]:
    """Load cells beside the currents of drives that wound in last, as homing leaves them; nothing without cells."""
    cells = seen.feedback.cells
    fitted = np.flatnonzero(cells.fitted)
    if not len(fitted):
        return
    index = np.array(description.tendon_drives, dtype=np.intp)
    # What winds in bears its gear's friction on top of the tension.
    drawn_in = Transmission(description).load(seen.feedback.current)[index]
    current = drawn_in - Losses.described(description).drive_friction_N
    rows: list[tuple[str, ...]] = [CELL_COLUMNS]
    for i in fitted.tolist():
        apart = cells.tension[i] - current[i]
        rows.append(
            (
                description.tendon_names[i],
                *("-" if math.isnan(value) else f"{value:.2f} N" for value in (cells.tension[i], current[i], apart)),
                cells.trouble[i] or "fine",
            )
        )
    yield from _lines(rows)


def _lines(rows: list[tuple[str, ...]]) -> Iterator[str]:
    widths = [max(len(row[i]) for row in rows) for i in range(len(rows[0]))]
    for row in rows:
        yield "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()


def _row(item: Found) -> tuple[str, ...]:
    motor = item.motor
    wrong = "; ".join(filter(None, (item.complaint, *motor.errors))) or "none"
    details = ", ".join(f"{name} {words}" for name, words in motor.details.items() if words)
    return (
        item.bus,
        str(motor.address),
        item.drive or "-",
        PROTOCOL_TITLES[motor.protocol],
        motor.model or "-",
        motor.firmware or "-",
        _known(motor.temperature_C, "°C"),
        _known(motor.voltage_V, "V"),
        f"{wrong} ({details})" if details else wrong,
    )


def _known(value: float, unit: str) -> str:
    return "-" if math.isnan(value) else f"{value:.4g} {unit}"
