"""`cobra-teleop drive`: the operator's console on another machine than the robot."""

from typing import Annotated

import tyro

from app.commands.command import (
    DIRECTLY,
    HERE_ONLY,
    Command,
    FrameRate,
    Linked,
    NoRecord,
    OpenPage,
    PadHere,
    PagePort,
    RecordBudget,
    RecordFolder,
    Served,
)


def drive_elsewhere(
    endpoint: Annotated[
        str,
        tyro.conf.Positional,
        tyro.conf.arg(metavar="ENDPOINT", help="The router, or on this machine the robot process's own link."),
    ],
    /,
    *,
    robot: Annotated[str, tyro.conf.arg(metavar="NAME", help="Which, where several are heard there.")] = "",
    linked: Linked = DIRECTLY,
    port: PagePort = 8080,
    page: Served = HERE_ONLY,
    open_page: OpenPage = True,
    pad: PadHere = True,
    frame_rate: FrameRate = 30.0,
    record: RecordFolder = None,
    no_record: NoRecord = False,
    record_budget: RecordBudget = 20.0,
) -> int:
    from app.console.console import Console, ConsoleOptions

    return Console(
        ConsoleOptions(
            robot=robot,
            endpoint=endpoint,
            access=linked.access(),
            host=page.host,
            port=port,
            tls_cert=page.tls_cert,
            tls_key=page.tls_key,
            names=page.name,
            insecure=page.insecure,
            open_page=open_page,
            pad=pad,
            frame_rate_Hz=frame_rate,
            record=not no_record,
            record_folder=record,
            record_budget_GB=record_budget,
        )
    ).run()


COMMAND = Command(
    "drive",
    "drive a robot whose process runs on another machine",
    drive_elsewhere,
    "  cobra-teleop drive tls/router:7447 --account anna.account --ca ca.pem\n"
    "  cobra-teleop drive tls/router:7447 --robot cobra --account anna.account --ca ca.pem\n"
    "  cobra-teleop drive tcp/127.0.0.1:7447       one that runs here with `robot --listen tcp/127.0.0.1:7447`",
)
