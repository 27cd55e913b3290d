"""The command line: `cobra-teleop` drives; its subcommands do the rest. Heavy imports wait until a command needs them."""

import logging
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Annotated, Literal

import tyro

from cobra.errors import OperatorError

TwinKind = Literal["default", "ideal", "none"]
RobotName = Annotated[str, tyro.conf.arg(help="Name of a robot that comes with the program, or path of a description.")]
Twin = Annotated[
    TwinKind,
    tyro.conf.arg(
        help="Physics behind simulated drives: with stretch and gravity, ideal (stiff, no gravity), or none."
    ),
]
CanLog = Annotated[
    Path | None, tyro.conf.arg(metavar="FILE", help="Write every CAN frame to FILE (.log for candump, or .blf).")
]

INTRODUCTION = """Drive tendon-driven continuum robots from a browser, on real CAN drives or on a physics twin.

Without a subcommand it starts everything and opens the operator's page:

  cobra-teleop                          drive COBRA on its twin
  cobra-teleop --robot my-robot.toml    drive your own robot
  cobra-teleop --twin ideal             stiff tendons, no gravity
  cobra-teleop --port 9000 --no-open    another port, no browser

Subcommands (each with its own --help):

{commands}

Exit status: 0 fine, 2 wrong input or something is missing (one line says what).
A button in a browser or on a pad is not a certified emergency stop: a real robot needs a hard-wired one."""


@dataclass(frozen=True)
class _Command:
    summary: str
    body: Callable[..., int]
    examples: str


def drive(
    *,
    robot: RobotName = "cobra",
    twin: Twin = "default",
    port: Annotated[int, tyro.conf.arg(help="Port of the page; when it is taken the next free one is used.")] = 8080,
    open_page: Annotated[
        bool, tyro.conf.arg(name="open", help="Open the page in the browser, where there is a screen.")
    ] = True,
    pad: Annotated[bool, tyro.conf.arg(help="Read a gamepad plugged into this computer.")] = True,
    frame_rate: Annotated[float, tyro.conf.arg(help="Frames per second of the 3D scene.")] = 30.0,
    can_log: CanLog = None,
    leave_robot: Annotated[
        bool, tyro.conf.arg(help="At the end leave the robot process running (it holds) for the next console.")
    ] = False,
) -> int:
    from app.console.console import Console, ConsoleOptions

    return Console(
        ConsoleOptions(
            robot=robot,
            twin=twin,
            port=port,
            open_page=open_page,
            pad=pad,
            frame_rate_Hz=frame_rate,
            can_log=can_log,
            leave_robot=leave_robot,
        )
    ).run()


def robot_process(
    *,
    robot: RobotName = "cobra",
    listen: Annotated[
        str | None, tyro.conf.arg(metavar="ENDPOINT", help="Where the link listens; a free loopback port by default.")
    ] = None,
    twin: Twin = "default",
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
        twin=twin,
        can_log=can_log,
        orphaned_s=orphaned_after,
        leave_when_orphaned=leave_when_orphaned,
    )


def simulate(
    case: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="CASE")],
    /,
    *,
    out: Annotated[Path | None, tyro.conf.arg(metavar="FOLDER", help="For data and pictures; simulated/CASE.")] = None,
    formulation: Annotated[
        Literal["chain", "published"], tyro.conf.arg(help="The exact chain, or the paper's own equations.")
    ] = "chain",
    step_ms: Annotated[float | None, tyro.conf.arg(metavar="MS", help="Fixed time step.")] = None,
    tolerance_mm: Annotated[
        float | None, tyro.conf.arg(metavar="MM", help="Adapt the step so that one step errs less (chain only).")
    ] = None,
    measured: Annotated[
        Path | None, tyro.conf.arg(metavar="CSV", help="A measured motion to lay over the pictures, with its error.")
    ] = None,
    skip_bad_rows: Annotated[bool, tyro.conf.arg(help="Leave out rows of the CSV that cannot be used.")] = False,
    pictures: Annotated[bool, tyro.conf.arg(help="Draw the pictures.")] = True,
    view: Annotated[bool, tyro.conf.arg(help="Play the motion in the 3D scene until Ctrl-C.")] = False,
    port: Annotated[int, tyro.conf.arg(help="Of the 3D scene; when it is taken the next free one is used.")] = 8090,
) -> int:
    """Run a load case of SRC-Bot.

    Args:
        case: Name of a case that comes with the program, or path of a TOML file.
    """
    from app.simulate import SimulateOptions, run_simulation

    return run_simulation(
        SimulateOptions(
            case=case,
            out=out,
            formulation=formulation,
            step_ms=step_ms,
            tolerance_mm=tolerance_mm,
            measured=measured,
            skip_bad_rows=skip_bad_rows,
            pictures=pictures,
            view=view,
            port=port,
        )
    )


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


COMMANDS = {
    "robot": _Command(
        "the robot process alone, beside the hardware",
        robot_process,
        "  cobra-teleop robot --robot cobra\n"
        "  cobra-teleop robot --robot my-robot.toml --listen tcp/127.0.0.1:7447 --can-log frames.log",
    ),
    "simulate": _Command(
        "run a load case of SRC-Bot; write data, pictures and a table",
        simulate,
        "  cobra-teleop simulate actuation-plane-1\n"
        "  cobra-teleop simulate my-case.toml --measured recording.csv --out results\n"
        "  cobra-teleop simulate actuation-plane-1 --view",
    ),
    "check": _Command(
        "validate a robot description and explain it in words",
        check,
        "  cobra-teleop check cobra\n  cobra-teleop check my-robot.toml",
    ),
}


def main(argv: Sequence[str] | None = None) -> None:
    """Entry point. Errors that a user can mend are one line on stderr and exit status 2, never a traceback."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    logging.basicConfig(level=logging.WARNING, format="%(asctime)s %(levelname)s %(name)s: %(message)s")
    if arguments == ["--version"]:
        print(metadata.version("cobra-teleop"))
        return
    sys.exit(_run(arguments))


def _run(arguments: list[str]) -> int:
    command = COMMANDS.get(arguments[0]) if arguments else None
    try:
        if command is None:
            return tyro.cli(drive, prog="cobra-teleop", description=_introduction(), args=_known(arguments))
        description = f"{command.summary[0].upper()}{command.summary[1:]}.\n\nExamples:\n\n{command.examples}"
        return tyro.cli(command.body, prog=f"cobra-teleop {arguments[0]}", description=description, args=arguments[1:])
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


def _introduction() -> str:
    width = max(map(len, COMMANDS))
    return INTRODUCTION.format(
        commands="\n".join(f"  {name:<{width}}   {command.summary}" for name, command in COMMANDS.items())
    )
