"""Open the motors of a described robot, on however many channels, as one `MotorBus`."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from cobra.clock import Clock
from cobra.description import Bus, RobotDescription
from cobra.motors.bus import BusError, MotorBus
from cobra.motors.bus_load import channel_load
from cobra.motors.cell_readings import LoadCells
from cobra.motors.joined_bus import JoinedBus, MotorChannel
from cobra.motors.listening_bus import ListeningBus
from cobra.motors.raw_log import RawLog
from cobra.motors.rmd_bus import RmdBus

SIMULATED = "cobra-sim"


def open_bus(
    description: RobotDescription, clock: Clock, can_log: Path | None = None, cells: LoadCells | None = None
) -> MotorBus:
    """The motor bus of a robot; `with open_bus(...) as bus` opens and closes its channels.

    Args:
        can_log: file that gets every frame, `.log` or `.blf`.
        cells: the robot's load cells, for who calibrates them.

    Raises:
        BusError: a channel could not carry the robot at its loop rate.
    """
    named = {drive.bus for drive in description.drives} | {cell.bus for cell in description.load_cells}
    used = [bus for bus in description.buses if bus.name in named]
    for bus in used:
        if complaint := channel_load(description, bus).complaint():
            raise BusError(complaint)
    log = RawLog(can_log) if can_log is not None else None
    channels: list[MotorChannel] = []
    for bus in used:
        kind = _kind(description, bus)
        channel = kind(description, bus, clock, _options(description, bus, clock))
        channel.record_to(log.recorder(bus.name) if log is not None else None)
        channels.append(channel)
    # CANopen first: enabling its drives takes longer than the watchdog of RMD drives, which is armed when they are.
    channels.sort(key=lambda channel: isinstance(channel, RmdBus))
    return JoinedBus(channels, log, cells if cells is not None else LoadCells(description, clock))


def _kind(
    description: RobotDescription, bus: Bus
) -> Callable[[RobotDescription, Bus, Clock, dict[str, Any]], MotorChannel]:
    protocols = {description.motor_of(drive).protocol for drive in description.drives if drive.bus == bus.name}
    if not protocols:
        return ListeningBus
    if "cia402" not in protocols:
        return RmdBus
    # Only who has CANopen drives waits for that package.
    from cobra.motors.cia402_bus import Cia402Bus  # noqa: PLC0415

    return Cia402Bus


def _options(description: RobotDescription, bus: Bus, clock: Clock) -> dict[str, Any]:
    # Simulated drives live in the caller's time and are those of the very description that is driven.
    shared = {"clock": clock, "description": description} if bus.interface == SIMULATED else {}
    return {**shared, **bus.options}
