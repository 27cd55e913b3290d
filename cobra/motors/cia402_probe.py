"""Find CiA 402 drives on a channel without a description: every node id is asked for its device type over SDO."""

import math
import struct
from typing import Final

from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError

from cobra.motors.channel import Channel
from cobra.motors.cia402_frames import (
    SDO_REPLY,
    SDO_REQUEST,
    TEMPERATURE,
    VOLTAGE,
    error_words,
    state_of,
)
from cobra.motors.cia402_network import CanopenChannel, CanopenNode
from cobra.motors.rmd_probe import FoundDrive

LISTEN_S: Final = 0.1
PROFILE_402: Final = 402
NODES: Final = range(1, 127)


def find_cia402(channel: Channel) -> list[FoundDrive]:
    """Ask all node ids at once, then read of those that answered; moves and writes nothing. Raises BusError."""
    network = CanopenChannel(channel)
    present: dict[int, int] = {}

    def note(can_id: int, data: bytearray, _: float) -> None:
        if data[0] & 0xE0 == 0x40:
            present[can_id - SDO_REPLY] = struct.unpack_from("<I", data, 4)[0]

    for node in NODES:
        network.subscribe(SDO_REPLY + node, note)
        network.send_message(SDO_REQUEST + node, bytes.fromhex("4000100000000000"))
    network.read_until(lambda: False, channel.clock.now() + LISTEN_S)
    for node in NODES:
        network.unsubscribe(SDO_REPLY + node)
    return [_read(network, node) for node, kind in sorted(present.items()) if kind & 0xFFFF == PROFILE_402]


def _read(network: CanopenChannel, number: int) -> FoundDrive:
    node = CanopenNode(number)
    network.add_node(node)
    volts, celsius = _number(node, *VOLTAGE) / 10.0, _number(node, *TEMPERATURE) / 10.0
    error, status = _number(node, 0x603F, 0), _number(node, 0x6041, 0)
    told = FoundDrive(
        number, "cia402", celsius, volts,
        (error_words(int(error)),) if error > 0 else (),
        _text(node, 0x1008),
        _text(node, 0x100A),
        {"state": "" if math.isnan(status) else state_of(int(status))},
    )  # fmt: skip
    del network[number]
    return told


def _number(node: CanopenNode, index: int, subindex: int) -> float:
    """NaN where the drive has no such object or does not answer."""
    try:
        variable = node.sdo[index] if subindex == 0 else node.sdo[index][subindex]
        return float(variable.raw)
    except (SdoAbortedError, SdoCommunicationError):
        return float("nan")


def _text(node: CanopenNode, index: int) -> str:
    try:
        return str(node.sdo[index].raw).strip("\0 ")
    except (SdoAbortedError, SdoCommunicationError):
        return ""
