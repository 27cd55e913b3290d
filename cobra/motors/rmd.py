"""The RMD protocol on CAN, byte for byte: dialects v1 (document V1.61) and v3 (documents V3.0 to V3.9).

A request is one classic 11-bit data frame of 8 bytes to 0x140 + address; byte 0 is the command. Exactly one reply comes back,
with the same byte 0, on the same id (v1) or on 0x240 + address (v3). Angles and speeds of v1 are those of the motor's shaft,
of v3 those of the output shaft. Currents stay in counts here: what a count is worth depends on the motor's type.

One table per dialect says everything: request → (command, fields of the request, fields of the reply). A field reads
`name type@byte /counts-per-unit`; numbers are little-endian and what no field covers is 0.
"""

import re
import struct
from dataclasses import dataclass
from typing import Literal

from cobra.description import Protocol

Request = Literal[
    "status_1",  # temperature, voltage, errors
    "status_2",  # temperature, current, speed, position
    "status_3",  # phase currents
    "clear_errors",
    "multi_turn_angle",
    "single_turn_angle",
    "position",
    "position_full_speed",  # at the drive's own limit
    "single_turn_position",
    "single_turn_position_full_speed",
    "increment",  # from where it is
    "speed",
    "torque",
    "stop",  # hold with torque, keep the mode
    "off",  # no torque
    "run",  # resume what was stopped
    "read_gains",
    "write_gains",  # until power-off
    "write_gains_rom",
    "read_gain",  # one gain as a float, documents V4.2 on
    "write_gain",
    "write_gain_rom",
    "read_acceleration",
    "write_acceleration",
    "read_encoder",
    "write_encoder_offset",
    "zero_encoder",  # writes flash, which wears; effective after a restart
    "restart",
    "watchdog",
    "mode",
    "power",
    "release_brake",
    "lock_brake",
    "uptime",
    "version",  # of the firmware, as a date
    "model",
]

WEARS_FLASH: frozenset[Request] = frozenset(
    {"zero_encoder", "write_encoder_offset", "write_gains_rom", "write_gain_rom"}
)
"""Nothing sends these by itself: who wants them says so (`rmd_channel.outgoing`)."""
REQUEST_ID = 0x140
MAX_ADDRESS = 32
WATCHDOG_ALARM = 0xF1
"""Sent unasked about once a second by a v3 drive whose watchdog has cut its output."""

_FIELD = re.compile(r"(\w+) ([iuf])(8|16|32|56)@(\d)(?: /(\d+))?")
_CODES = {"8": "b", "16": "h", "32": "i", "56": "7s"}


class Layout:
    """Where the numbers of an 8-byte frame are, and how many counts make a unit."""

    def __init__(self, fields: str) -> None:
        self.names: tuple[str, ...] = ()
        self._per_unit: tuple[int, ...] = ()
        self._wide = self._real = False
        pattern, position = "<B", 1
        for name, sign, bits, offset, per_unit in _FIELD.findall(fields):
            pattern += "x" * (int(offset) - position)
            pattern += "f" if sign == "f" else _CODES[bits] if sign == "i" or bits == "56" else _CODES[bits].upper()
            position = int(offset) + int(bits) // 8
            self.names += (name,)
            self._per_unit += (int(per_unit or 1),)
            self._wide |= bits == "56"
            self._real |= sign == "f"
        self.struct = struct.Struct(pattern + "x" * (8 - position))
        """Command and raw counts, for those who must be fast."""

    def pack(self, command: int, values: dict[str, float]) -> bytes:
        """Raises ValueError if a value does not fit into its field."""
        try:
            counts: list[float] = [values[name] * k for name, k in zip(self.names, self._per_unit, strict=True)]
            if self._real:
                return self.struct.pack(command, int(counts[0]), counts[1])
            counts = [round(count) for count in counts]
            if self._wide:
                return self.struct.pack(command, int(counts[0]).to_bytes(7, "little", signed=True))
            return self.struct.pack(command, *counts)
        except (struct.error, OverflowError, ValueError) as error:
            raise ValueError(f"command 0x{command:02X} with {values}: does not fit the frame ({error})") from None

    def unpack(self, data: bytes | bytearray) -> dict[str, float]:
        counts = self.struct.unpack(data)[1:]
        if self._wide:
            counts = (int.from_bytes(counts[0], "little", signed=True),)
        return {name: n if k == 1 else n / k for name, n, k in zip(self.names, counts, self._per_unit, strict=True)}


@dataclass(frozen=True, slots=True)
class Entry:
    """One request of a dialect and the reply to it."""

    command: int
    request: Layout
    reply: Layout


