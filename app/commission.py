"""Commissioning from the command line: scan, identify, test, home, tare, calibrate. One line says what went wrong."""

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import msgspec

from app import runtime
from app.bus_routes import rerouted, route_of
from app.calibrations import calibrations
from app.commission_tables import cell_table, scan_table
from app.simulated_robot import is_simulated, simulated
from cobra.clock import SystemClock
from cobra.control.drivetrain import Drivetrain
from cobra.control.realtime import LOOP_PRIORITY, realtime
from cobra.description import Bus, RobotDescription
from cobra.errors import OperatorError
from cobra.kinematics.configuration import Configuration
from cobra.kinematics.tendons import TendonMap
from cobra.motors.bus import BusError, MotorBus
from cobra.motors.calibration import Calibration, CalibrationBook, zeros
from cobra.motors.cell_readings import CellCalibration, LoadCells
from cobra.motors.commissioning.bench import Bench, Bounded, bare, only
from cobra.motors.commissioning.cell_points import KnownForce, Tare
from cobra.motors.commissioning.drive_test import DriveTest
from cobra.motors.commissioning.identify import DEGREES, LARGEST_DEGREES, Wiggle
from cobra.motors.commissioning.procedure import AbortError
from cobra.motors.commissioning.repeat import MOST_RUNS, RepeatedHoming
from cobra.motors.commissioning.survey import Found, compared, options_of, survey
from cobra.motors.open_bus import open_bus
from cobra.motors.rmd_probe import FoundDrive
from cobra.simulation.options import Simulation

BARE_BUS = "bus"
V1_DEGREES = 30.0
"""Of the motor's own shaft, where the gear is not known."""


class CommissionError(OperatorError):
    """Commissioning cannot begin or was ended. The message says why."""


@dataclass(frozen=True, kw_only=True)
class Where:
    """Which motors: those of a robot, or whatever is on one adapter."""

    robot: str
    interface: str | None
    channel: str | None
    bitrate: int
    routes: Sequence[str]
    simulation: Simulation

    def bare_bus(self) -> Bus | None:
        """The adapter, where one is named instead of a robot. Raises CommissionError."""
        if self.interface is None and self.channel is None:
            return None
        if self.interface is None or self.channel is None:
            raise CommissionError("give both, e.g. --interface socketcan --channel can0")
        try:
            name = self.channel.partition("?")[0]
            described = Bus(name=BARE_BUS, interface=self.interface, channel=name, bitrate=self.bitrate)
        except msgspec.ValidationError as error:
            raise CommissionError(str(error)) from None
        return route_of(described, f"{self.interface}:{self.channel}", f"{self.interface}:{self.channel}")

    def description(self) -> RobotDescription:
        """Raises DescriptionError, RouteError, CommissionError: its robot process owns the motors."""
        description = rerouted(simulated(self.robot, self.simulation), self.routes)
        running = runtime.find("robot", description.name)
        if running is not None and not is_simulated(description):
            raise CommissionError(
                f"the robot process of {description.name} runs (process {running.pid}) and owns the motors: commission it "
                "in its page, or quit it first"
            )
        return description


# ---------------------------------------------------------------- scan


def scan(where: Where) -> int:
    """Print who is on the buses. Exit status 2 if a described drive does not answer or is another than described."""
    clock = SystemClock()
    found: list[Found] = []
    missing: list[str] = []
    if (bus := where.bare_bus()) is not None:
        with realtime(LOOP_PRIORITY):
            found = [Found(bus.channel, motor) for motor in survey(bus, clock, bus.options)]
    else:
        description = where.description()
        for bus in description.buses:
            with realtime(LOOP_PRIORITY):
                motors = survey(bus, clock, options_of(description, bus, clock))
            here, silent = compared(description, bus, motors)
            found += here
            missing += [f"{name} on bus {bus.name}" for name in silent]
    for line in scan_table(found):
        print(line)
    if not found:
        print("nobody answers: check power, cable, bit rate and the termination (120 ohms at both ends)")
    if missing:
        print(f"described, but silent: {', '.join(missing)}")
    wrong = [f"{item.bus} {item.motor.address}: {item.complaint}" for item in found if item.drive and item.complaint]
    return 2 if missing or wrong or not found else 0


# ---------------------------------------------------------------- one motor and more


