"""CANopen drives by the profile CiA 402, as bytes and words: identifiers, objects, states, errors.

Numbers: CiA 301 (communication, 4.2), CiA 402 (IEC 61800-7-201, state machine) and, where the profile leaves it to the maker,
the EPOS4 of maxon. Numbers on the wire are little-endian.
"""

import math
import struct
from typing import Final, Literal, NamedTuple

from cobra.description import Motor

SYNC: Final = 0x080
EMERGENCY: Final = 0x080
"""+ node; so are the next four."""
TPDO1: Final = 0x180
RPDO1: Final = 0x200
SDO_REPLY: Final = 0x580
SDO_REQUEST: Final = 0x600
HEARTBEAT: Final = 0x700
MASTER_NODE: Final = 127
"""Of the controller, whose heartbeat the drives watch."""

NMT_OPERATIONAL: Final = 0x05
NMT_BOOT_UP: Final = 0x00

CYCLIC_SYNCHRONOUS_POSITION: Final = 8

TARGETS = struct.Struct("<Hi")
"""RPDO 1: controlword 6040, target position 607A."""
ACTUALS = struct.Struct("<Hih")
"""TPDO 1: statusword 6041, position actual 6064, torque actual 6077."""
TARGETS_MAP: Final = ((0x6040, 0, 16), (0x607A, 0, 32))
ACTUALS_MAP: Final = ((0x6041, 0, 16), (0x6064, 0, 32), (0x6077, 0, 16))
OTHER_PDOS: Final = (2, 3, 4)
"""Switched off: drives are shipped with PDOs that would load the bus."""

State = Literal[
    "not ready to switch on",
    "switch on disabled",
    "ready to switch on",
    "switched on",
    "operation enabled",
    "quick stop active",
    "fault reaction active",
    "fault",
]

_STATES: Final[tuple[tuple[int, int, State], ...]] = (
    (0x4F, 0x00, "not ready to switch on"),
    (0x4F, 0x40, "switch on disabled"),
    (0x6F, 0x21, "ready to switch on"),
    (0x6F, 0x23, "switched on"),
    (0x6F, 0x27, "operation enabled"),
    (0x6F, 0x07, "quick stop active"),
    (0x4F, 0x0F, "fault reaction active"),
    (0x4F, 0x08, "fault"),
)

DISABLE_VOLTAGE: Final = 0x0000
QUICK_STOP: Final = 0x0002
SHUTDOWN: Final = 0x0006
SWITCH_ON: Final = 0x0007
ENABLE_OPERATION: Final = 0x000F
FAULT_RESET: Final = 0x0080

_TOWARDS_OPERATION: Final[dict[State, int]] = {
    "switch on disabled": SHUTDOWN,
    "ready to switch on": SWITCH_ON,
    "switched on": ENABLE_OPERATION,
    "operation enabled": ENABLE_OPERATION,
    "quick stop active": ENABLE_OPERATION,
    "fault": FAULT_RESET,
}

VOLTAGE: Final = (0x2200, 1)
"""EPOS4: power supply voltage, 0.1 V."""
TEMPERATURE: Final = (0x3201, 1)
"""EPOS4: temperature of the power stage, 0.1 °C."""

_ERRORS: Final = {
    0x1000: "generic error",
    0x1080: "initialisation error",
    0x2310: "overcurrent",
    0x2320: "power stage protection: short circuit or too high a load",
    0x3210: "overvoltage",
    0x3220: "undervoltage",
    0x4210: "over-temperature",
    0x4380: "motor over-temperature",
    0x5113: "logic supply too low",
    0x5280: "hardware defect",
    0x5480: "hardware error",
    0x6080: "sign of life error",
    0x6320: "parameters do not fit each other: commission the drive with its maker's tool",
    0x7320: "position sensor error: check the encoder's cable",
    0x7380: "position sensor breach: check the encoder's cable",
    0x7381: "position sensor resolution error",
    0x7382: "position sensor index error",
    0x7388: "hall sensor error",
    0x738C: "sensors contradict each other",
    0x8110: "CAN overrun",
    0x8120: "CAN error passive: check cable, termination and bit rate",
    0x8130: "the controller's heartbeat was lost",
    0x8140: "recovered from bus-off",
    0x8150: "two nodes use one CAN id",
    0x8180: "CAN clock error",
    0x81FD: "it was bus-off",
    0x8210: "a PDO was too short",
    0x8250: "setpoints stopped arriving",
    0x8611: "following error: it could not keep up with its setpoint",
    0x8A80: "negative limit switch",
    0x8A81: "positive limit switch",
    0x8A82: "software position limit",
}
_ERROR_FAMILIES: Final = {
    0x1: "generic error", 0x2: "current", 0x3: "voltage", 0x4: "temperature", 0x5: "hardware", 0x6: "software",
    0x7: "sensor or additional module", 0x8: "monitoring or communication", 0xF: "maker's own error",
}  # fmt: skip

SDO_ABORTS: Final = {
    0x05040000: "no answer in time",
    0x06010002: "read only",
    0x06020000: "there is no such object",
    0x06040041: "it cannot be mapped",
    0x06040042: "the mapping is too long",
    0x06070010: "wrong length",
    0x06090011: "there is no such subindex",
    0x06090030: "the value is out of range",
    0x08000022: "not in this state",
}


def state_of(statusword: int) -> State:
    """State by the statusword's bits 0…3, 5 and 6; a combination that the profile does not know is not ready."""
    return next((state for mask, bits, state in _STATES if statusword & mask == bits), "not ready to switch on")


def statusword_of(state: State) -> int:
    """The bits of the statusword that a drive shows in a state, with voltage enabled (bit 4)."""
    return next(bits for _, bits, name in _STATES if name == state) | 0x10


def towards_operation(state: State) -> int:
    """The controlword that leads on towards `operation enabled`."""
    return _TOWARDS_OPERATION.get(state, DISABLE_VOLTAGE)


def error_words(code: int) -> str:
    """An emergency's error code in words; empty for 0, which says that all errors are gone."""
    if code == 0:
        return ""
    words = _ERRORS.get(code) or _ERRORS.get(code & 0xFF00) or _ERROR_FAMILIES.get(code >> 12, "unknown error")
    return f"{words} (0x{code:04X})"


class Scale(NamedTuple):
    """What a drive's counts are worth at the output shaft."""

    increments_per_rad: float
    amperes_per_permille: float


def scale_of(motor: Motor) -> Scale:
    """Position in encoder increments of the motor's shaft; torque (6077) in ‰ of the rated, a count of the description."""
    return Scale(2.0**motor.encoder_bits * motor.gear_ratio / math.tau, motor.current_per_count_A)
