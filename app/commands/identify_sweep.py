"""`cobra-teleop identify sweep`: stiffness, damping and friction from a sweep back and forth."""

from pathlib import Path
from typing import Annotated, Literal

import tyro

from app.commands.command import Command, FigureFolder, SkipBadRows


def identify_sweep(
    motion: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="CSV")],
    /,
    *,
    quantity: Annotated[
        Literal["bending", "torsion", "elongation"],
        tyro.conf.arg(help="What moves; elongation has a length and a force."),
    ] = "bending",
    out: FigureFolder = Path("identified"),
    skip_bad_rows: SkipBadRows = False,
) -> int:
    """Stiffness, damping and Coulomb friction from a sweep back and forth under a measured load.

    Args:
        motion: Columns time_s (or _ms), angle_deg (or _rad) and moment_Nm (or _Nmm); for elongation elongation_mm (or _m)
            and force_N.
    """
    from app.identify.motions import identify_sweep as run

    return run(motion, quantity=quantity, out=out, skip_bad_rows=skip_bad_rows)


COMMAND = Command(
    "identify sweep",
    "damping and friction from a sweep back and forth",
    identify_sweep,
    "  cobra-teleop identify sweep sweep.csv\n  cobra-teleop identify sweep pull.csv --quantity elongation",
)
