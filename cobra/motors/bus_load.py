"""How much of a CAN channel a robot needs, and whether the loop's rate fits."""

import math
from dataclasses import dataclass
from functools import lru_cache

from cobra.description import Bus, Drive, RobotDescription
from cobra.motors.bus import BusError
from cobra.motors.cia402_frames import ACTUALS, HEARTBEAT, RPDO1, SDO_REQUEST, SYNC, TARGETS, TPDO1
from cobra.motors.frame_bits import frame_bits
from cobra.motors.rmd import DIALECTS, REQUEST_ID, Dialect, Request, encode, encode_reply

DESIGN_LOAD = 0.60
"""Polling is fitted under this part of the bit rate, so that retries and other nodes find room."""
MAX_LOAD = 0.95
"""Beyond this a loop cannot keep its period."""
SLOW_POLLS_PER_TICK = 0.1
"""At least: status of one drive every ten ticks."""
MAX_INTERPOLATION_MS = 100
ANGLE_PERIOD_TICKS = 4
"""At least: every v3 drive's angle once in so many ticks."""


@dataclass(frozen=True, slots=True)
class ChannelLoad:
    """What one channel carries at the loop's rate."""

    bus: Bus
    rate_Hz: float
    setpoint_bits: int
    """All setpoints of a tick and their replies."""
    exchanges: int
    """Setpoints a tick."""
    poll_bits: int
    """One read and its reply."""
    angle_polls: int
    """Multi-turn angles read in every tick: v3 drives, whose other replies carry whole degrees only."""
    slow_polls: float
    """Status reads a tick, round-robin (and, for v1 drives, checks of the turn count); at most 1."""
    cell_bits_per_s: float = 0.0
    """Of load cells, which send by themselves."""

    @property
    def bits_per_tick(self) -> float:
        cells = self.cell_bits_per_s / self.rate_Hz
        return self.setpoint_bits + (self.angle_polls + self.slow_polls) * self.poll_bits + cells

    @property
    def load(self) -> float:
        """Part of the bit rate, 0…1 and beyond."""
        return self.bits_per_tick * self.rate_Hz / self.bus.bitrate

    @property
    def wire_time_s(self) -> float:
        """How long the frames of a full tick take on the wire."""
        return (self.setpoint_bits + (self.angle_polls + 1) * self.poll_bits) / self.bus.bitrate

    @property
    def _cell_words(self) -> str:
        return f", load cells {self.cell_bits_per_s:.0f} bits/s" if self.cell_bits_per_s else ""

    def complaint(self) -> str:
        """Why the channel cannot carry it, with the sum; empty if it can."""
        if self.load <= MAX_LOAD:
            return ""
        possible = math.floor(MAX_LOAD * self.bus.bitrate / self.bits_per_tick)
        return (
            f"bus {self.bus.name!r}: {self.load:.0%} of {self.bus.bitrate / 1000:g} kbit/s at {self.rate_Hz:g} Hz "
            f"({self.exchanges} setpoints with replies {self.setpoint_bits} bits, {self.angle_polls + self.slow_polls:g} reads "
            f"of {self.poll_bits} bits{self._cell_words}: {self.bits_per_tick:.0f} bits x {self.rate_Hz:g} Hz); "
            f"at most {MAX_LOAD:.0%}: "
            f"lower teleop.loop_rate_Hz to {possible} or divide the drives among more buses"
        )


def channel_load(description: RobotDescription, bus: Bus) -> ChannelLoad:
    """Load of one channel with as much polling as fits under `DESIGN_LOAD`."""
    drives = [drive for drive in description.drives if drive.bus == bus.name]
    cells = _cell_bits_per_s(description, bus)
    if any(description.motor_of(drive).protocol == "cia402" for drive in drives):
        return _canopen_load(drives, bus, description.teleop.loop_rate_Hz, cells)
    dialects = [DIALECTS[description.motor_of(drive).protocol] for drive in drives]
    rate = description.teleop.loop_rate_Hz
    setpoint_bits = sum(_setpoint_bits(d, k) for d, k in zip(drives, dialects, strict=True))
    poll_bits = max((_poll_bits(d, k) for d, k in zip(drives, dialects, strict=True)), default=0)
    coarse = sum(dialect.name == "rmd-v3" for dialect in dialects)
    free_bits = (DESIGN_LOAD * bus.bitrate - cells) / rate - setpoint_bits
    room = max(0.0, free_bits) / poll_bits if poll_bits else 0.0
    slow = min(1.0, max(SLOW_POLLS_PER_TICK, room))
    angles = min(coarse, max(math.ceil(coarse / ANGLE_PERIOD_TICKS), int(room - slow)))
    return ChannelLoad(bus, rate, setpoint_bits, len(drives), poll_bits, angles, slow, cells)


