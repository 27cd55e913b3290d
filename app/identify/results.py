"""How identified numbers are shown and kept."""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

from cobra.errors import OperatorError
from cobra.mechanics.estimates import Estimate
from cobra.mechanics.toml_text import toml_text

DOTS_A_INCH = 120
VAGUE = 2.0
"""An interval wider than this many times the number, or than the scale on which it matters, does not tell it."""


class Row(NamedTuple):
    """A line of a table."""

    estimate: Estimate
    unit: str
    scale: float | None = None
    """What counts as large; None: the number itself."""


def shown(estimate: Estimate, scale: float | None = None) -> str:
    """The interval in words."""
    width = estimate.high - estimate.low
    if width > (VAGUE * abs(estimate.value) if scale is None else scale):
        return f"{estimate.low:.3g} … {estimate.high:.3g}: the data cannot tell"
    return f"{estimate.low:.4g} … {estimate.high:.4g}"


def estimates_table(rows: Mapping[str, Row]) -> Table:
    """One line a number, by name."""
    table = Table("", "value", "95 % interval", "unit")
    for name, row in rows.items():
        table.add_row(name, f"{row.estimate.value:.5g}", shown(row.estimate, row.scale), row.unit)
    return table


def tell_skipped(console: Console, source: str, skipped: tuple[str, ...]) -> None:
    """Which rows were left out, and why."""
    for reason in skipped:
        console.print(f"{source}: left out {reason}", style="yellow", highlight=False, markup=False)


def robot_table(numbers: Mapping[str, float], source: str) -> str:
    """Identified numbers as the [robot] table of a load case for `cobra-teleop simulate`."""
    return f"# Identified from {source}. Belongs into a case of `cobra-teleop simulate`.\n" + toml_text(
        {"robot": numbers}
    )


def write(console: Console, folder: Path, texts: Mapping[str, str], figures: Mapping[str, Figure]) -> None:
    """Write files and pictures, and say so.

    Raises:
        OperatorError: the folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in texts.items():
            (folder / name).write_text(text, "utf-8")
        for name, figure in figures.items():
            figure.savefig(folder / name, dpi=DOTS_A_INCH)
    except OSError as error:
        raise OperatorError(
            f"{error.filename or folder}: cannot be written ({error.strerror or error}); choose another --out"
        ) from None
    console.print(f"wrote {', '.join([*texts, *figures])} to {folder}", highlight=False, markup=False)
