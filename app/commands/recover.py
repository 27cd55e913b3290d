"""`cobra-teleop recover`: a clean file of a recording that was not closed."""

from pathlib import Path
from typing import Annotated

import tyro

from app.commands.command import Command


def recover(
    file: Annotated[
        Path, tyro.conf.Positional, tyro.conf.arg(metavar="FILE", help="The recording, or a session's name.")
    ],
    /,
    *,
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help="The clean file; FILE.recovered.mcap.")] = None,
) -> int:
    from app.recording.catalogue import given
    from app.recording.recover import run_recover

    return run_recover(given(file), out)


COMMAND = Command(
    "recover",
    "make a clean file of a recording that was not closed, and say what was lost",
    recover,
    "  cobra-teleop recover 2026-11-22_07-26-37_cobra.mcap\n  cobra-teleop recover broken.mcap --out whole.mcap",
)
