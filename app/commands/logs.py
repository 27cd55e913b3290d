"""`cobra-teleop logs`: what all processes wrote down."""

from typing import Annotated, Literal

import tyro

from app.commands.command import Command


def logs(
    *,
    level: Annotated[
        Literal["debug", "info", "warning", "error"], tyro.conf.arg(help="This and what is worse.")
    ] = "info",
    hours: Annotated[float, tyro.conf.arg(help="How far back.")] = 24.0,
) -> int:
    from app.logs import show

    return show(level, hours)


COMMAND = Command(
    "logs",
    "what consoles and robot processes wrote down, in one list",
    logs,
    "  cobra-teleop logs\n  cobra-teleop logs --level warning --hours 1",
)
