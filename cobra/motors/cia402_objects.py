"""The objects of a CiA 402 drive that a robot needs, as an object dictionary of the `canopen` package."""

from typing import Final

import canopen
from canopen.objectdictionary import ODRecord, ODVariable, datatypes

_U8, _U16, _U32 = datatypes.UNSIGNED8, datatypes.UNSIGNED16, datatypes.UNSIGNED32
_I8, _I16, _I32 = datatypes.INTEGER8, datatypes.INTEGER16, datatypes.INTEGER32
_TEXT = datatypes.VISIBLE_STRING

_VARIABLES: Final = (
    (0x1000, "Device type", _U32, "ro"),
    (0x1001, "Error register", _U8, "ro"),
    (0x1008, "Device name", _TEXT, "ro"),
    (0x100A, "Software version", _TEXT, "ro"),
    (0x1017, "Producer heartbeat time", _U16, "rw"),
    (0x6007, "Abort connection option", _I16, "rw"),
    (0x603F, "Error code", _U16, "ro"),
    (0x6040, "Controlword", _U16, "rw"),
    (0x6041, "Statusword", _U16, "ro"),
    (0x605A, "Quick stop option", _I16, "rw"),
    (0x6060, "Modes of operation", _I8, "rw"),
    (0x6061, "Modes of operation display", _I8, "ro"),
    (0x6064, "Position actual value", _I32, "ro"),
    (0x6065, "Following error window", _U32, "rw"),
    (0x6077, "Torque actual value", _I16, "ro"),
    (0x607A, "Target position", _I32, "rw"),
    (0x6502, "Supported drive modes", _U32, "ro"),
)
_RECORDS: Final = (
    (0x1016, "Consumer heartbeat time", ((1, _U32, "rw"), (2, _U32, "rw"))),
    (0x1018, "Identity", ((1, _U32, "ro"), (2, _U32, "ro"), (3, _U32, "ro"), (4, _U32, "ro"))),
    (0x2200, "Power supply", ((1, _U16, "ro"),)),
    (0x3201, "Temperature", ((1, _I16, "ro"),)),
    (0x60C2, "Interpolation time period", ((1, _U8, "rw"), (2, _I8, "rw"))),
)


def object_dictionary() -> canopen.ObjectDictionary:
    """The objects that a robot needs, for both ends of the wire."""
    od = canopen.ObjectDictionary()
    for index, name, kind, access in _VARIABLES:
        od.add_object(_variable(name, index, 0, kind, access))
    for index, name, members in _RECORDS:
        record = ODRecord(name, index)
        record.add_member(_variable(f"{name} count", index, 0, _U8, "ro"))
        for subindex, kind, access in members:
            record.add_member(_variable(f"{name} {subindex}", index, subindex, kind, access))
        od.add_object(record)
    for communication, mapping in ((0x1400, 0x1600), (0x1800, 0x1A00)):
        for number in range(4):
            _add_pdo(od, communication + number, mapping + number)
    return od


def _add_pdo(od: canopen.ObjectDictionary, communication: int, mapping: int) -> None:
    record = ODRecord(f"PDO {communication:04X}", communication)
    for subindex, kind in ((0, _U8), (1, _U32), (2, _U8)):
        record.add_member(_variable(f"{communication:04X}.{subindex}", communication, subindex, kind, "rw"))
    od.add_object(record)
    # A record, though the profile says array: the package asks a device how long its arrays are, and this one is just empty.
    entries = ODRecord(f"PDO mapping {mapping:04X}", mapping)
    for subindex in range(9):
        entries.add_member(_variable(f"{mapping:04X}.{subindex}", mapping, subindex, _U32 if subindex else _U8, "rw"))
    od.add_object(entries)


def _variable(name: str, index: int, subindex: int, kind: int, access: str) -> ODVariable:
    variable = ODVariable(name, index, subindex)
    variable.data_type = kind
    variable.access_type = access
    return variable
