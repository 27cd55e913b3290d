"""`cobra-teleop drive`: the operator's console on another machine than the robot."""

from typing import Annotated

import tyro

from app.commands.command import AS_USUAL, DIRECTLY, Command, Linked, Operated


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
    console: Operated = AS_USUAL,
) -> int:
    from app.console.console import Console

    return Console(console.options(robot, endpoint=endpoint, access=linked.access())).run()


COMMAND = Command(
    "drive",
    "drive a robot whose process runs on another machine",
    drive_elsewhere,
    "  cobra-teleop drive tls/router:7447 --account anna.account --ca ca.pem\n"
    "  cobra-teleop drive tls/router:7447 --robot cobra --account anna.account --ca ca.pem\n"
    "  cobra-teleop drive tcp/127.0.0.1:7447       one that runs here with `robot --listen tcp/127.0.0.1:7447`",
)
