"""Faults of simulated drives and buses on request, one line of words each: `stall S1`, `drop twist 0.2`, `heal`."""

from collections.abc import Callable
from typing import NamedTuple

from cobra.errors import OperatorError
from cobra.simulation.drives import wire_of, world_of
from cobra.simulation.wire import WireFaults
from cobra.simulation.world import World

OVERHEATED_K = 5.0
"""Beyond the motor's limit."""
UNDERVOLTAGE_V = 5.0
"""Below the lowest limit of the motors."""


class FaultError(OperatorError):
    """A line that asks for no fault. The message says what would."""


class _Fault(NamedTuple):
    usage: str
    does: str
    apply: Callable[["FaultDesk", list[str]], str]


class FaultDesk:
    """Makes faults in the world behind an open simulated channel."""

    def __init__(self, channel: str) -> None:
        self._channel = channel
        self._world: World = world_of(channel)
        self._description = self._world.description
        self._supply_V = self._world.servos.supply_V

    @staticmethod
    def usage() -> str:
        """What may be asked, a line each."""
        width = max(len(fault.usage) for fault in FAULTS.values())
        return "\n".join(f"  {fault.usage:<{width}}   {fault.does}" for fault in FAULTS.values())

    def make(self, line: str) -> str:
        """Do what the line says; what was done, in words.

        Raises:
            FaultError: no such fault, drive or bus, or a number that cannot be.
        """
        words = line.split()
        if not words or words[0] not in FAULTS:
            raise FaultError(f"{line.strip()!r} is no fault; there are {', '.join(FAULTS)}")
        return FAULTS[words[0]].apply(self, words[1:])

    # -- the wire -----------------------------------------------------------------------------------------------------

    def drop(self, words: list[str]) -> str:
        return self._on_frames("drop", words)

    def corrupt(self, words: list[str]) -> str:
        return self._on_frames("corrupt", words)

    def duplicate(self, words: list[str]) -> str:
        return self._on_frames("duplicate", words)

    def delay(self, words: list[str]) -> str:
        names = self._drives(words)
        milliseconds = self._number(words, 1, 0.0, 10_000.0, 20.0)
        for name in names:
            self._faults_of(name).delay_s[name] = milliseconds / 1000.0
        return f"replies of {', '.join(names)} come {milliseconds:g} ms late"

    def _on_frames(self, kind: str, words: list[str]) -> str:
        names = self._drives(words)
        part = self._number(words, 1, 0.0, 1.0, 1.0)
        for name in names:
            getattr(self._faults_of(name), kind)[name] = part
        return f"{kind} {part:.0%} of the frames of {', '.join(names)}"

    def bus_off(self, words: list[str]) -> str:
        return self._on_bus(words, "off", True, "the adapter of bus {} is bus-off")

    def bus_on(self, words: list[str]) -> str:
        return self._on_bus(words, "off", False, "bus {} works again")

    def jam(self, words: list[str]) -> str:
        return self._on_bus(words, "jammed", True, "nothing gets through on bus {}; what is sent waits")

    def _on_bus(self, words: list[str], kind: str, value: bool, said: str) -> str:
        names = [bus.name for bus in self._description.buses]
        name = words[0] if words else names[0]
        if name not in names:
            raise FaultError(f"no bus {name!r}; there are {', '.join(names)}")
        setattr(wire_of(self._channel, name).faults, kind, value)
        return said.format(name)

    # -- the drives ---------------------------------------------------------------------------------------------------

    def stall(self, words: list[str]) -> str:
        names = self._drives(words)
        for name in names:
            self._world.servos.stalled.add(self._index(name))
        return f"{', '.join(names)} cannot turn"

    def overheat(self, words: list[str]) -> str:
        names = self._drives(words)
        for name in names:
            index = self._index(name)
            motor = self._description.motor_of(self._description.drives[index])
            celsius = self._number(words, 1, -40.0, 200.0, motor.max_temperature_C + OVERHEATED_K)
            self._world.servos.heated_C[index] = celsius
        return f"{', '.join(names)} is at {celsius:g} °C"

    def slip(self, words: list[str]) -> str:
        names = self._drives(words)
        degrees = self._number(words, 1, -36_000.0, 36_000.0, 90.0)
        for name in names:
            self._world.drives[self._index(name)].slip(degrees)
        return f"the encoder of {', '.join(names)} slipped by {degrees:g} degrees of the output shaft"

    def cut(self, words: list[str]) -> str:
        names = self._on_tendons("break_tendon", words)
        return f"the tendon of {', '.join(names)} is broken"

    def loosen(self, words: list[str]) -> str:
        millimetres = self._number(words, 1, 0.0, 1000.0, 20.0)
        names = self._on_tendons("slip", words, millimetres / 1000.0)
        return f"{millimetres:g} mm of the tendon of {', '.join(names)} came off its spool"

    def snag(self, words: list[str]) -> str:
        names = self._on_tendons("jam", words)
        return f"the tendon of {', '.join(names)} is stuck in its conduit"

    def _on_tendons(self, what: str, words: list[str], *amount: float) -> list[str]:
        """Do something to the twin's tendons; the drives' names."""
        names = self._drives(words)
        for name in names:
            drive = self._description.drives[self._index(name)]
            if drive.tendon is None:
                raise FaultError(f"drive {name!r} pulls no tendon")
            act = getattr(self._world.plant, what, None)
            if act is None:
                raise FaultError("this twin has no tendons that could do so: start with --twin default")
            try:
                act(drive.tendon, *amount)
            except ValueError as error:
                raise FaultError(f"{error}: start with --twin default --losses nominal") from None
        return names

    def undervoltage(self, words: list[str]) -> str:
        lowest = min(self._description.motor_of(drive).min_voltage_V for drive in self._description.drives)
        volts = self._number(words, 0, 0.0, 1000.0, lowest - UNDERVOLTAGE_V)
        self._world.servos.supply_V = volts
        return f"the supply is at {volts:g} V"

    def mute_cell(self, words: list[str]) -> str:
        names = self._cells(words)
        for amplifier in self._world.amplifiers.values():
            amplifier.mute |= any(cell.tendon in names for cell in amplifier.cells)
        return f"the amplifier of the load cell of {', '.join(names)} is silent"

    def saturate_cell(self, words: list[str]) -> str:
        names = self._cells(words)
        for amplifier in self._world.amplifiers.values():
            amplifier.saturated |= {cell.tendon for cell in amplifier.cells} & set(names)
        return f"the load cell of {', '.join(names)} is at the end of its range"

    def heal(self, words: list[str]) -> str:
        servos = self._world.servos
        servos.supply_V = self._supply_V
        servos.stalled.clear()
        servos.heated_C.clear()
        for amplifier in self._world.amplifiers.values():
            amplifier.mute = False
            amplifier.saturated.clear()
        for bus in self._description.buses:
            wire_of(self._channel, bus.name).faults = WireFaults()
        return "all is well again, but for what happened to tendons and encoders"

    # -- words --------------------------------------------------------------------------------------------------------

    def _drives(self, words: list[str]) -> list[str]:
        names = [drive.name for drive in self._description.drives]
        if not words or words[0] not in (*names, "all"):
            given = f"no drive {words[0]!r}" if words else "say which drive"
            raise FaultError(f"{given}; there are all, {', '.join(names)}")
        return names if words[0] == "all" else [words[0]]

    def _cells(self, words: list[str]) -> list[str]:
        names = [cell.tendon for cell in self._description.load_cells]
        if not words or words[0] not in (*names, "all"):
            raise FaultError(f"say of which tendon; load cells have {', '.join(names) or 'none'}")
        return names if words[0] == "all" else [words[0]]

    def _number(self, words: list[str], at: int, low: float, high: float, default: float) -> float:
        if len(words) <= at:
            return default
        try:
            number = float(words[at])
        except ValueError:
            number = float("nan")
        if not low <= number <= high:
            raise FaultError(f"{words[at]!r}: must be a number from {low:g} to {high:g}")
        return number

    def _index(self, name: str) -> int:
        return next(i for i, drive in enumerate(self._description.drives) if drive.name == name)

    def _faults_of(self, name: str) -> WireFaults:
        return wire_of(self._channel, self._description.drives[self._index(name)].bus).faults


