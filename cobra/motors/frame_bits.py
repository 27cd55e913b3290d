"""Exact length of classic CAN frames on the wire.

A frame with an 11-bit id is: start, id, RTR, IDE, r0, DLC, data, CRC-15 (all subject to bit stuffing: after five equal bits
the sender inserts the opposite one), then 10 bits of delimiters, acknowledge and end, and 3 bits between frames.
"""

from functools import cache

FIXED_BITS = 13
"""CRC delimiter, acknowledge slot and delimiter, seven bits of end of frame, three of interframe space."""

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
