"""How much of a CAN channel a robot needs: exact bits of frames, and whether the loop's rate fits.

A classic frame with an 11-bit id is: start, id, RTR, IDE, r0, DLC, data, CRC-15 (all subject to bit stuffing: after five equal
bits the sender inserts the opposite one), then 10 bits of delimiters, acknowledge and end, and 3 bits between frames.
"""

import math
from dataclasses import dataclass
from functools import cache, lru_cache

from cobra.description import Bus, Drive, RobotDescription
from cobra.motors.rmd import DIALECTS, REQUEST_ID, Dialect, Request, encode, encode_reply

FIXED_BITS = 13
"""CRC delimiter, acknowledge slot and delimiter, seven bits of end of frame, three of interframe space."""
DESIGN_LOAD = 0.60
"""Polling is fitted under this part of the bit rate, so that retries and other nodes find room."""
MAX_LOAD = 0.95
"""Beyond this a loop cannot keep its period."""
SLOW_POLLS_PER_TICK = 0.1
"""At least: status of one drive every ten ticks."""
ANGLE_PERIOD_TICKS = 4
"""At least: every v3 drive's angle once in so many ticks."""

_CRC_POLYNOMIAL = 0x4599
_HEADER_BITS = 19


@cache
def _crc_table() -> tuple[int, ...]:
    table = []
    for byte in range(256):
        crc = byte << 7
        for _ in range(8):
            crc = (crc << 1) ^ _CRC_POLYNOMIAL if crc & 0x4000 else crc << 1
        table.append(crc & 0x7FFF)
    return tuple(table)


@cache
def _stuffing_table() -> tuple[tuple[int, int], ...]:
    """For each state and byte the next state and the bits inserted; state = last bit * 8 + length of its run (1 to 4, or 5)."""
    table = []
    for state in range(16):
        for byte in range(256):
            last, run, inserted = state >> 3, state & 7, 0
            for shift in range(7, -1, -1):
                last, run, more = _stuff(last, run, byte >> shift & 1)
                inserted += more
            table.append((last << 3 | run, inserted))
    return tuple(table)


def _stuff(last: int, run: int, bit: int) -> tuple[int, int, int]:
    if bit != last:
        return bit, 1, 0
    # The inserted bit is the opposite one and begins a run of its own.
    return (bit ^ 1, 1, 1) if run == 4 else (bit, run + 1, 0)


def frame_bits(arbitration_id: int, data: bytes | bytearray) -> int:
    """Exact length of a classic 11-bit data frame on the wire, with stuffing and the space after it [bits]."""
    length = len(data)
    header = (arbitration_id & 0x7FF) << 7 | length
    crc_table = _crc_table()
    crc = 0
    # Leading zeros do not change the CRC, so the 19 header bits are taken as three bytes.
    for byte in (header >> 16, header >> 8 & 0xFF, header & 0xFF, *data):
        crc = (crc << 8 & 0x7FFF) ^ crc_table[crc >> 7 ^ byte]
    stuffed_bits = _HEADER_BITS + 8 * length + 15
    bits = ((header << 8 * length) | int.from_bytes(data, "big")) << 15 | crc
    odd = stuffed_bits % 8
    last, run, inserted = 1, 0, 0
    for shift in range(odd):
        last, run, more = _stuff(last, run, bits >> (stuffed_bits - 1 - shift) & 1)
        inserted += more
    state = last << 3 | run
    stuffing = _stuffing_table()
    for byte in (bits & (1 << stuffed_bits - odd) - 1).to_bytes(stuffed_bits // 8, "big"):
        state, more = stuffing[state << 8 | byte]
        inserted += more
    return stuffed_bits + inserted + FIXED_BITS


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

    @property
    def bits_per_tick(self) -> float:
        return self.setpoint_bits + (self.angle_polls + self.slow_polls) * self.poll_bits

    @property
    def load(self) -> float:
        """Part of the bit rate, 0…1 and beyond."""
        return self.bits_per_tick * self.rate_Hz / self.bus.bitrate

    @property
    def wire_time_s(self) -> float:
        """How long the frames of a full tick take on the wire."""
        return (self.setpoint_bits + (self.angle_polls + 1) * self.poll_bits) / self.bus.bitrate

    def complaint(self) -> str:
        """Why the channel cannot carry it, with the sum; empty if it can."""
        if self.load <= MAX_LOAD:
            return ""
        possible = math.floor(MAX_LOAD * self.bus.bitrate / self.bits_per_tick)
        return (
            f"bus {self.bus.name!r}: {self.load:.0%} of {self.bus.bitrate / 1000:g} kbit/s at {self.rate_Hz:g} Hz "
            f"({self.exchanges} setpoints with replies {self.setpoint_bits} bits, {self.angle_polls + self.slow_polls:g} reads "
            f"of {self.poll_bits} bits: {self.bits_per_tick:.0f} bits x {self.rate_Hz:g} Hz); at most {MAX_LOAD:.0%}: "
            f"lower teleop.loop_rate_Hz to {possible} or divide the drives among more buses"
        )


def channel_load(description: RobotDescription, bus: Bus) -> ChannelLoad:
    """Load of one channel of RMD drives with as much polling as fits under `DESIGN_LOAD`."""
    drives = [drive for drive in description.drives if drive.bus == bus.name]
    dialects = [DIALECTS[description.motor_of(drive).protocol] for drive in drives]
    rate = description.teleop.loop_rate_Hz
    setpoint_bits = sum(_setpoint_bits(d, k) for d, k in zip(drives, dialects, strict=True))
    poll_bits = max((_poll_bits(d, k) for d, k in zip(drives, dialects, strict=True)), default=0)
    coarse = sum(dialect.name == "rmd-v3" for dialect in dialects)
    room = max(0.0, DESIGN_LOAD * bus.bitrate / rate - setpoint_bits) / poll_bits if poll_bits else 0.0
    slow = min(1.0, max(SLOW_POLLS_PER_TICK, room))
    angles = min(coarse, max(math.ceil(coarse / ANGLE_PERIOD_TICKS), int(room - slow)))
    return ChannelLoad(bus, rate, setpoint_bits, len(drives), poll_bits, angles, slow)


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