FAULTS = {
    "drop": _Fault("drop DRIVE|all [0…1]", "lose this part of its frames, both ways", FaultDesk.drop),
    "corrupt": _Fault("corrupt DRIVE|all [0…1]", "change a byte in this part of its replies", FaultDesk.corrupt),
    "duplicate": _Fault("duplicate DRIVE|all [0…1]", "send this part of its replies twice", FaultDesk.duplicate),
    "delay": _Fault("delay DRIVE|all [MS]", "replies come later", FaultDesk.delay),
    "bus-off": _Fault("bus-off [BUS]", "the adapter leaves the bus", FaultDesk.bus_off),
    "bus-on": _Fault("bus-on [BUS]", "and comes back", FaultDesk.bus_on),
    "jam": _Fault("jam [BUS]", "nothing gets through, frames wait", FaultDesk.jam),
    "stall": _Fault("stall DRIVE|all", "the shaft is blocked", FaultDesk.stall),
    "overheat": _Fault("overheat DRIVE|all [°C]", "beyond its limit", FaultDesk.overheat),
    "break": _Fault("break DRIVE|all", "its tendon breaks", FaultDesk.cut),
    "loosen": _Fault("loosen DRIVE|all [MM]", "so much of its tendon comes off its spool", FaultDesk.loosen),
    "snag": _Fault("snag DRIVE|all", "its tendon is stuck in its conduit", FaultDesk.snag),
    "slip": _Fault("slip DRIVE|all [DEG]", "its encoder slips", FaultDesk.slip),
    "undervoltage": _Fault("undervoltage [V]", "of the supply of all", FaultDesk.undervoltage),
    "mute-cell": _Fault("mute-cell TENDON|all", "its load cell's amplifier is silent", FaultDesk.mute_cell),
    "saturate-cell": _Fault("saturate-cell TENDON|all", "its load cell reads its range's end", FaultDesk.saturate_cell),
    "heal": _Fault("heal", "end all faults that can be mended", FaultDesk.heal),
}
