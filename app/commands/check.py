"""`cobra-teleop check`: explain a robot description."""

from typing import Annotated

import tyro

from app.commands.command import Command


def check(
    description: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="ROBOT")],
    /,
) -> int:
    """Validate a robot description and explain it in words.

    Args:
        description: Name of a robot that comes with the program, or path of a description.
    """
    from app.check import explain
    from cobra.loading import load_description

    for line in explain(load_description(description)):
        print(line)
    return 0


COMMAND = Command(
    "check",
    "validate a robot description and explain it in words",
    check,
    "  cobra-teleop check cobra\n  cobra-teleop check my-robot.toml",
)
