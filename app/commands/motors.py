"""`cobra-teleop motors …`: from a bare bus to a homed robot."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from app.bus_routes import BusRoutes
from app.commands.command import AS_DESCRIBED, Command, RobotName, SimulationArguments

if TYPE_CHECKING:
    from app.commission import Where


@dataclass(frozen=True, kw_only=True)
class OfRobot:
    """Motors of a described robot."""

    robot: RobotName = "cobra"
    bus: BusRoutes = ()
    simulated: Annotated[SimulationArguments, tyro.conf.arg(name="")] = AS_DESCRIBED

    def where(self) -> "Where":
        from app.commission import Where

        return Where(
            robot=self.robot, interface=None, channel=None, bitrate=1_000_000, routes=self.bus,
            simulation=self.simulated.simulation(),
        )  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Anywhere(OfRobot):
    """Motors of a described robot, or whatever is on an adapter."""

    interface: Annotated[
        str | None,
        tyro.conf.arg(metavar="NAME", help="Adapter instead of a robot's: socketcan, slcan, gs_usb, pcan, …"),
    ] = None
    channel: Annotated[
        str | None, tyro.conf.arg(metavar="NAME", help="Its channel: can0, /dev/ttyACM0, …; options after a '?'.")
    ] = None
    bitrate: Annotated[int, tyro.conf.arg(metavar="BIT/S", help="Of the adapter named here.")] = 1_000_000

    def where(self) -> "Where":
        from app.commission import Where

        return Where(
            robot=self.robot, interface=self.interface, channel=self.channel, bitrate=self.bitrate, routes=self.bus,
            simulation=self.simulated.simulation(),
        )  # fmt: skip


OnRobot = Annotated[OfRobot, tyro.conf.arg(name="")]
OnBus = Annotated[Anywhere, tyro.conf.arg(name="")]
ROBOT = OfRobot()
BUS = Anywhere()


def scan(*, motors: OnBus = BUS) -> int:
    from app.commission import scan as run

    return run(motors.where())


def identify(
    motor: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="ID")],
    /,
    *,
    degrees: Annotated[float | None, tyro.conf.arg(metavar="DEG", help="How far; gently by default.")] = None,
    motors: OnBus = BUS,
) -> int:
    """Move one motor to and fro a little.

    Args:
        motor: name of a drive, or its address.
    """
    from app.commission import identify as run

    return run(motors.where(), motor, degrees)


def check_drives(
    drives: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="DRIVE")] = (),
    /,
    *,
    motors: OnRobot = ROBOT,
) -> int:
    """Test drives one after the other.

    Args:
        drives: names or addresses; all by default.
    """
    from app.commission import test as run

    return run(motors.where(), drives)


def home(
    *,
    runs: Annotated[int, tyro.conf.arg(help="How often; from two on the spread is told.")] = 3,
    leave: Annotated[Literal["hold", "off"], tyro.conf.arg(help="What the drives do afterwards.")] = "hold",
    motors: OnRobot = ROBOT,
) -> int:
    from app.commission import home as run

    return run(motors.where(), runs, leave)


def off(*, motors: OnRobot = ROBOT) -> int:
    from app.commission import off as run

    return run(motors.where())


def tare(
    tendons: Annotated[tuple[str, ...], tyro.conf.Positional, tyro.conf.arg(metavar="TENDON")] = (),
    /,
    *,
    motors: OnRobot = ROBOT,
) -> int:
    """Slacken tendons and take what their load cells read as nothing.

    Args:
        tendons: all that have a load cell by default.
    """
    from app.commission import tare as run

    return run(motors.where(), tendons)


def calibrate_cell(
    tendon: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="TENDON")],
    /,
    *,
    force: Annotated[float, tyro.conf.arg(metavar="N", help="What pulls at it now.")],
    motors: OnRobot = ROBOT,
) -> int:
    """Take what a tared load cell reads as a known force.

    Args:
        tendon: whose cell.
    """
    from app.commission import calibrate_cell as run

    return run(motors.where(), tendon, force)


def calibrations(*, motors: OnRobot = ROBOT) -> int:
    from app.commission import history as run

    return run(motors.where())


COMMANDS = (
    Command(
        "motors scan",
        "who is on the buses: every address, both protocols, moving nothing",
        scan,
        "  cobra-teleop motors scan --robot my-robot.toml\n"
        "  cobra-teleop motors scan --interface socketcan --channel can0\n"
        "  cobra-teleop motors scan --interface slcan --channel socket://127.0.0.1:5000",
    ),
    Command(
        "motors identify",
        "move one motor to and fro a little, to see which it is",
        identify,
        "  cobra-teleop motors identify S1 --robot my-robot.toml\n"
        "  cobra-teleop motors identify 3 --interface socketcan --channel can0 --degrees 45",
    ),
    Command(
        "motors test",
        "encoder, direction, travel and current of each drive",
        check_drives,
        "  cobra-teleop motors test --robot my-robot.toml\n  cobra-teleop motors test S1 N1",
    ),
    Command(
        "motors home",
        "find the zero of every tendon, more than once, and keep it with the spread; twist counts from where it stands, and "
        "the active segment is taken for wholly outside its port",
        home,
        "  cobra-teleop motors home --robot my-robot.toml\n"
        "  cobra-teleop motors home --bus main=slcan:/dev/ttyACM0 --runs 5 --leave off",
    ),
    Command("motors off", "take the torque off all drives", off, "  cobra-teleop motors off --robot my-robot.toml"),
    Command(
        "motors tare",
        "slacken tendons and take what their load cells read as nothing",
        tare,
        "  cobra-teleop motors tare --robot my-robot.toml\n  cobra-teleop motors tare S1 N1",
    ),
    Command(
        "motors calibrate-cell",
        "second point of a load cell: a known force pulls at it now",
        calibrate_cell,
        "  cobra-teleop motors calibrate-cell S1 --force 9.81",
    ),
    Command(
        "motors calibrations",
        "all calibrations of a robot, the one in use marked",
        calibrations,
        "  cobra-teleop motors calibrations --robot my-robot.toml",
    ),
)
