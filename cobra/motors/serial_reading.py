"""Bytes of a serial adapter fetched as many at a time as there are.

python-can's slcan driver asks its port for one byte after the other, each by two system calls: nearly
100 µs for each reply, in the loop's own thread. It is given this port instead, which answers from what it has fetched.
"""

import os
import select
from typing import Any

import can
import serial

CHUNK = 4096


class ReadAhead:
    """A pyserial port (a device or socket://…) whose reads of one byte are cheap; all else is the port's own."""

    def __init__(self, port: Any) -> None:
        self._port = port
        self._fetched = b""
        self._next = 0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._port, name)

    @property
    def write_timeout(self) -> float | None:
        """The driver changes it [s]."""
        timeout: float | None = self._port.write_timeout
        return timeout

    @write_timeout.setter
    def write_timeout(self, timeout: float | None) -> None:
        self._port.write_timeout = timeout

    @property
    def in_waiting(self) -> int:
        """Bytes that can be read at once."""
        return len(self._fetched) - self._next

    def read(self, size: int = 1) -> bytes:
        """Up to `size` bytes; none when there are none within the port's timeout.

        Raises:
            serial.SerialException: the device is gone.
        """
        begin = self._next
        if begin == len(self._fetched):
            self._fetch()
            begin = 0
        data = self._fetched[begin : begin + size]
        self._next = begin + len(data)
        return data

    def reset_input_buffer(self) -> None:
        self._fetched, self._next = b"", 0
        self._port.reset_input_buffer()

    def _fetch(self) -> None:
        self._fetched, self._next = b"", 0
        if not self._port.is_open:
            raise serial.PortNotOpenError
        device = self._port.fileno()
        ready, _, _ = select.select([device], [], [], self._port.timeout)
        if not ready:
            return
        try:
            self._fetched = os.read(device, CHUNK)
        except BlockingIOError:
            return
        except OSError as error:
            raise serial.SerialException(f"read failed: {error}") from error
        if not self._fetched:
            raise serial.SerialException("the device reports data and has none: it is gone")


def read_ahead(bus: can.BusABC) -> None:
    """Let an open bus read ahead, where it is a serial one and the system knows its port by a number (POSIX)."""
    port = getattr(bus, "serialPortOrig", None)
    if port is not None and os.name == "posix":
        bus.serialPortOrig = ReadAhead(port)  # type: ignore[attr-defined]
