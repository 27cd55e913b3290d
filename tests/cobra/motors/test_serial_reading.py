"""A port that reads ahead gives the driver the same bytes as the port itself, and fails as clearly."""

import os
import sys
from collections.abc import Iterator
from typing import Any

import can
import pytest
import serial
from hypothesis import given
from hypothesis import strategies as st

from cobra.motors.serial_reading import ReadAhead, read_ahead

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals of POSIX")


class Cable:
    """A pseudo-terminal; `far` is the adapter's end."""

    def __init__(self) -> None:
        import tty  # POSIX only

        self.far, near = os.openpty()
        tty.setraw(near)
        self.port = serial.serial_for_url(os.ttyname(near), timeout=0.01)
        os.close(near)

    def close(self) -> None:
        self.port.close()
        if self.far >= 0:
            os.close(self.far)
            self.far = -1


@pytest.fixture
def cable() -> Iterator[Cable]:
    cable = Cable()
    yield cable
    cable.close()


@given(chunks=st.lists(st.binary(min_size=1, max_size=60), max_size=6), size=st.integers(1, 9))
def test_every_byte_comes_once_and_in_order(chunks, size):
    cable = Cable()
    try:
        ahead = ReadAhead(cable.port)
        got = bytearray()
        for chunk in chunks:
            os.write(cable.far, chunk)
            while data := ahead.read(size):
                assert len(data) <= size
                got += data
        assert bytes(got) == b"".join(chunks)
        assert ahead.in_waiting == 0
    finally:
        cable.close()


def test_what_was_fetched_is_thrown_away_with_the_rest(cable):
    ahead = ReadAhead(cable.port)
    os.write(cable.far, b"abc")
    assert ahead.read(1) == b"a"
    assert ahead.in_waiting == 2
    ahead.reset_input_buffer()
    assert ahead.read(1) == b""


def test_a_device_that_went_away_and_a_closed_one_are_errors_of_the_port(cable):
    ahead = ReadAhead(cable.port)
    os.close(cable.far)
    cable.far = -1
    with pytest.raises(serial.SerialException):
        ahead.read(1)
    cable.port.close()
    with pytest.raises(serial.SerialException):
        ahead.read(1)


def test_all_else_is_the_port_s_own(cable):
    ahead = ReadAhead(cable.port)
    ahead.write_timeout = 0.2
    assert cable.port.write_timeout == ahead.write_timeout == 0.2
    ahead.write(b"hello")
    assert os.read(cable.far, 10) == b"hello"


def frames(bus: can.BusABC) -> list[tuple[int, bytes]]:
    out = []
    for _ in range(100):  # an acknowledgement ends a read without a frame
        if (frame := bus.recv(0.01)) is not None:
            out.append((frame.arbitration_id, bytes(frame.data)))
    return out


def test_the_driver_reads_the_same_frames_through_it(cable):
    lines = b"".join(b"t%03X4%08X\r\r" % (0x141 + k, k * 77777) for k in range(30))
    read: list[Any] = []
    for reads_ahead in (False, True):
        bus = can.Bus(
            interface="slcan", channel=cable.port.port, bitrate=1_000_000, sleep_after_open=0, ignore_config=True
        )
        if reads_ahead:
            read_ahead(bus)
            assert isinstance(bus.serialPortOrig, ReadAhead)  # type: ignore[attr-defined]
        os.write(cable.far, lines)
        read.append(frames(bus))
        bus.shutdown()
    assert len(read[0]) == 30
    assert read[0] == read[1]
