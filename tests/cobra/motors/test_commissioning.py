"""Commissioning on simulated drives and a clock of the test's own: what is found, what moves, and what ends it with which words."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from cobra.clock import ManualClock
from cobra.description import LoadCell, RobotDescription
from cobra.kinematics.tendons import TendonMap
from cobra.loading import load_description
from cobra.motors.calibration import CalibrationBook, zero_angles, zeros
from cobra.motors.cell_readings import CellCalibration, LoadCells
from cobra.motors.commissioning.bench import Bench, bare, only
from cobra.motors.commissioning.cell_points import KnownForce, Tare
from cobra.motors.commissioning.drive_test import Check, DriveTest
from cobra.motors.commissioning.identify import Wiggle
from cobra.motors.commissioning.procedure import AbortError
from cobra.motors.commissioning.repeat import RepeatedHoming
from cobra.motors.commissioning.survey import compared, options_of, survey
from cobra.motors.open_bus import open_bus
from cobra.simulation.drives import world_of
from cobra.simulation.faults import FaultDesk
from tests.cobra.motors.handmade_drives import robot
from tests.cobra.simulation.test_drives import Springs

COBRA = load_description("cobra")


def on(plant: Any, described: RobotDescription = COBRA, true: RobotDescription | None = None) -> RobotDescription:
    """The described robot on simulated drives, which are those of `true`."""
    options: dict[str, Any] = {"twin": plant, "stepping": "inline", "seed": 1}
    if true is not None:
        options["description"] = true
    return replace(described, buses=tuple(replace(bus, options=options) for bus in described.buses))


@contextmanager
def bench(d: RobotDescription, cells: dict[str, CellCalibration] | None = None) -> Iterator[Bench]:
    clock = ManualClock()
    fitted = LoadCells(d, clock)
    fitted.calibrate(cells or {})
    with open_bus(d, clock, cells=fitted) as bus:
        made = Bench(d, bus, clock)
        made.enable()
        yield made


def silent(_: str) -> None: ...


# ---------------------------------------------------------------- who is there


def test_a_survey_names_the_described_drives_and_who_is_missing_or_other() -> None:
    bus, clock = COBRA.buses[0], ManualClock()
    d = on("none")
    motors = survey(d.buses[0], clock, options_of(d, d.buses[0], clock))
    assert [motor.address for motor in motors] == list(range(1, 15))
    other = replace(
        COBRA,
        motors=(replace(COBRA.motors[0], protocol="rmd-v3"),),
        drives=(*COBRA.drives[:13], replace(COBRA.drives[13], address=20)),
    )
    found, missing = compared(other, bus, motors)
    assert missing == ["feed (address 20)"]
    assert (found[0].drive, found[0].complaint) == ("S1", "described as rmd-v3")
    assert (found[13].drive, found[13].complaint) == ("", "not described")


@pytest.mark.parametrize("protocol", ["rmd-v1", "rmd-v3", "cia402"])
def test_a_motor_that_no_description_knows_can_be_moved(protocol: str) -> None:
    d, clock = robot(2, protocol), ManualClock()
    options = {"twin": "none", "stepping": "inline", "clock": clock, "description": d}
    motors = survey(d.buses[0], clock, options)
    alone = bare(motors[1], replace(d.buses[0], options=options))
    with open_bus(alone, clock) as bus:
        made = Bench(alone, bus, clock)
        made.enable()
        before = world_of("cobra").travel.copy()
        wiggle = Wiggle(alone, 0, 30.0)
        made.run(wiggle, silent)
        assert wiggle.moved_degrees == pytest.approx(30.0, rel=0.1)
        assert world_of("cobra").travel == pytest.approx(before, abs=5e-5)


# ---------------------------------------------------------------- identify


def test_only_the_chosen_drive_moves_and_a_tendon_is_never_pulled() -> None:
    d = only(on("none"), (4,))
    with bench(d) as made:
        world = world_of("cobra")
        before = world.travel.copy()
        wiggle = Wiggle(d, 0, 5.0)
        made.run(wiggle, lambda _: None)
        moved = world.travel - before
        assert moved == pytest.approx(0.0, abs=2e-5)
        assert wiggle.moved_degrees == pytest.approx(5.0, abs=0.3)
        assert wiggle.largest_A < 0.5


# ---------------------------------------------------------------- test


def checks_of(d: RobotDescription, name: str) -> dict[str, Check]:
    index = next(i for i, drive in enumerate(d.drives) if drive.name == name)
    part = only(d, (index,))
    with bench(part) as made:
        test = DriveTest(part, 0)
        made.run(test, silent)
    return {check.name: check for check in test.checks}


@pytest.mark.parametrize("name", ["S1", "W3", "twist", "feed"])
def test_a_drive_that_is_as_described_passes(name: str) -> None:
    checks = checks_of(on(Springs()), name)
    assert list(checks) == ["encoder", "direction", "current"]
    assert all(check.ok for check in checks.values()), checks
    if name == "S1":
        assert "winding in pulls" in checks["direction"].words


def test_a_tendon_wound_the_other_way_round_is_told() -> None:
    turned = replace(COBRA, drives=(replace(COBRA.drives[0], direction=-COBRA.drives[0].direction), *COBRA.drives[1:]))
    checks = checks_of(on(Springs(), described=turned, true=COBRA), "S1")
    assert not checks["direction"].ok
    assert "direction" in checks["direction"].words


def test_a_tendon_that_is_off_its_spool_is_told() -> None:
    checks = checks_of(on(Springs(stiffness_N_m=0.0)), "S1")
    assert not checks["direction"].ok
    assert "30.0 mm wound in without tension" in checks["direction"].words
    assert checks["encoder"].ok


def test_a_wrong_gear_ratio_shows_in_the_direction_or_the_way_to_contact() -> None:
    """What a motor alone cannot tell: its encoder agrees with itself. Only what the tendon feels does not."""
    doubled = replace(COBRA, motors=(replace(COBRA.motors[0], gear_ratio=18.0),))
    right = checks_of(on(Springs()), "S1")["direction"].words
    wrong = checks_of(on(Springs(), described=doubled, true=COBRA), "S1")["direction"].words
    assert right != wrong


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("stall E1", r"drive E1 (does not follow|draws)"),
        ("drop E1", r"drive E1 does not answer any more"),
        ("overheat E1 95", r"drive E1 .*95 °C, at most 80"),
        ("undervoltage 12", r"drive E1 .*undervoltage"),
        ("slip E1 60", r"drive E1 .*its angle jumped"),
    ],
)
def test_what_goes_wrong_on_the_way_ends_it_with_the_reason_and_the_drive_stands(fault: str, words: str) -> None:
    d = only(on(Springs()), (1,))
    with bench(d) as made:
        desk = FaultDesk("cobra")
        test = DriveTest(d, 0)
        once = threading.Event()

        def make(said: str) -> None:
            if "goes out" in said and not once.is_set():
                once.set()
                desk.make(fault)

        with pytest.raises(AbortError, match=words):
            made.run(test, make)
        assert once.is_set()
        assert not test.done
        desk.make("heal")
        world, clock = world_of("cobra"), made._clock
        for _ in range(60):
            clock.sleep_until(clock.now() + 0.01)
            world.advance_to(clock.now())
        before = world.travel.copy()
        for _ in range(60):
            clock.sleep_until(clock.now() + 0.01)
            world.advance_to(clock.now())
        if not fault.startswith("drop"):
            assert world.travel == pytest.approx(before, abs=1e-6)


def test_somebody_can_end_it_at_any_time() -> None:
    d = only(on(Springs()), (0,))
    stop = threading.Event()
    with bench(d) as made, pytest.raises(AbortError, match="it was stopped"):
        made.run(DriveTest(d, 0), lambda said: stop.set() if "comes in" in said else None, stop)


# ---------------------------------------------------------------- homing more than once


def test_homing_again_finds_the_same_zeros() -> None:
    d = on("default")
    with bench(d) as made:
        homing = RepeatedHoming(d, TendonMap(d).bending, 2)
        made.run(homing, silent)
        truth = world_of("cobra").truth()
    assert truth is not None
    assert truth.tensions == pytest.approx(8.0, abs=0.3)
    assert np.degrees(np.linalg.norm(truth.bends, axis=1)) == pytest.approx(0.0, abs=1.5)
    # A millimetre of tendon is 17 degrees of bend at 3.3 mm.
    assert homing.spread_m.max() < 2e-4


# ---------------------------------------------------------------- load cells

BIAS_N, WRONG = 0.4, 0.8
CELL = LoadCell(tendon="S1", bus="main", frame_id=0x301, scale_N=0.01, rate_Hz=100.0, noise_N=0.03, bias_N=BIAS_N)
FITTED = replace(COBRA, load_cells=(CELL, replace(CELL, tendon="N1", byte_offset=2)))


def test_tare_slackens_the_tendons_and_finds_what_the_cells_read_of_nothing() -> None:
    d = on(Springs(), FITTED)
    with bench(d) as made:
        tare = Tare(d)
        made.run(tare, silent)
        (amplifier,) = world_of("cobra").amplifiers.values()
        assert tare.cells["S1"].offset_N == pytest.approx(amplifier.bias_N[0], abs=0.02)
        assert tare.cells["N1"].offset_N == pytest.approx(amplifier.bias_N[1], abs=0.02)
        assert world_of("cobra").load[0] == 0.0


def test_a_tendon_that_does_not_grow_slack_is_not_taken_for_nothing() -> None:
    d = on(Springs(stiffness_N_m=100.0, bias_N=15.0), FITTED)
    with bench(d) as made, pytest.raises(AbortError, match=r"S1 .*is the tendon slack"):
        made.run(Tare(d, ("S1",)), silent)


def test_a_known_force_gives_the_gain() -> None:
    """The amplifier's scale is 0.8 of what is described."""
    true = replace(
        FITTED, load_cells=tuple(replace(cell, scale_N=0.01 / WRONG, bias_N=0.0) for cell in FITTED.load_cells)
    )
    d = on(Springs(bias_N=20.0), FITTED, true=true)
    with bench(d) as made:
        made.run(Wiggle(d, 13, 1.0), silent)  # meanwhile the tendon pulls its drive as far as its gear lets it
        force = float(world_of("cobra").load[0])
        known = KnownForce(d, "S1", force, CellCalibration(offset_N=0.0))
        made.run(known, silent)
    assert known.cells["S1"].gain == pytest.approx(1.0 / WRONG, rel=0.02)


