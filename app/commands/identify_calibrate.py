"""`cobra-teleop identify calibrate`: a robot's kinematics from motor positions against measured tips."""

from pathlib import Path
from typing import Annotated, Literal

import tyro

from app.commands.command import Command, FigureFolder, SkipBadRows


def identify_calibrate(
    recording: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="CSV")],
    /,
    *,
    robot: Annotated[str, tyro.conf.arg(help="Name of a robot or path of its description, with nominal numbers.")],
    columns: Annotated[
        Path | None,
        tyro.conf.arg(
            metavar="TOML",
            help="Which column means what, and in which unit; not needed where columns are named as the help says.",
        ),
    ] = None,
    travel_positive: Annotated[
        Literal["paid-out", "wound-in", "unknown"] | None,
        tyro.conf.arg(help="What positive travel does to the tendons; unknown: the calibration finds out."),
    ] = None,
    validate: Annotated[
        Path | None,
        tyro.conf.arg(
            metavar="CSV", help="A recording taken after the first, for the error only: nothing is fitted to it."
        ),
    ] = None,
    out: FigureFolder = Path("identified"),
    model: Annotated[
        Literal["select", "all", "plain"],
        tyro.conf.arg(help="Effects: chosen on motions held out, all of them, or constant curvature alone."),
    ] = "select",
    skip_bad_rows: SkipBadRows = False,
) -> int:
    """Calibrate a robot: base frame, tendon azimuths and gains, section lengths, rest bends, stretch, slack, hysteresis.

    Args:
        recording: One row a sample, in the order in which they were taken. Columns: time_s; each tendon by its name in the
            description with a unit, as S1_mm (travel, paid out is positive) or S1_rad (the drive's shaft); tip_x_mm,
            tip_y_mm, tip_z_mm in any fixed frame; and, where there are, tip_qw, tip_qx, tip_qy, tip_qz, and motion, the
            name of the motion to which a row belongs. Other names: --columns.
    """
    from app.identify.calibration import CalibrateOptions, run_calibration

    return run_calibration(
        CalibrateOptions(
            recording=recording,
            robot=robot,
            columns=columns,
            travel_positive=travel_positive,
            validate=validate,
            out=out,
            model=model,
            skip_bad_rows=skip_bad_rows,
        )
    )


COMMAND = Command(
    "identify calibrate",
    "calibrate a robot on motor positions against measured tips",
    identify_calibrate,
    "  cobra-teleop identify calibrate recording.csv --robot my-robot.toml\n"
    "  cobra-teleop identify calibrate train.csv --robot docs/opencr-v4/robot.toml --columns docs/opencr-v4/columns.toml "
    "--validate validation.csv\n"
    "  cobra-teleop check identified/robot.toml",
)