def identify(where: Where, motor: str, degrees: float | None) -> int:
    """Wiggle one motor, by the name of its drive or its address."""
    if (bus := where.bare_bus()) is not None:
        description = bare(_the_one(bus, motor), bus)
        of_shaft = "of its motor's shaft" if description.motors[0].protocol == "rmd-v1" else "of its shaft"
        swing = degrees or (V1_DEGREES if description.motors[0].protocol == "rmd-v1" else DEGREES)
    else:
        whole = where.description()
        description = only(whole, (_index(whole, motor),))
        of_shaft, swing = "of its output shaft", degrees or DEGREES
    if not 0.0 < swing <= LARGEST_DEGREES:
        raise CommissionError(f"--degrees {swing:g}: must be over 0 and at most {LARGEST_DEGREES:g}")
    drive = description.drives[0]
    print(f"drive {drive.name} (address {drive.address}) moves to and fro by {swing:g} degrees {of_shaft}, three times")
    wiggle = Wiggle(description, 0, swing)
    with _bench(description) as (bench, bus_of):
        _run(bench, wiggle)
        bus_of.disable()
    print(
        f"it swung {wiggle.moved_degrees:.1f} degrees by its own encoder and drew up to {wiggle.largest_A:.2f} A; it is off again"
    )
    if wiggle.moved_degrees < 0.5 * swing:
        raise CommissionError("that is not what it was told: is its shaft blocked, or its encoder dead?")
    return 0


def test(where: Where, motors: Sequence[str]) -> int:
    """Test drives one after the other. Exit status 2 if one does not do what the description says."""
    whole = where.description()
    indices = tuple(_index(whole, motor) for motor in motors) or tuple(range(len(whole.drives)))
    description = only(whole, indices)
    failed = []
    with _bench(description) as (bench, bus):
        for i, drive in enumerate(description.drives):
            test_of = DriveTest(description, i)
            _run(bench, test_of, quiet=True)
            for check in test_of.checks:
                print(f"{drive.name:8} {check.name:10} {'ok  ' if check.ok else 'FAIL'}  {check.words}", flush=True)
                failed += [] if check.ok else [f"{drive.name}: {check.name}"]
        bus.disable()
    print("all as described; the drives are off again" if not failed else f"not as described: {', '.join(failed)}")
    return 2 if failed else 0


def off(where: Where) -> int:
    """Take the torque off all motors of a robot."""
    description = where.description()
    with realtime(LOOP_PRIORITY), open_bus(description, SystemClock()) as bus:
        bus.disable()
    print(f"all drives of {description.name} are off")
    return 0


# ---------------------------------------------------------------- homing and calibration


def home(where: Where, runs: int, leave: str) -> int:
    """Home `runs` times, report the spread and keep the zeros."""
    if not 1 <= runs <= MOST_RUNS:
        raise CommissionError(f"--runs {runs}: must be 1 to {MOST_RUNS}")
    description = where.description()
    book = calibrations(description)
    cells = LoadCells(description, SystemClock())
    _use(book.load(), cells, book)
    procedure = RepeatedHoming(description, TendonMap(description).bending, runs)
    with _bench(description, cells) as (bench, bus):
        _run(bench, procedure)
        angle = bench.transmission.angle(bench.setpoint)
        travel = Drivetrain(description, bus).travel_of(Configuration(description).home())
        beside = list(cell_table(description, bench.seen)) if bench.seen is not None else []
        if leave == "off":
            bus.disable()
        else:
            bus.hold()
    spread = dict(zip(description.tendon_names, procedure.spread_m.tolist(), strict=True)) if runs > 1 else {}
    by_drive = {
        description.drives[d].name: spread[name]
        for name, d in zip(description.tendon_names, description.tendon_drives, strict=True)
        if name in spread
    }
    kept = book.keep(f"homed {runs} times on the command line", drives=zeros(description, angle, travel, by_drive))
    for name, value in spread.items():
        print(f"tendon {name:8} zero within {value * 1e3:.2f} mm over {runs} runs")
    if spread:
        print(f"largest spread {max(spread.values()) * 1e3:.2f} mm")
    for line in beside:
        print(line)
    print(f"kept as calibration {kept.version} of {kept.date}; the drives {'are off' if leave == 'off' else 'hold'}")
    return 0


def tare(where: Where, tendons: Sequence[str]) -> int:
    """Slacken tendons and take what their load cells read as nothing."""
    return _points(where, lambda description, _: Tare(description, tuple(tendons)), "tared on the command line")