@pytest.mark.parametrize(("force", "words"), [(0.01, "must be"), (500.0, "must be"), (35.0, "reads .* under 35 N")])
def test_a_force_that_tells_nothing_is_refused(force: float, words: str) -> None:
    d = on(Springs(), FITTED)
    with bench(d) as made, pytest.raises(AbortError, match=words):
        made.run(KnownForce(d, "S1", force, CellCalibration(offset_N=0.0)), silent)


# ---------------------------------------------------------------- what is kept


def test_every_change_is_a_version_and_the_rest_stays(tmp_path: Path) -> None:
    book = CalibrationBook(COBRA, tmp_path / "cobra")
    assert book.load() is None
    angle, travel = np.arange(14.0), np.full(14, 0.01)
    book.keep("homed", drives=zeros(COBRA, angle, travel, {"S1": 1e-4}))
    book.keep("tared", cells={"S1": CellCalibration(offset_N=0.3)})
    again = CalibrationBook(COBRA, tmp_path / "cobra")
    newest = again.load()
    assert newest is not None
    assert (newest.version, newest.by, newest.cells["S1"].offset_N) == (2, "tared", 0.3)
    assert newest.drives["S1"].spread_m == 1e-4
    found, why = zero_angles(COBRA, newest)
    assert why == ""
    assert found == pytest.approx([k - 0.01 / drive.travel_per_rad for k, drive in enumerate(COBRA.drives)])
    assert [kept.version for kept in again.history()] == [1, 2]
    assert newest.date.startswith("20")


