"""`cobra-teleop simulate`: load cases of SRC-Bot."""

from pathlib import Path
from typing import Annotated, Literal

import tyro

from app.commands.command import Command


def simulate(
    case: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="CASE")],
    /,
    *,
    out: Annotated[Path | None, tyro.conf.arg(metavar="FOLDER", help="For data and pictures; simulated/CASE.")] = None,
    formulation: Annotated[
        Literal["chain", "published"], tyro.conf.arg(help="The exact chain, or the paper's own equations.")
    ] = "chain",
    step_ms: Annotated[float | None, tyro.conf.arg(metavar="MS", help="Fixed time step.")] = None,
    tolerance_mm: Annotated[
        float | None, tyro.conf.arg(metavar="MM", help="Adapt the step so that one step errs less (chain only).")
    ] = None,
    measured: Annotated[
        Path | None, tyro.conf.arg(metavar="CSV", help="A measured motion to lay over the pictures, with its error.")
    ] = None,
    skip_bad_rows: Annotated[bool, tyro.conf.arg(help="Leave out rows of the CSV that cannot be used.")] = False,
    pictures: Annotated[bool, tyro.conf.arg(help="Draw the pictures.")] = True,
    view: Annotated[bool, tyro.conf.arg(help="Play the motion in the 3D scene until Ctrl-C.")] = False,
    port: Annotated[int, tyro.conf.arg(help="Of the 3D scene; when it is taken the next free one is used.")] = 8090,
) -> int:
    """Run a load case of SRC-Bot.

    Args:
        case: Name of a case that comes with the program, or path of a TOML file.
    """
    from app.simulate import SimulateOptions, run_simulation

    return run_simulation(
        SimulateOptions(
            case=case,
            out=out,
            formulation=formulation,
            step_ms=step_ms,
            tolerance_mm=tolerance_mm,
            measured=measured,
            skip_bad_rows=skip_bad_rows,
            pictures=pictures,
            view=view,
            port=port,
        )
    )


COMMAND = Command(
    "simulate",
    "run a load case of SRC-Bot; write data, pictures and a table",
    simulate,
    "  cobra-teleop simulate actuation-plane-1\n"
    "  cobra-teleop simulate my-case.toml --measured recording.csv --out results\n"
    "  cobra-teleop simulate actuation-plane-1 --view",
)