class Dialect:
    """The requests of one dialect, the id of its replies, and its error bits."""

    def __init__(
        self,
        name: Protocol,
        reply_id: int,
        command_per_feedback_current: float,
        faults: dict[int, str],
        table: dict[Request, tuple[int, str, str]],
    ) -> None:
        self.name: Protocol = name
        self.reply_id = reply_id
        """Replies come on reply_id + address."""
        self.command_per_feedback_current = command_per_feedback_current
        """Worth of a count in a torque request, as a multiple of that in a reply."""
        self.faults = faults
        """Bit of `flags` → in words."""
        self.entries = {name: Entry(command, Layout(q), Layout(a)) for name, (command, q, a) in table.items()}
        # Gains are bytes or, from V4.2 on, one float under the same command: a drive of ours speaks the former.
        self.requests: dict[int, Request] = {entry.command: name for name, entry in reversed(self.entries.items())}

    def entry(self, request: Request) -> Entry:
        """Raises ValueError if the dialect has no such request."""
        if request not in self.entries:
            raise ValueError(f"{self.name} has no request {request!r}; it has {', '.join(self.entries)}")
        return self.entries[request]


_STATUS_V1 = "temperature_C i8@1, voltage_V u16@3 /10, flags u8@7"
_MOTION_V1 = "temperature_C i8@1, current i16@2, speed_dps i16@4, encoder u16@6"
_GAINS_V1 = "position_kp u8@2, position_ki u8@3, speed_kp u8@4, speed_ki u8@5, current_kp u8@6, current_ki u8@7"
_POSITION = "speed_dps u16@2, angle_deg i32@4 /100"
_TURN = "direction u8@1, speed_dps u16@2, angle_deg u16@4 /100"
_PHASES_V1 = "phase_a_A i16@2 /64, phase_b_A i16@4 /64, phase_c_A i16@6 /64"

RMD_V1 = Dialect(
    "rmd-v1",
    0x140,
    (32 / 2000) / (33 / 2048),
    {0x01: "undervoltage", 0x08: "over-temperature"},
    {
        "status_1": (0x9A, "", _STATUS_V1),
        "status_2": (0x9C, "", _MOTION_V1),
        "status_3": (0x9D, "", _PHASES_V1),
        "clear_errors": (0x9B, "", _STATUS_V1),
        "multi_turn_angle": (0x92, "", "angle_deg i56@1 /100"),
        "single_turn_angle": (0x94, "", "angle_deg u16@6 /100"),
        "position": (0xA4, _POSITION, _MOTION_V1),
        "position_full_speed": (0xA3, "angle_deg i32@4 /100", _MOTION_V1),
        "single_turn_position": (0xA6, _TURN, _MOTION_V1),
        "single_turn_position_full_speed": (0xA5, "direction u8@1, angle_deg u16@4 /100", _MOTION_V1),
        "speed": (0xA2, "speed_dps i32@4 /100", _MOTION_V1),
        "torque": (0xA1, "current i16@4", _MOTION_V1),
        "stop": (0x81, "", ""),
        "off": (0x80, "", ""),
        "run": (0x88, "", ""),
        "read_gains": (0x30, "", _GAINS_V1),
        "write_gains": (0x31, _GAINS_V1, _GAINS_V1),
        "write_gains_rom": (0x32, _GAINS_V1, _GAINS_V1),
        "read_acceleration": (0x33, "", "acceleration_dps2 i32@4"),
        "write_acceleration": (0x34, "acceleration_dps2 i32@4", "acceleration_dps2 i32@4"),
        "read_encoder": (0x90, "", "encoder u16@2, raw u16@4, offset u16@6"),
        "write_encoder_offset": (0x91, "offset u16@6", "offset u16@6"),
        "zero_encoder": (0x19, "", "offset u16@6"),
    },
)

_MOTION_V3 = "temperature_C i8@1, current i16@2, speed_dps i16@4, angle_deg i16@6"
_GAINS_V3 = "current_kp u8@2, current_ki u8@3, speed_kp u8@4, speed_ki u8@5, position_kp u8@6, position_ki u8@7"
_GAIN = "index u8@1, gain f32@4"
_TURN_REPLY_V3 = "temperature_C i8@1, current i16@2, speed_dps i16@4, encoder u16@6"
_ACCELERATION_V3 = "index u8@1, acceleration_dps2 u32@4"
_PHASES_V3 = "phase_a_A i16@2 /100, phase_b_A i16@4 /100, phase_c_A i16@6 /100"

