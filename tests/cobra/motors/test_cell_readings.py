"""Load cells behind the motor bus: what is believed, and what is not however well it looks."""

from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from cobra.clock import ManualClock
from cobra.description import LoadCell
from cobra.loading import load_description
from cobra.motors.bus_load import channel_load
from cobra.motors.cell_readings import CellCalibration, LoadCells
from cobra.motors.load_cells import encode_reading
from cobra.motors.open_bus import open_bus
from cobra.simulation.drives import world_of
from tests.cobra.simulation.test_drives import Springs

COBRA = load_description("cobra")
S1 = LoadCell(tendon="S1", bus="main", frame_id=0x301, scale_N=0.01, rate_Hz=100.0, noise_N=0.05)
E1 = LoadCell(tendon="E1", bus="main", frame_id=0x301, byte_offset=4, type="f32be", scale_N=1.0, rate_Hz=100.0)
TARED = {name: CellCalibration(offset_N=1.5) for name in ("S1", "E1")}


class Amplifier:
    """Sends what it is told to, into the cells of S1 and E1."""

    def __init__(self, *, tared: bool = True, **change: object) -> None:
        self.clock, self.counts = ManualClock(), Counter[str]()
        self.s1 = replace(S1, **change)
        self.cells = LoadCells(replace(COBRA, load_cells=(self.s1, E1)), self.clock)
        if tared:
            self.cells.calibrate(TARED)
        self.take = self.cells.listeners("main", self.counts)[0x301]

    def send(self, s1: float, e1: float = 5.0) -> None:
        frame = bytearray(8)
        encode_reading(self.s1, s1, frame)
        encode_reading(E1, e1, frame)
        self.clock.advance(0.01)
        self.take(frame)

    def s1_says(self) -> tuple[float, str]:
        told = self.cells.readings()
        return float(told.tension[0]), told.trouble[0]


def test_a_tension_is_what_it_reads_without_its_tare() -> None:
    amplifier = Amplifier()
    amplifier.send(9.5, 6.0)
    told = amplifier.cells.readings()
    assert told.tension[:2] == pytest.approx([8.0, 4.5], abs=0.006)
    assert told.raw[:2] == pytest.approx([9.5, 6.0], abs=0.006)
    assert np.isnan(told.tension[2:]).all()
    assert told.fitted.tolist() == [True, True] + [False] * 10
    assert told.trouble == ("",) * 12


def test_a_gain_from_a_known_force_scales_what_is_over_the_tare() -> None:
    amplifier = Amplifier()
    amplifier.cells.calibrate({"S1": CellCalibration(offset_N=1.5, gain=1.25)})
    amplifier.send(9.5)
    assert amplifier.s1_says()[0] == pytest.approx(10.0, abs=0.01)


@pytest.mark.parametrize("silent_s", [0.26, 5.0, 500.0])
def test_a_silent_cell_has_no_tension_rather_than_none(silent_s: float) -> None:
    amplifier = Amplifier()
    assert amplifier.s1_says()[1].startswith("nothing was heard")
    amplifier.send(9.5)
    amplifier.clock.advance(silent_s)
    tension, trouble = amplifier.s1_says()
    assert np.isnan(tension)
    assert trouble.startswith("silent")


@pytest.mark.parametrize(("reading", "limit_N"), [(1e9, None), (-1e9, None), (60.0, 50.0), (-50.0, 50.0)])
def test_a_saturated_cell_is_not_believed(reading: float, limit_N: float | None) -> None:
    amplifier = Amplifier(limit_N=limit_N)
    amplifier.send(reading)
    tension, trouble = amplifier.s1_says()
    assert np.isnan(tension)
    assert "at the end of its range" in trouble


@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf")])
def test_what_is_no_number_is_not_believed(value: float) -> None:
    amplifier = Amplifier()
    amplifier.send(9.5, value)
    told = amplifier.cells.readings()
    assert np.isnan(told.tension[1])
    assert told.trouble[1]
    assert not told.trouble[0]


