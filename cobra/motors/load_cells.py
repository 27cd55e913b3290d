"""The bytes of load cells: readings that they put on the bus by themselves, as the description says."""

import struct
from typing import Final

from cobra.description import LoadCell

FORMATS: Final = {
    "i16le": "<h", "i16be": ">h", "u16le": "<H", "u16be": ">H",
    "i32le": "<i", "i32be": ">i", "f32le": "<f", "f32be": ">f",
}  # fmt: skip
INTEGER_LIMITS: Final = {"h": (-(2**15), 2**15 - 1), "H": (0, 2**16 - 1), "i": (-(2**31), 2**31 - 1)}


def decode_reading(cell: LoadCell, data: bytes) -> float:
    """The force in a cell's frame [N].

    Raises:
        ValueError: the frame is too short for it.
    """
    form = FORMATS[cell.type]
    if len(data) < cell.byte_offset + cell.size:
        raise ValueError(
            f"load cell of {cell.tendon}: {len(data)} bytes, its reading ends at byte {cell.byte_offset + cell.size}"
        )
    return float(struct.unpack_from(form, data, cell.byte_offset)[0]) * cell.scale_N


def encode_reading(cell: LoadCell, force_N: float, frame: bytearray) -> None:
    """Put a force into its bytes of a frame; what they cannot hold stays at their end."""
    form, counts = FORMATS[cell.type], force_N / cell.scale_N
    if form[1] in INTEGER_LIMITS:
        low, high = INTEGER_LIMITS[form[1]]
        counts = min(high, max(low, round(counts)))
    struct.pack_into(form, frame, cell.byte_offset, counts)
