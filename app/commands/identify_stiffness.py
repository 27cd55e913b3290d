"""`cobra-teleop identify stiffness`: equivalent stiffness from load tests."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from app.commands.command import Command, FigureFolder, SkipBadRows

if TYPE_CHECKING:
    from cobra.mechanics.identification import Quantity


def identify_stiffness(
    *,
    bending: Annotated[
        Path | None, tyro.conf.arg(metavar="CSV", help="Columns moment_Nm (or _Nmm) and angle_deg (or _rad).")
    ] = None,
    torsion: Annotated[Path | None, tyro.conf.arg(metavar="CSV", help="The same columns.")] = None,
    elongation: Annotated[
        Path | None, tyro.conf.arg(metavar="CSV", help="Columns force_N and elongation_mm (or _m).")
    ] = None,
    rest_length_mm: Annotated[
        float | None, tyro.conf.arg(metavar="MM", help="L0, the natural length of what was bent or twisted.")
    ] = None,
    out: FigureFolder = Path("identified"),
    skip_bad_rows: SkipBadRows = False,
) -> int:
    """Equivalent stiffnesses EI, GA and K of S-38 with 95 % intervals, drawn as figure 8 of the SRC-Bot paper.

    A column named set, where there is one, names the repetition to which a row belongs: the interval then comes from the
    scatter between the sets.
    """
    from app.identify.load_tests import identify_stiffness as run

    given: dict[Quantity, Path | None] = {"bending": bending, "torsion": torsion, "elongation": elongation}
    return run(
        {quantity: path for quantity, path in given.items() if path is not None},
        rest_length_mm=rest_length_mm,
        out=out,
        skip_bad_rows=skip_bad_rows,
    )


COMMAND = Command(
    "identify stiffness",
    "equivalent stiffness from load tests",
    identify_stiffness,
    "  cobra-teleop identify stiffness --bending bending.csv --torsion torsion.csv --elongation pull.csv --rest-length-mm 50",
)
