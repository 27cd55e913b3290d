"""Simulated load cells send what the tendons beside the drives pull, with the noise and bias of the description."""

import can
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from cobra.clock import ManualClock
from cobra.description import LoadCell
from cobra.loading import load_description
from cobra.motors.load_cells import FORMATS, decode_reading, encode_reading
from cobra.simulation.drives import world_of
from tests.cobra.simulation.test_drives import Springs

COBRA = load_description("cobra")
CELLS = (
    LoadCell(tendon="S1", bus="main", frame_id=0x301, scale_N=0.01, rate_Hz=100.0, noise_N=0.05, bias_N=0.4),
    LoadCell(tendon="E1", bus="main", frame_id=0x301, byte_offset=4, type="f32be", scale_N=1.0, rate_Hz=100.0),
    LoadCell(tendon="W3", bus="main", frame_id=0x302, type="u16be", scale_N=0.002, rate_Hz=40.0),
)
MEASURED = replace(COBRA, load_cells=CELLS)


def frames(seconds: float, bias_N: float = 0.0, seed: int = 3) -> tuple[list[can.Message], np.ndarray]:
    """What is on the bus while nobody asks, and what the tendons really pull."""
    clock = ManualClock()
    plant = Springs(bias_N=bias_N)
    options = {"stepping": "inline", "seed": seed, "clock": clock, "description": MEASURED}
    with can.Bus(interface="cobra-sim", channel="cobra", twin=plant, **options) as bus:
        heard = []
        while clock.now() < 1000.0 + seconds:
            if (frame := bus.recv(0.01)) is not None:
                heard.append(frame)
        return heard, world_of("cobra").load.copy()


def readings(heard: list[can.Message], cell: LoadCell) -> np.ndarray:
    return np.array([decode_reading(cell, bytes(f.data)) for f in heard if f.arbitration_id == cell.frame_id])


def test_they_send_by_themselves_at_their_rate() -> None:
    heard, _ = frames(2.0, bias_N=5.0)
    assert sum(f.arbitration_id == 0x301 for f in heard) == pytest.approx(200, abs=2)
    assert sum(f.arbitration_id == 0x302 for f in heard) == pytest.approx(80, abs=2)


def test_they_read_the_tension_with_the_noise_and_bias_that_are_described() -> None:
    heard, load = frames(4.0, bias_N=20.0)
    # By then the tendons have pulled the unpowered drives as far as their gears let them.
    noisy, exact, coarse = (readings(heard, cell)[-60:] for cell in CELLS)
    tension = load[list(COBRA.tendon_drives)]
    assert noisy.std() == pytest.approx(0.05, rel=0.3)
    assert 0.02 < abs(noisy.mean() - tension[0]) < 0.45
    np.testing.assert_allclose(exact, tension[1], rtol=1e-6)
    np.testing.assert_allclose(coarse, tension[11], atol=0.001)


@given(
    kind=st.sampled_from(sorted(FORMATS)),
    offset=st.integers(0, 4),
    force=st.floats(0.0, 60.0),
    scale=st.floats(0.01, 1.0),
)
def test_a_reading_comes_back_to_half_a_count(kind: str, offset: int, force: float, scale: float) -> None:
    cell = LoadCell(tendon="S1", bus="main", frame_id=1, byte_offset=offset, type=kind, scale_N=scale, rate_Hz=1.0)  # type: ignore[arg-type]
    frame = bytearray(8)
    encode_reading(cell, force, frame)
    assert decode_reading(cell, bytes(frame)) == pytest.approx(force, abs=0.5 * scale + 1e-5)


def test_bytes_by_hand() -> None:
    cell = LoadCell(tendon="S1", bus="main", frame_id=1, byte_offset=2, type="i16be", scale_N=0.01, rate_Hz=1.0)
    frame = bytearray(8)
    encode_reading(cell, 12.34, frame)
    assert frame == bytes.fromhex("0000 04d2 0000 0000".replace(" ", ""))
    encode_reading(cell, 1e9, frame)
    assert frame[2:4] == b"\x7f\xff"
    with pytest.raises(ValueError, match="ends at byte 4"):
        decode_reading(cell, b"\0\0\0")
