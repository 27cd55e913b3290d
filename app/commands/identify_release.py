"""`cobra-teleop identify release`: damping and friction from a free release."""

from pathlib import Path
from typing import Annotated, Literal

import tyro

from app.commands.command import Command, FigureFolder, SkipBadRows


def identify_release(
    motion: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="CSV")],
    /,
    *,
    quantity: Annotated[
        Literal["bending", "torsion", "elongation"], tyro.conf.arg(help="What swings; elongation has a length.")
    ] = "bending",
    stiffness: Annotated[
        float | None,
        tyro.conf.arg(metavar="K", help="Load per deflection (N m/rad or N/m, as EI/L0): gives damping and inertia."),
    ] = None,
    out: FigureFolder = Path("identified"),
    skip_bad_rows: SkipBadRows = False,
) -> int:
    """Natural frequency, damping and friction from a part that is let go and swings until it rests.

    Args:
        motion: Columns time_s (or _ms) and angle_deg (or _rad), for elongation elongation_mm (or _m).
    """
    from app.identify.motions import identify_release as run

    return run(motion, quantity=quantity, stiffness=stiffness, out=out, skip_bad_rows=skip_bad_rows)


COMMAND = Command(
    "identify release",
    "damping and friction from a free release",
    identify_release,
    "  cobra-teleop identify release swing.csv --stiffness 2.0",
)
