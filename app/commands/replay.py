"""`cobra-teleop replay`: a recording in the 3D scene."""

from pathlib import Path
from typing import Annotated

import tyro

from app.commands.command import Command, RecordFolder


def replay(
    file: Annotated[
        Path, tyro.conf.Positional, tyro.conf.arg(metavar="FILE", help="The recording, or a session's name.")
    ],
    other: Annotated[
        Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="OTHER", help="Another one to lay over it.")
    ] = None,
    /,
    *,
    port: Annotated[int, tyro.conf.arg(help="Port of the page; when it is taken the next free one is used.")] = 8070,
    open_page: Annotated[
        bool, tyro.conf.arg(name="open", help="Open the page in the browser, where there is a screen.")
    ] = True,
    record: RecordFolder = None,
) -> int:
    from app.recording.catalogue import given
    from app.recording.replay import replay as run

    files = [given(name, record) for name in (file, other) if name is not None]
    return run(files, port, open_page)


COMMAND = Command(
    "replay",
    "play a recording in the 3D scene, or two over each other; it cannot reach a motor",
    replay,
    "  cobra-teleop replay 2026-11-22_07-26-37_cobra.mcap\n"
    "  cobra-teleop replay 2026-11-22_07-26-37_cobra 2026-11-21_16-02-11_cobra",
)