def calibrate_cell(where: Where, tendon: str, force_N: float) -> int:
    """Take what a tared load cell reads now as a known force."""

    def known(description: RobotDescription, calibration: Calibration | None) -> KnownForce:
        return KnownForce(description, tendon, force_N, calibration.cells.get(tendon) if calibration else None)

    return _points(where, known, f"{tendon} under {force_N:g} N on the command line")


def history(where: Where) -> int:
    """List the calibrations of a robot."""
    book = calibrations(simulated(where.robot, where.simulation))
    versions = book.history()
    used = book.load()
    for kept in versions:
        mark = "*" if used is not None and kept.version == used.version else " "
        spreads = [zero.spread_m for zero in kept.drives.values() if zero.spread_m is not None]
        spread = f", spread up to {max(spreads) * 1e3:.2f} mm" if spreads else ""
        serial = f", serial {kept.serial}" if kept.serial else ""
        print(
            f"{mark} {kept.version:4}  {kept.date}  {len(kept.drives)} zeros, {len(kept.cells)} cells{spread}{serial}: {kept.by}"
        )
    for complaint in book.complaints:
        print(complaint)
    if not versions:
        print("there is none yet: `cobra-teleop motors home` makes the first")
    return 0


def _points(
    where: Where, procedure: Callable[[RobotDescription, Calibration | None], Tare | KnownForce], by: str
) -> int:
    description = where.description()
    book = calibrations(description)
    cells = LoadCells(description, SystemClock())
    before = book.load()
    _use(before, cells, book)
    with _bench(description, cells) as (bench, bus):
        try:
            reading = procedure(description, before)
        except AbortError as error:
            raise CommissionError(str(error)) from None
        _run(bench, reading)
        bus.disable()
    kept = book.keep(by, cells=reading.cells)
    for name, found in reading.cells.items():
        print(f"load cell of {name}: offset {found.offset_N:+.3f} N, gain {found.gain:.4f}")
    print(f"kept as calibration {kept.version} of {kept.date}; the drives are off")
    return 0


def _use(calibration: Calibration | None, cells: LoadCells, book: CalibrationBook) -> None:
    for complaint in book.complaints:
        print(complaint)
    found: dict[str, CellCalibration] = calibration.cells if calibration is not None else {}
    cells.calibrate(found)


# ---------------------------------------------------------------- running


@contextlib.contextmanager
def _bench(description: RobotDescription, cells: LoadCells | None = None) -> Iterator[tuple[Bench, MotorBus]]:
    clock = SystemClock()
    with realtime(LOOP_PRIORITY), open_bus(description, clock, cells=cells) as bus:
        bench = Bench(description, bus, clock)
        try:
            bench.enable()
        except AbortError as error:
            raise CommissionError(str(error)) from None
        yield bench, bus


def _run(bench: Bench, procedure: Bounded, *, quiet: bool = False) -> None:
    """Until it is done; Ctrl-C ends it. Raises CommissionError with the reason."""
    stop = threading.Event()
    before = signal.signal(signal.SIGINT, lambda *_: stop.set())
    try:
        bench.run(procedure, (lambda _: None) if quiet else _say, stop)
    except AbortError as error:
        raise CommissionError(
            f"ended: {error}{'' if str(error).endswith('?') else '.'} The drives hold where they are; `cobra-teleop motors off` lets them go"
        ) from None
    except BusError as error:
        raise CommissionError(f"ended: {error}") from None
    finally:
        signal.signal(signal.SIGINT, before)


def _say(words: str) -> None:
    print(words, flush=True)


def _index(description: RobotDescription, motor: str) -> int:
    """Of a drive, by its name or, where one bus alone has it, its address."""
    for i, drive in enumerate(description.drives):
        if drive.name == motor:
            return i
    matching = [i for i, drive in enumerate(description.drives) if str(drive.address) == motor]
    if len(matching) == 1:
        return matching[0]
    names = ", ".join(drive.name for drive in description.drives)
    if matching:
        raise CommissionError(f"address {motor} is on several buses: give the drive's name: {names}")
    raise CommissionError(f"{description.name} has no drive {motor!r}; it has {names}")


def _the_one(bus: Bus, motor: str) -> FoundDrive:
    found = survey(bus, SystemClock(), bus.options)
    for one in found:
        if str(one.address) == motor:
            return one
    there = ", ".join(str(one.address) for one in found) or "nobody"
    raise CommissionError(
        f"no motor answers to address {motor} on {bus.interface} {bus.channel}; there answers {there}"
    )
