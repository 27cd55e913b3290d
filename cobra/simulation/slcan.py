"""The adapter's end of SLCAN, the ASCII protocol of serial CAN adapters (Lawicel CANUSB, CANable and their like).

Lines end with a carriage return. A command that is done is answered with a carriage return, one that is not with BEL.

    S0…S8 bit rate    O open    L listen only    C close    t/T frame (11/29 bits)    r/R remote frame
    V version    N serial number    F status flags    M/m/Z/Y/s accepted and ignored
"""

import threading
from collections.abc import Callable
from typing import Final

import can

OK: Final = b"\r"
ERROR: Final = b"\a"
MAX_LINE: Final = 64
"""Longer than any command; what does not end by then is noise."""
BITRATES: Final = {
    "S0": 10_000, "S1": 20_000, "S2": 50_000, "S3": 100_000, "S4": 125_000, "S5": 250_000, "S6": 500_000, "S7": 750_000,
    "S8": 1_000_000, "S9": 83_300,
}  # fmt: skip
FLAG_QUEUE_FULL: Final = 0x02
FLAG_BUS_ERROR: Final = 0x80
_IGNORED: Final = frozenset("sMmZYWXUQ")
_DIGITS: Final = frozenset("0123456789abcdefABCDEF")


class SlcanPort:
    """One adapter between a program that writes ASCII and a bus. Never raises for what it is fed."""

    def __init__(self, bus: can.BusABC, bitrate: int, write: Callable[[bytes], None]) -> None:
        self._bus = bus
        self._bitrate = bitrate
        self._write = write
        self._line = bytearray()
        self._chosen = bitrate
        self._open = False
        self._listen_only = False
        self._flags = 0
        self._off = False
        self._lock = threading.Lock()

    @property
    def is_open(self) -> bool:
        return self._open

    def feed(self, data: bytes) -> None:
        """Take bytes of the program; whole lines are carried out and answered."""
        answers = bytearray()
        for byte in data:
            if byte == 0x0D:
                line, self._line = bytes(self._line), bytearray()
                answers += self._carry_out(line.decode("latin-1"))
            elif len(self._line) < MAX_LINE:
                self._line.append(byte)
        if answers:
            self._write(bytes(answers))

    def show(self, frame: can.Message) -> None:
        """A frame that is on the bus: tell the program, if it has opened the channel."""
        with self._lock:
            if frame.is_error_frame:
                self._off, self._flags = True, self._flags | FLAG_BUS_ERROR
                return
            if not self._open or self._chosen != self._bitrate:
                return
            self._off = False
        kind = "R" if frame.is_remote_frame else "T"
        head = (
            f"{kind}{frame.arbitration_id:08X}" if frame.is_extended_id else f"{kind.lower()}{frame.arbitration_id:03X}"
        )
        data = "" if frame.is_remote_frame else frame.data.hex().upper()
        self._write(f"{head}{frame.dlc:X}{data}\r".encode())

    def hang_up(self) -> None:
        """The program is gone."""
        self._open = False
        self._line.clear()

    def _carry_out(self, line: str) -> bytes:
        if not line:
            return OK
        command = line[0]
        if command in "tTrR":
            return self._send(line)
        if command == "S":
            if self._open or line not in BITRATES:
                return ERROR
            self._chosen = BITRATES[line]
            return OK
        if line in ("O", "L"):
            self._open, self._listen_only, self._off, self._flags = True, line == "L", False, 0
            return OK
        if line == "C":
            self._open = False
            return OK
        if line == "V":
            return b"V1013\r"
        if line == "N":
            return b"NSIM1\r"
        if line == "F":
            with self._lock:
                flags, self._flags = self._flags, 0
            return f"F{flags:02X}\r".encode()
        return OK if command in _IGNORED else ERROR

    def _send(self, line: str) -> bytes:
        frame = parse_frame(line)
        if frame is None or not self._open or self._listen_only:
            return ERROR
        if self._chosen != self._bitrate:
            self._flags |= FLAG_BUS_ERROR
            return ERROR
        try:
            self._bus.send(frame)
        except can.CanError:
            self._flags |= FLAG_QUEUE_FULL
            return ERROR
        return ERROR if self._off else OK


def parse_frame(line: str) -> can.Message | None:
    """The frame of a line without its end, or None if it is none."""
    extended = line[0] in "TR"
    width = 8 if extended else 3
    digits = line[1:]
    if len(digits) < width + 1 or not _DIGITS.issuperset(digits):
        return None
    arbitration_id, length, data = int(digits[:width], 16), int(digits[width], 16), digits[width + 1 :]
    remote = line[0] in "rR"
    if length > 8 or arbitration_id > (0x1FFFFFFF if extended else 0x7FF) or len(data) != (0 if remote else 2 * length):
        return None
    return can.Message(
        arbitration_id=arbitration_id,
        is_extended_id=extended,
        is_remote_frame=remote,
        dlc=length,
        data=None if remote else bytes.fromhex(data),
    )