def test_a_file_that_was_cut_off_is_passed_over_and_told(tmp_path: Path) -> None:
    book = CalibrationBook(COBRA, tmp_path)
    book.keep("tared", cells={"S1": CellCalibration(offset_N=0.3)})
    whole = (tmp_path / "00001.json").read_bytes()
    (tmp_path / "00002.json").write_bytes(whole[: len(whole) // 2])
    again = CalibrationBook(COBRA, tmp_path)
    newest = again.load()
    assert newest is not None
    assert newest.version == 1
    assert "00002.json cannot be read" in again.complaints[0]
    # And is not written over.
    assert again.keep("tared again", cells={}).version == 3
    assert (tmp_path / "00002.json").read_bytes() == whole[: len(whole) // 2]


def test_two_who_keep_at_once_lose_nothing(tmp_path: Path) -> None:
    one, other = CalibrationBook(COBRA, tmp_path), CalibrationBook(COBRA, tmp_path)
    assert one.keep("one", cells={"S1": CellCalibration(offset_N=1.0)}).version == 1
    assert other.keep("other", cells={"S1": CellCalibration(offset_N=2.0)}).version == 2
    assert [kept.by for kept in one.history()] == ["one", "other"]
    assert not list(tmp_path.glob(".*"))


def test_another_robots_calibration_is_not_used(tmp_path: Path) -> None:
    CalibrationBook(replace(COBRA, serial="A7"), tmp_path).keep("homed")
    mine = CalibrationBook(replace(COBRA, serial="B2"), tmp_path)
    assert mine.load() is None
    assert "is of cobra serial A7, this robot is cobra serial B2: it is not used" in mine.complaints[0]


def test_a_drive_that_moved_to_another_place_has_no_zero() -> None:
    book = CalibrationBook(COBRA, None)
    kept = book.keep("homed", drives=zeros(COBRA, np.zeros(14), np.zeros(14)))
    moved = replace(COBRA, drives=(replace(COBRA.drives[0], address=30), *COBRA.drives[1:]))
    assert "drive S1 is described otherwise" in zero_angles(moved, kept)[1]
