"""The command line: `cobra-teleop` drives; its subcommands do the rest. Heavy imports wait until a command needs them."""

import logging
import os
import sys
from collections.abc import Collection, Sequence
from importlib import metadata

import tyro

from app.commands import (
    check,
    drive_elsewhere,
    export,
    identify_cable_friction,
    identify_calibrate,
    identify_friction,
    identify_release,
    identify_stiffness,
    identify_sweep,
    logs,
    motors,
    motors_serve,
    record,
    recover,
    replay,
    robot,
    router,
    sessions,
    simulate,
    users,
    watch,
)
from app.commands.drive import drive
from cobra.errors import OperatorError

INTRODUCTION = """Drive tendon-driven continuum robots from a browser, on real CAN drives or on a physics twin.

Without a subcommand it starts everything and opens the operator's page:

  cobra-teleop                          drive COBRA on its twin
  cobra-teleop --robot my-robot.toml    drive your own robot
  cobra-teleop --twin ideal             stiff tendons, no gravity
  cobra-teleop --losses seeded --seed 4 another robot of its kind: other friction, stretch, lost motion
  cobra-teleop --world engine-stage     among the blades of a compressor; or straight-pipe, bent-pipe
  cobra-teleop --world casing.stl --world-scale 0.001 --world-pose 0 0 0.2 0 90 0
  cobra-teleop --port 9000 --no-open    another port, no browser

Subcommands (each with its own --help):

{commands}

Exit status: 0 fine, 2 wrong input or something is missing (one line says what).
A button in a browser or on a pad is not a certified emergency stop: a real robot needs a hard-wired one."""


COMMANDS = {
    command.name: command
    for command in (
        robot.COMMAND,
        drive_elsewhere.COMMAND,
        record.COMMAND,
        recover.COMMAND,
        motors_serve.COMMAND,
        *motors.COMMANDS,
        replay.COMMAND,
        export.COMMAND,
        *sessions.COMMANDS,
        simulate.COMMAND,
        identify_calibrate.COMMAND,
        identify_stiffness.COMMAND,
        identify_release.COMMAND,
        identify_sweep.COMMAND,
        identify_cable_friction.COMMAND,
        check.COMMAND,
        identify_friction.COMMAND,
        logs.COMMAND,
        *users.COMMANDS,
        watch.COMMAND,
        router.SERVE,
        router.ACCOUNT,
    )
}


def main(argv: Sequence[str] | None = None) -> None:
    """Entry point. Errors that a user can mend are one line on stderr and exit status 2, never a traceback."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    logging.basicConfig(level=logging.WARNING, format="%(asctime)s %(levelname)s %(name)s: %(message)s")
    if arguments == ["--version"]:
        print(metadata.version("cobra-teleop"))
        return
    try:
        try:
            sys.exit(_run(arguments))
        finally:
            sys.stdout.flush()
    except BrokenPipeError:  # whoever read this, as `head` does, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _run(arguments: list[str]) -> int:
    words = next((n for n in (2, 1) if " ".join(arguments[:n]) in COMMANDS), 0)
    command = COMMANDS[" ".join(arguments[:words])] if words else None
    try:
        if command is None and any(name.startswith(f"{arguments[0]} ") for name in COMMANDS if arguments):
            return _show_group(arguments)
        if command is None:
            return tyro.cli(drive, prog="cobra-teleop", description=_introduction(), args=_known(arguments))
        description = f"{command.summary[0].upper()}{command.summary[1:]}.\n\nExamples:\n\n{command.examples}"
        return tyro.cli(
            command.body, prog=f"cobra-teleop {command.name}", description=description, args=arguments[words:]
        )
    except KeyboardInterrupt:
        return 130
    except OperatorError as error:
        print(f"cobra-teleop: {error}", file=sys.stderr)
        return 2


def _known(arguments: list[str]) -> list[str]:
    if arguments and not arguments[0].startswith("-"):
        print(
            f"cobra-teleop: unknown command {arguments[0]!r}; there are {', '.join(COMMANDS)}. See cobra-teleop --help",
            file=sys.stderr,
        )
        raise SystemExit(2)
    return arguments


def _show_group(arguments: list[str]) -> int:
    """`motors` or `motors --help`: what there is; `motors fly`: the same, as an error."""
    group = arguments[0]
    names = [name for name in COMMANDS if name.startswith(f"{group} ")]
    if len(arguments) > 1 and arguments[1] not in ("-h", "--help"):
        wanted = f"{group} {arguments[1]}"
        print(f"cobra-teleop: unknown command {wanted!r}; there are {', '.join(names)}", file=sys.stderr)
        return 2
    print(f"Subcommands of cobra-teleop {group} (each with its own --help):\n\n{_listed(names)}")
    return 0


def _introduction() -> str:
    return INTRODUCTION.format(commands=_listed(COMMANDS))


def _listed(names: Collection[str]) -> str:
    width = max(map(len, names))
    return "\n".join(f"  {name:<{width}}   {COMMANDS[name].summary}" for name in names)
