"""`cobra-teleop motors serve`: simulated drives behind a serial CAN adapter."""

from typing import Annotated, Literal

import tyro

from app.commands.command import AS_DESCRIBED, Command, RobotName, Simulated, told_options


def motors_serve(
    *,
    robot: RobotName = "cobra",
    slcan: Annotated[
        str, tyro.conf.arg(metavar="pty|tcp:PORT", help="A pseudo-terminal a bus, or ports on loopback from PORT on.")
    ] = "pty",
    simulated: Simulated = AS_DESCRIBED,
    timing: Annotated[
        Literal["instant", "bit-true"], tyro.conf.arg(help="bit-true: frames take their bits at the bus's bit rate.")
    ] = "instant",
    latency_ms: Annotated[float, tyro.conf.arg(metavar="MS", help="How long a drive thinks before it answers.")] = 0.0,
    fault: Annotated[
        tyro.conf.UseAppendAction[tuple[str, ...]],
        tyro.conf.arg(metavar="WORDS", help="A fault from the start, e.g. 'drop S1 0.2'; may be given again."),
    ] = (),
) -> int:
    from app.motors_serve import serve

    simulation = simulated.simulation()
    return serve(
        robot,
        where=slcan,
        simulation=simulation,
        timing=timing,
        latency_ms=latency_ms,
        faults=fault,
        drive_with=told_options(simulation),
    )


COMMAND = Command(
    "motors serve",
    "simulated drives as a process of their own, behind a serial CAN adapter; faults on request",
    motors_serve,
    "  cobra-teleop motors serve --robot cobra                      prints where it is, and how to drive it\n"
    "  cobra-teleop motors serve --slcan tcp:5000 --timing bit-true\n"
    "  cobra-teleop motors serve --fault 'drop S1 0.1' --fault 'delay E2 3'\n\n"
    "While it runs, type faults, a line each: stall S1, overheat E2, break N3, bus-off main, heal, help.",
)
