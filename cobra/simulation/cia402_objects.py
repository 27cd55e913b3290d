"""The object dictionary of a simulated CiA 402 drive, served over SDO by the server of the `canopen` package."""

import struct
from collections.abc import Callable, Mapping
from typing import Final

from canopen.objectdictionary import ODVariable
from canopen.sdo.exceptions import SdoAbortedError
from canopen.sdo.server import SdoServer

from cobra.motors.cia402_frames import CYCLIC_SYNCHRONOUS_POSITION, SDO_REPLY, SDO_REQUEST
from cobra.motors.cia402_objects import object_dictionary
from cobra.simulation.node import Frame

Key = tuple[int, int]

NOT_THERE: Final = 0x06020000
NO_SUBINDEX: Final = 0x06090011
READ_ONLY: Final = 0x06010002
WRONG_LENGTH: Final = 0x06070010
OUT_OF_RANGE: Final = 0x06090030
WRONG_STATE: Final = 0x08000022
PDO_INVALID: Final = 1 << 31
SUPPORTED_MODES: Final = 0x3A5
"""PPM, PVM, HMM, CSP, CSV and CST, as EPOS4 says."""

_ALLOWED: Final[Mapping[Key, Callable[[int], bool]]] = {
    (0x60C2, 1): lambda ms: 0 <= ms <= 100,
    (0x60C2, 2): lambda exponent: exponent == -3,
    (0x6060, 0): lambda mode: mode == CYCLIC_SYNCHRONOUS_POSITION,
    (0x605A, 0): lambda option: option in (0, 1, 2, 5, 6),
    (0x6007, 0): lambda option: 0 <= option <= 3,
}


class Objects:
    """What the drive keeps, and what it reads anew whenever it is asked."""

    def __init__(self, node: int, live: Mapping[Key, Callable[[], int]], texts: Mapping[int, str]) -> None:
        self.object_dictionary = object_dictionary()
        self._live = live
        self._texts = texts
        self._kept: dict[Key, int] = {(0x605A, 0): 6, (0x6007, 0): 3, (0x6065, 0): 2000, (0x60C2, 2): -3}
        for number in range(4):
            self._kept |= {
                (0x1400 + number, 0): 2, (0x1400 + number, 1): 0x200 + 0x100 * number + node, (0x1400 + number, 2): 255,
                (0x1800 + number, 0): 2, (0x1800 + number, 1): 0x180 + 0x100 * number + node, (0x1800 + number, 2): 255,
            }  # fmt: skip
        self._out: list[Frame] = []
        self._server = SdoServer(SDO_REQUEST + node, SDO_REPLY + node, self)
        self._server.network = self  # type: ignore[assignment]  # it only sends

    def ask(self, arbitration_id: int, data: bytes) -> list[Frame]:
        """The answer to an SDO request."""
        if len(data) == 8:
            self._server.on_request(arbitration_id, bytearray(data), 0.0)
        out, self._out = self._out, []
        return out

    def send_message(self, arbitration_id: int, data: bytes, remote: bool = False) -> None:
        """Called by the server."""
        self._out.append((arbitration_id, bytes(data)))

    def __getitem__(self, key: Key) -> int:
        live = self._live.get(key)
        return live() if live is not None else self._kept.get(key, 0)

    def mapping(self, index: int) -> list[tuple[Key, int]]:
        """Objects of a PDO mapping, with their bytes."""
        entries = [self[index, subindex] for subindex in range(1, self[index, 0] + 1)]
        return [((entry >> 16, entry >> 8 & 0xFF), (entry & 0xFF) // 8) for entry in entries]

    def pack(self, index: int) -> bytes:
        """The bytes of a PDO to send."""
        return b"".join(_bytes(self[key], size) for key, size in self.mapping(index))

    # -- what the server asks ---------------------------------------------------------------------------------------

    def get_data(self, index: int, subindex: int, check_readable: bool = False) -> bytes:
        variable = self._find(index, subindex)
        if index in self._texts:
            return self._texts[index].encode()
        return _bytes(self[index, subindex], len(variable) // 8)

    def set_data(self, index: int, subindex: int, data: bytes, check_writable: bool = False) -> None:
        variable = self._find(index, subindex)
        if not variable.writable:
            raise SdoAbortedError(READ_ONLY)
        if 8 * len(data) != len(variable):
            raise SdoAbortedError(WRONG_LENGTH)
        value = int(variable.decode_raw(bytes(data)))
        key = (index, subindex)
        if key in _ALLOWED and not _ALLOWED[key](value):
            raise SdoAbortedError(OUT_OF_RANGE)
        self._check_pdo_rules(key, value)
        self._kept[key] = value

    def _check_pdo_rules(self, key: Key, value: int) -> None:
        """CiA 301: a mapping changes only while its PDO is invalid, and its entries only while it counts none."""
        index, subindex = key
        if not (0x1600 <= index < 0x1604 or 0x1A00 <= index < 0x1A04):
            return
        if not self[index - 0x200, 1] & PDO_INVALID or (subindex and self[index, 0]):
            raise SdoAbortedError(WRONG_STATE)
        if subindex:
            self._find(value >> 16, value >> 8 & 0xFF)

    def _find(self, index: int, subindex: int) -> ODVariable:
        if index not in self.object_dictionary:
            raise SdoAbortedError(NOT_THERE)
        found = self.object_dictionary[index]
        if isinstance(found, ODVariable):
            return found
        if subindex not in found:
            raise SdoAbortedError(NO_SUBINDEX)
        return found[subindex]


def _bytes(value: int, size: int) -> bytes:
    return struct.pack("<q", value)[:size]
