"""The simulated adapter's ASCII, as python-can's own driver and a terminal would see it; and noise, which it must bear."""

from typing import Any

import can
from hypothesis import given
from hypothesis import strategies as st

from cobra.simulation.slcan import SlcanPort, parse_frame


class Tape:
    """A bus that keeps what is sent on it."""

    def __init__(self) -> None:
        self.frames: list[can.Message] = []

    def send(self, frame: can.Message, timeout: float | None = None) -> None:
        self.frames.append(frame)


def port(bitrate: int = 1_000_000) -> tuple[SlcanPort, Tape, bytearray]:
    tape, out = Tape(), bytearray()
    bus: Any = tape
    return SlcanPort(bus, bitrate, out.extend), tape, out


def test_a_session_as_lawicel_prints_it() -> None:
    p, tape, out = port()
    p.feed(b"\r\rC\rS8\rO\rV\r")
    assert bytes(out) == b"\r\r\r\r\rV1013\r"
    out.clear()
    p.feed(b"t1418A400F401A08C0000\r")
    assert bytes(out) == b"\r"
    assert tape.frames[0].arbitration_id == 0x141
    assert tape.frames[0].data == bytes.fromhex("A400F401A08C0000")
    out.clear()
    p.show(can.Message(arbitration_id=0x241, data=b"\x9a\x32", is_extended_id=False))
    p.show(can.Message(arbitration_id=0x12345, data=b"", is_extended_id=True))
    assert bytes(out) == b"t24129A32\rT000123450\r"


def test_nothing_is_sent_or_shown_before_it_is_open_or_at_another_bit_rate() -> None:
    p, tape, out = port()
    p.feed(b"t1411AA\r")
    p.show(can.Message(arbitration_id=1, is_extended_id=False))
    p.feed(b"S6\rO\rt1411AA\rF\r")
    p.show(can.Message(arbitration_id=1, is_extended_id=False))
    assert bytes(out) == b"\a\r\r\aF80\r"
    assert tape.frames == []


def test_bus_off_refuses_frames_until_the_channel_is_opened_again() -> None:
    p, tape, out = port()

    def refuse(frame: can.Message, timeout: float | None = None) -> None:
        p.show(can.Message(arbitration_id=0x40, is_error_frame=True, is_extended_id=False))

    p.feed(b"S8\rO\r")
    out.clear()
    tape.send = refuse  # type: ignore[method-assign]
    p.feed(b"t1411AA\rF\r")
    assert bytes(out) == b"\aF80\r"


@given(st.lists(st.binary(max_size=40), max_size=20))
def test_noise_is_refused_and_never_raises(chunks: list[bytes]) -> None:
    p, tape, out = port()
    p.feed(b"S8\rO\r")
    for chunk in chunks:
        p.feed(chunk)
    for frame in tape.frames:
        assert frame.dlc <= 8
        assert len(frame.data) in (0, frame.dlc)
    assert len(out) >= sum(chunk.count(b"\r") for chunk in chunks)


@given(st.integers(0, 0x7FF), st.binary(max_size=8))
def test_what_is_shown_is_what_python_can_sends(arbitration_id: int, data: bytes) -> None:
    p, _, out = port()
    p.feed(b"O\r")
    out.clear()
    p.show(can.Message(arbitration_id=arbitration_id, data=data, is_extended_id=False))
    frame = parse_frame(out.decode().rstrip("\r"))
    assert frame is not None
    assert (frame.arbitration_id, bytes(frame.data)) == (arbitration_id, data)
