"""`cobra-teleop export`: a recording as tables, plots, a scene or a report."""

from pathlib import Path
from typing import Annotated, Literal

import tyro

from app.commands.command import Command


def export(
    file: Annotated[
        Path, tyro.conf.Positional, tyro.conf.arg(metavar="FILE", help="The recording, or a session's name.")
    ],
    /,
    *,
    to: Annotated[
        tuple[Literal["csv", "parquet", "npz", "viser", "png", "report"], ...],
        tyro.conf.arg(help="What to write: tables, a 3D scene in one HTML file, plots, a report on one page."),
    ] = ("csv", "png", "report"),
    channels: Annotated[
        tuple[str, ...],
        tyro.conf.arg(
            metavar="NAME", help="For tables: channels or parts of them, such as event or state.drives.load."
        ),
    ] = (),
    out: Annotated[
        Path | None, tyro.conf.arg(metavar="FOLDER", help="Where to write; a folder named as the recording, beside it.")
    ] = None,
) -> int:
    from app.recording import catalogue
    from app.recording.export import export as run

    for path in run(catalogue.given(file), to, channels, out):
        print(path)
    return 0


COMMAND = Command(
    "export",
    "write a recording as CSV, Parquet or NPZ, plots, a 3D scene to share, or a report",
    export,
    "  cobra-teleop export 2026-11-22_07-26-37_cobra.mcap\n"
    "  cobra-teleop export 2026-11-22_07-26-37_cobra --to npz --channels state.measured state.drives.load event\n"
    "  cobra-teleop export 2026-11-22_07-26-37_cobra --to viser report --out ~/inspection-7",
)
