"""`cobra-teleop` without a subcommand: everything on one machine."""

from pathlib import Path
from typing import Annotated

import tyro

from app.bus_routes import BusRoutes
from app.commands.command import AS_DESCRIBED, CanLog, RecordBudget, RecordFolder, RobotName, Simulated


def drive(
    *,
    robot: RobotName = "cobra",
    simulated: Simulated = AS_DESCRIBED,
    bus: BusRoutes = (),
    port: Annotated[int, tyro.conf.arg(help="Port of the page; when it is taken the next free one is used.")] = 8080,
    host: Annotated[
        str, tyro.conf.arg(help="Address to serve the page on; others than loopback need users and TLS.")
    ] = "127.0.0.1",
    tls_cert: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help="Certificate with its chain, PEM.")] = None,
    tls_key: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help="The certificate's key, PEM.")] = None,
    name: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="NAME", help="Further host names by which browsers may come.")
    ] = (),
    insecure: Annotated[
        bool, tyro.conf.arg(help="Listen beyond loopback without users or TLS all the same; the page says so.")
    ] = False,
    open_page: Annotated[
        bool, tyro.conf.arg(name="open", help="Open the page in the browser, where there is a screen.")
    ] = True,
    pad: Annotated[bool, tyro.conf.arg(help="Read a gamepad plugged into this computer.")] = True,
    frame_rate: Annotated[float, tyro.conf.arg(help="Frames per second of the 3D scene.")] = 30.0,
    can_log: CanLog = None,
    leave_robot: Annotated[
        bool, tyro.conf.arg(help="At the end leave the robot process running (it holds) for the next console.")
    ] = False,
    drive_from: Annotated[
        Path | None,
        tyro.conf.arg(metavar="FILE", help="Drive the twin with a recording's sticks and compare; never a real robot."),
    ] = None,
    record: RecordFolder = None,
    no_record: Annotated[bool, tyro.conf.FlagCreatePairsOff, tyro.conf.arg(help="Record nothing.")] = False,
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
            host=host,
            port=port,
            tls_cert=tls_cert,
            tls_key=tls_key,
            names=name,
            insecure=insecure,
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
