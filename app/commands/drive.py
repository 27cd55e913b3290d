"""`cobra-teleop` without a subcommand: everything on one machine."""

from pathlib import Path
from typing import Annotated

import tyro

from app.bus_routes import BusRoutes
from app.commands.command import AS_DESCRIBED, AS_USUAL, CanLog, Operated, RobotName, Simulated


def drive(
    *,
    robot: RobotName = "cobra",
    simulated: Simulated = AS_DESCRIBED,
    bus: BusRoutes = (),
    console: Operated = AS_USUAL,
    can_log: CanLog = None,
    leave_robot: Annotated[
        bool, tyro.conf.arg(help="At the end leave the robot process running (it holds) for the next console.")
    ] = False,
    drive_from: Annotated[
        Path | None,
        tyro.conf.arg(metavar="FILE", help="Drive the twin with a recording's sticks and compare; never a real robot."),
    ] = None,
    record_can: Annotated[
        bool,
        tyro.conf.FlagCreatePairsOff,
        tyro.conf.arg(help="Write every CAN frame beside the recording."),
    ] = False,
) -> int:
    from app.console.console import Console
    from app.recording.catalogue import given

    options = console.options(
        robot,
        simulation=simulated.simulation(),
        routes=bus,
        can_log=can_log,
        leave_robot=leave_robot,
        drive_from=given(drive_from) if drive_from else None,
        record_can=record_can,
    )
    return Console(options).run()
