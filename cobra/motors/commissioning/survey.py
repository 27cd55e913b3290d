"""Who is on the buses: every address in every protocol, described or not. Moves and writes nothing."""

from collections import Counter
from dataclasses import dataclass
from typing import Any, Final

from cobra.clock import Clock
from cobra.description import Bus, RobotDescription
from cobra.motors.open_bus import SIMULATED
from cobra.motors.rmd_channel import RmdChannel
from cobra.motors.rmd_probe import FoundDrive, find_rmd


@dataclass(frozen=True, slots=True)
class Found:
    """One motor that answered, and the drive that is described at its place."""

    bus: str
    motor: FoundDrive
    drive: str = ""
    """Name of the described drive; empty where none is described there."""
    complaint: str = ""
    """Where description and motor differ, in words."""


def survey(bus: Bus, clock: Clock, options: dict[str, Any] | None = None) -> list[FoundDrive]:
    """All motors of one channel, by address. Raises BusError."""
    channel = RmdChannel(bus, clock, options or {}, Counter())
    channel.open()
    try:
        channel.purge()
        return sorted((*find_rmd(channel), *_cia402(channel)), key=lambda found: (found.address, found.protocol))
    finally:
        channel.close()


def compared(description: RobotDescription, bus: Bus, motors: list[FoundDrive]) -> tuple[list[Found], list[str]]:
    """The motors beside the drives that are described on this bus; and described ones that did not answer, in words."""
    described = {drive.address: drive for drive in description.drives if drive.bus == bus.name}
    out = []
    for motor in motors:
        drive = described.get(motor.address)
        protocol = description.motor_of(drive).protocol if drive else motor.protocol
        complaint = f"described as {protocol}" if protocol != motor.protocol else "" if drive else "not described"
        out.append(Found(bus.name, motor, drive.name if drive else "", complaint))
    here = {motor.address for motor in motors}
    missing = [f"{drive.name} (address {drive.address})" for drive in described.values() if drive.address not in here]
    return out, missing


def options_of(description: RobotDescription, bus: Bus, clock: Clock) -> dict[str, Any]:
    """As `open_bus` gives them to the interface."""
    shared = {"clock": clock, "description": description} if bus.interface == SIMULATED else {}
    return {**shared, **bus.options}


def _cia402(channel: RmdChannel) -> list[FoundDrive]:
    # Who scans waits for that package anyway; who only drives RMD does not.
    from cobra.motors.cia402_probe import find_cia402  # noqa: PLC0415

    return find_cia402(channel)


PROTOCOL_TITLES: Final = {"rmd-v1": "RMD v1", "rmd-v3": "RMD v3", "cia402": "CiA 402"}
"""For people."""
