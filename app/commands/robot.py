"""`cobra-teleop robot`: the robot process alone."""

from typing import Annotated

import tyro

from app.bus_routes import BusRoutes
from app.commands.command import AS_DESCRIBED, DIRECTLY, CanLog, Command, Linked, RobotName, Simulated


def robot_process(
    *,
    robot: RobotName = "cobra",
    listen: Annotated[
        str | None, tyro.conf.arg(metavar="ENDPOINT", help="Where the link listens; a free loopback port by default.")
    ] = None,
    simulated: Simulated = AS_DESCRIBED,
    router: Annotated[
        str | None, tyro.conf.arg(metavar="ENDPOINT", help="A router through which consoles elsewhere reach it.")
    ] = None,
    linked: Linked = DIRECTLY,
    bus: BusRoutes = (),
    can_log: CanLog = None,
    orphaned_after: Annotated[
        float, tyro.conf.arg(metavar="SECONDS", help="Without a console for this long, take the final action.")
    ] = 60.0,
    leave_when_orphaned: Annotated[bool, tyro.conf.arg(help="Exit after the final action.")] = False,
) -> int:
    from app.robot_process import run_robot

    return run_robot(
        robot,
        endpoint=listen,
        simulation=simulated.simulation(),
        router=router,
        access=linked.access(),
        routes=bus,
        can_log=can_log,
        orphaned_s=orphaned_after,
        leave_when_orphaned=leave_when_orphaned,
    )


COMMAND = Command(
    "robot",
    "the robot process alone, beside the hardware",
    robot_process,
    "  cobra-teleop robot --robot cobra\n"
    "  cobra-teleop robot --robot my-robot.toml --listen tcp/127.0.0.1:7447 --can-log frames.log\n"
    "  cobra-teleop robot --router tls/router:7447 --account cobra.account --ca ca.pem",
)
