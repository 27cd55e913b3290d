"""How many bits frames are, against a bit-by-bit construction of the frame, and what a description asks of its bus."""

import msgspec
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from cobra.clock import ManualClock
from cobra.loading import load_description
from cobra.motors.bus import BusError
from cobra.motors.bus_load import channel_load
from cobra.motors.frame_bits import frame_bits
from cobra.motors.open_bus import open_bus
from tests.cobra.motors.handmade_drives import robot


def bits_of_a_frame(arbitration_id: int, data: bytes) -> int:
    """ISO 11898-1, literally: build the bits, run the CRC bit by bit, insert the stuff bits, count."""

    def bits(value: int, width: int) -> list[int]:
        return [value >> k & 1 for k in range(width - 1, -1, -1)]

    frame = [0, *bits(arbitration_id, 11), 0, 0, 0, *bits(len(data), 4)]
    for byte in data:
        frame += bits(byte, 8)
    crc = 0
    for bit in frame:
        crc = (crc << 1 & 0x7FFF) ^ (0x4599 if bit ^ (crc >> 14) else 0)
    wire: list[int] = []
    for bit in frame + bits(crc, 15):
        wire.append(bit)
        if len(wire) >= 5 and len(set(wire[-5:])) == 1:
            wire.append(1 - bit)
    return len(wire) + 1 + 2 + 7 + 3


@given(st.integers(0, 0x7FF), st.binary(max_size=8))
@example(0, bytes(8))
@example(0x7FF, b"\xff" * 8)
@example(0x141, bytes.fromhex("9C 00 00 00 00 00 00 00"))
def test_bits_of_a_frame_are_exact(arbitration_id: int, data: bytes) -> None:
    assert frame_bits(arbitration_id, data) == bits_of_a_frame(arbitration_id, data)


@given(st.integers(0, 0x7FF), st.binary(min_size=8, max_size=8))
def test_an_eight_byte_frame_takes_111_to_135_bits(arbitration_id: int, data: bytes) -> None:
    assert 111 <= frame_bits(arbitration_id, data) <= 135


def test_cobra_at_100_hz_stays_under_60_percent_in_both_dialects() -> None:
    d = load_description("cobra")
    v1 = channel_load(robot(14), d.buses[0])
    v3 = channel_load(robot(14, "rmd-v3"), d.buses[0])
    # notes of the field: 14 setpoints with replies and one status exchange a tick are about 35 %.
    assert v1.load == pytest.approx(0.35, abs=0.01)
    assert v3.load <= 0.60
    assert v3.angle_polls >= 9


def test_the_limit_of_setpoints_and_replies_is_about_305_hz() -> None:
    d = robot(14)
    assert d.buses[0].bitrate / channel_load(d, d.buses[0]).setpoint_bits == pytest.approx(305, abs=5)


def test_275_hz_is_accepted_with_less_polling() -> None:
    d = robot(14, loop_rate_Hz=275.0)
    load = channel_load(d, d.buses[0])
    assert load.complaint() == ""
    assert load.slow_polls == pytest.approx(0.1)


@pytest.mark.parametrize(("protocol", "rate"), [("rmd-v1", 300.0), ("rmd-v3", 275.0)])
def test_an_overloaded_bus_is_refused_with_the_sum_and_a_rate_that_fits(protocol: str, rate: float) -> None:
    d = robot(14, protocol, loop_rate_Hz=rate)
    with pytest.raises(
        BusError, match=r"bus 'main': \d+% of 1000 kbit/s at \d+ Hz \(14 setpoints with replies"
    ) as told:
        open_bus(d, ManualClock())
    possible = float(str(told.value).split("loop_rate_Hz to ")[1].split()[0])
    slower = msgspec.structs.replace(d, teleop=msgspec.structs.replace(d.teleop, loop_rate_Hz=possible))
    assert channel_load(slower, d.buses[0]).complaint() == ""