RMD_V3 = Dialect(
    "rmd-v3",
    0x240,
    1.0,
    {
        0x0002: "motor stalled",
        0x0004: "undervoltage",
        0x0008: "overvoltage",
        0x0010: "overcurrent",
        0x0040: "power overrun",
        0x0080: "calibration parameter not written",
        0x0100: "overspeed",
        0x1000: "motor over-temperature",
        0x2000: "encoder calibration error",
    },
    {
        "status_1": (0x9A, "", "temperature_C i8@1, brake_released u8@3, voltage_V u16@4 /10, flags u16@6"),
        "status_2": (0x9C, "", _MOTION_V3),
        "status_3": (0x9D, "", _PHASES_V3),
        "multi_turn_angle": (0x92, "", "angle_deg i32@4 /100"),
        "single_turn_angle": (0x94, "", "angle_deg i16@6 /100"),
        "position": (0xA4, _POSITION, _MOTION_V3),
        "single_turn_position": (0xA6, _TURN, _TURN_REPLY_V3),
        "increment": (0xA8, _POSITION, _MOTION_V3),
        "speed": (0xA2, "speed_dps i32@4 /100", _MOTION_V3),
        "torque": (0xA1, "current i16@4", _MOTION_V3),
        "stop": (0x81, "", ""),
        "off": (0x80, "", ""),
        "read_gains": (0x30, "", _GAINS_V3),
        "write_gains": (0x31, _GAINS_V3, _GAINS_V3),
        "write_gains_rom": (0x32, _GAINS_V3, _GAINS_V3),
        "read_acceleration": (0x42, "index u8@1", _ACCELERATION_V3),
        "write_acceleration": (0x43, _ACCELERATION_V3, _ACCELERATION_V3),
        "read_encoder": (0x60, "", "encoder i32@4"),
        "write_encoder_offset": (0x63, "offset i32@4", "offset i32@4"),
        "zero_encoder": (0x64, "", "offset i32@4"),
        "restart": (0x76, "", ""),
        "watchdog": (0xB3, "timeout_ms u32@4", "timeout_ms u32@4"),
        "read_gain": (0x30, "index u8@1", _GAIN),
        "write_gain": (0x31, _GAIN, _GAIN),
        "write_gain_rom": (0x32, _GAIN, _GAIN),
        "mode": (0x70, "", "mode u8@7"),
        "power": (0x71, "", "power_W u16@6 /10"),
        "release_brake": (0x77, "", ""),
        "lock_brake": (0x78, "", ""),
        "uptime": (0xB1, "", "milliseconds u32@4"),
        "version": (0xB2, "", "date u32@4"),
        "model": (0xB5, "", "text u56@1"),
    },
)

DIALECTS: dict[Protocol, Dialect] = {"rmd-v1": RMD_V1, "rmd-v3": RMD_V3}


def encode(dialect: Dialect, request: Request, **values: float) -> bytes:
    """The 8 bytes of a request, its values in the units of the table.

    Raises:
        ValueError: the dialect has no such request, or a value does not fit.
    """
    entry = dialect.entry(request)
    return entry.request.pack(entry.command, values)


def decode(dialect: Dialect, request: Request, data: bytes | bytearray) -> dict[str, float]:
    """The values of the reply to `request`, in the units of the table.

    Raises:
        ValueError: not 8 bytes, or the reply to something else.
    """
    entry = dialect.entry(request)
    if len(data) != 8 or not _answers(entry.command, data[0]):
        raise ValueError(f"{bytes(data).hex(' ')!r} is no reply of {dialect.name} to {request} (0x{entry.command:02X})")
    return entry.reply.unpack(data)


def encode_reply(dialect: Dialect, request: Request, **values: float) -> bytes:
    """What a drive answers. Raises ValueError like `encode`."""
    entry = dialect.entry(request)
    return entry.reply.pack(entry.command, values)


def decode_request(dialect: Dialect, data: bytes | bytearray) -> tuple[Request, dict[str, float]]:
    """What a drive is asked.

    Raises:
        ValueError: not 8 bytes, or a command that the dialect does not have.
    """
    if len(data) != 8 or data[0] not in dialect.requests:
        raise ValueError(f"{bytes(data).hex(' ')!r} is no request of {dialect.name}")
    request = dialect.requests[data[0]]
    return request, dialect.entries[request].request.unpack(data)


def model_text(values: dict[str, float]) -> str:
    """The reply to `model` as text: at most seven characters of ASCII."""
    raw = int(values["text"]).to_bytes(7, "little", signed=True)
    return raw.split(b"\0")[0].decode("ascii", "replace").strip()


def fault_words(dialect: Dialect, flags: int) -> tuple[str, ...]:
    """The error bits of status 1 in words; bits that the document does not define say nothing."""
    return tuple(words for bit, words in dialect.faults.items() if flags & bit)


def _answers(command: int, answer: int) -> bool:
    # V1.61 prints 0x9A as the first byte of the reply to 0x9B; drives send either.
    return answer == command or (command == 0x9B and answer == 0x9A)
