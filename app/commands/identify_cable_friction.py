"""`cobra-teleop identify cable-friction`: friction of a cable in the guiders' holes, from a recording."""

from pathlib import Path
from typing import Annotated

import tyro

from app.commands.command import Command, FigureFolder, SkipBadRows


def identify_cable_friction(
    recording: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="CSV")],
    /,
    *,
    out: FigureFolder = Path("identified"),
    skip_bad_rows: SkipBadRows = False,
) -> int:
    """The friction ratio of S-36 and S-37 from tensions measured at both ends of a cable.

    Args:
        recording: Columns motor_N, top_N, bend1_deg, bend2_deg, … (or _rad; of each chamber from the base), and moving,
            which says in (towards the motor) or out.
    """
    from app.identify.motions import identify_cable_friction as run

    return run(recording, out=out, skip_bad_rows=skip_bad_rows)


COMMAND = Command(
    "identify cable-friction",
    "friction of a cable in the guiders, from tensions at both ends",
    identify_cable_friction,
    "  cobra-teleop identify cable-friction tensions.csv",
)