def test_an_amplifier_that_repeats_itself_is_dead_though_it_sends() -> None:
    amplifier = Amplifier()
    for _ in range(99):
        amplifier.send(1.5)
    assert amplifier.s1_says() == (pytest.approx(0.0), "")
    for _ in range(20):
        amplifier.send(1.5)
    tension, trouble = amplifier.s1_says()
    assert np.isnan(tension)
    assert "does not change any more" in trouble
    amplifier.send(1.6)
    assert amplifier.s1_says()[0] == pytest.approx(0.1, abs=0.006)


def test_a_cell_that_says_push_is_not_believed() -> None:
    amplifier = Amplifier()
    amplifier.send(-2.0)
    tension, trouble = amplifier.s1_says()
    assert np.isnan(tension)
    assert "reads -3.5 N, which no tendon can" in trouble


def test_a_cell_that_was_never_tared_is_not_believed() -> None:
    amplifier = Amplifier(tared=False)
    amplifier.send(9.5)
    tension, trouble = amplifier.s1_says()
    assert np.isnan(tension)
    assert "not tared yet" in trouble


def test_short_frames_are_counted_and_change_nothing() -> None:
    amplifier = Amplifier()
    amplifier.send(9.5)
    amplifier.take(b"\1")
    assert amplifier.counts == {"short load cell frame": 2}
    assert amplifier.s1_says()[0] == pytest.approx(8.0, abs=0.006)


@pytest.mark.parametrize("apart", [False, True], ids=["beside the drives", "on a bus of their own"])
def test_tensions_come_with_the_drives_feedback(apart: bool) -> None:
    clock = ManualClock()
    bus = replace(COBRA.buses[0], options={"twin": Springs(bias_N=20.0), "stepping": "inline", "clock": clock})
    buses = (bus, replace(bus, name="cells")) if apart else (bus,)
    fitted = tuple(replace(cell, bus=buses[-1].name) for cell in (S1, E1))
    d = replace(COBRA, load_cells=fitted, buses=tuple(replace(b, channel=f"cobra#{b.name}") for b in buses))
    cells = LoadCells(d, clock)
    cells.calibrate({"S1": CellCalibration(offset_N=0.0), "E1": CellCalibration(offset_N=0.0)})
    with open_bus(d, clock, cells=cells) as motors:
        for _ in range(300):
            feedback = motors.exchange(None)
            clock.advance(0.01)
        load = world_of("cobra").load[list(d.tendon_drives)]
        assert feedback.cells.tension[1] == pytest.approx(load[1], rel=1e-5)
        assert feedback.cells.tension[0] == pytest.approx(load[0], abs=0.25)
        assert feedback.valid.all()
        assert not motors.counts


def test_what_the_cells_send_is_part_of_the_bus_load() -> None:
    d = replace(COBRA, load_cells=(S1, E1))
    bare, fitted = (channel_load(robot, robot.buses[0]) for robot in (COBRA, d))
    assert fitted.load - bare.load == pytest.approx(100 * 115 / 1e6, abs=0.08)
    assert fitted.cell_bits_per_s == pytest.approx(100 * 115, rel=0.1)
    busy = replace(
        d,
        load_cells=(
            replace(S1, rate_Hz=1000.0, frame_id=0x300),
            *(replace(S1, tendon=n, frame_id=0x301 + i, rate_Hz=1000.0) for i, n in enumerate(COBRA.tendon_names[1:])),
        ),
    )
    assert "load cells" in channel_load(busy, d.buses[0]).complaint()


@given(st.lists(st.binary(max_size=8), max_size=30))
def test_whatever_arrives_is_either_a_tension_or_a_trouble_in_words(frames: list[bytes]) -> None:
    amplifier = Amplifier()
    for data in frames:
        amplifier.take(data)
        told = amplifier.cells.readings()
        for i in (0, 1):
            assert np.isfinite(told.tension[i]) != bool(told.trouble[i])