def busiest(description: RobotDescription) -> float:
    """Part of the loop's period that the setpoints and replies of a tick take on the bus with most of them."""
    rate = description.teleop.loop_rate_Hz
    loads = (channel_load(description, bus) for bus in description.buses)
    return max(load.setpoint_bits / load.bus.bitrate * rate for load in loads)


def whole_milliseconds(rate_Hz: float) -> int:
    """The loop's period as CiA 402 drives take it (60C2). Raises BusError if it is none."""
    period_ms = round(1000.0 / rate_Hz)
    if abs(period_ms - 1000.0 / rate_Hz) > 1e-6 or period_ms > MAX_INTERPOLATION_MS:
        raise BusError(
            f"teleop.loop_rate_Hz = {rate_Hz:g}: CiA 402 drives interpolate over whole milliseconds, at most "
            f"{MAX_INTERPOLATION_MS}: give 50, 100, 125, 200 or 250"
        )
    return period_ms


def _cell_bits_per_s(description: RobotDescription, bus: Bus) -> float:
    frames: dict[int, tuple[float, int]] = {}
    for cell in description.load_cells:
        if cell.bus == bus.name:
            longest = max(frames.get(cell.frame_id, (0.0, 0))[1], cell.byte_offset + cell.size)
            frames[cell.frame_id] = (cell.rate_Hz, longest)
    return sum(rate_Hz * frame_bits(frame_id, bytes(range(n))) for frame_id, (rate_Hz, n) in frames.items())


def _canopen_load(drives: list[Drive], bus: Bus, rate_Hz: float, cell_bits_per_s: float) -> ChannelLoad:
    """SYNC, targets and actuals of every drive in every tick; heartbeats; a read over SDO now and then."""
    targets, actuals = TARGETS.pack(15, 123_456), ACTUALS.pack(0x1237, 123_456, -42)
    beats_Hz = len(drives) * 10 + 20
    exchange_bits = frame_bits(SYNC, b"") + math.ceil(beats_Hz / rate_Hz * frame_bits(HEARTBEAT + 1, b"\x05"))
    for drive in drives:
        exchange_bits += frame_bits(RPDO1 + drive.address, targets) + frame_bits(TPDO1 + drive.address, actuals)
    poll_bits = 2 * frame_bits(SDO_REQUEST + 1, bytes.fromhex("4000220100000000"))
    room = max(0.0, (DESIGN_LOAD * bus.bitrate - cell_bits_per_s) / rate_Hz - exchange_bits) / poll_bits
    slow = min(1.0, max(SLOW_POLLS_PER_TICK, room))
    return ChannelLoad(bus, rate_Hz, exchange_bits, len(drives), poll_bits, 0, slow, cell_bits_per_s)


@lru_cache(maxsize=256)
def _bits_of(address: int, dialect: Dialect, request: Request, turns: int) -> int:
    asked = {"speed_dps": 4125, "angle_deg": 360.5 * turns} if request == "position" else {}
    entry = dialect.entries[request]
    told = dict.fromkeys(entry.reply.names, 35 * turns)
    return frame_bits(REQUEST_ID + address, encode(dialect, request, **asked)) + frame_bits(
        dialect.reply_id + address, encode_reply(dialect, request, **told)
    )


def _setpoint_bits(drive: Drive, dialect: Dialect) -> int:
    # Typical numbers: the stuffing of real traffic varies by a few bits around them.
    return round(sum(_bits_of(drive.address, dialect, "position", turns) for turns in (1, 2, 3)) / 3)


def _poll_bits(drive: Drive, dialect: Dialect) -> int:
    return max(_bits_of(drive.address, dialect, request, 2) for request in ("multi_turn_angle", "status_1"))
