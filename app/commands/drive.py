"""`cobra-teleop` without a subcommand: everything on one machine."""

from pathlib import Path
from typing import Annotated

import tyro

from app.bus_routes import BusRoutes
from app.commands.command import (
    AS_DESCRIBED,
    HERE_ONLY,
    CanLog,
    FrameRate,
    NoRecord,
    OpenPage,
    PadHere,
    PagePort,
    RecordBudget,
    RecordFolder,
    RobotName,
    Served,
    Simulated,
)


def drive(
    *,
    robot: RobotName = "cobra",
    simulated: Simulated = AS_DESCRIBED,
    bus: BusRoutes = (),
    port: PagePort = 8080,
    page: Served = HERE_ONLY,
    open_page: OpenPage = True,
    pad: PadHere = True,
    frame_rate: FrameRate = 30.0,
    can_log: CanLog = None,
    leave_robot: Annotated[
        bool, tyro.conf.arg(help="At the end leave the robot process running (it holds) for the next console.")
    ] = False,
    drive_from: Annotated[
        Path | None,
        tyro.conf.arg(metavar="FILE", help="Drive the twin with a recording's sticks and compare; never a real robot."),
    ] = None,
    record: RecordFolder = None,
    no_record: NoRecord = False,
    record_budget: RecordBudget = 20.0,
    record_can: Annotated[
        bool,
        tyro.conf.FlagCreatePairsOff,
        tyro.conf.arg(help="Write every CAN frame beside the recording."),
    ] = False,
) -> int:
    from app.console.console import Console, ConsoleOptions
    from app.recording.catalogue import given

    return Console(
        ConsoleOptions(
            robot=robot,
            simulation=simulated.simulation(),
            routes=bus,
            host=page.host,
            port=port,
            tls_cert=page.tls_cert,
            tls_key=page.tls_key,
            names=page.name,
            insecure=page.insecure,
            open_page=open_page,
            pad=pad,
            frame_rate_Hz=frame_rate,
            can_log=can_log,
            leave_robot=leave_robot,
            drive_from=given(drive_from) if drive_from else None,
            record=not no_record,
            record_folder=record,
            record_budget_GB=record_budget,
            record_can=record_can,
        )
    ).run()
