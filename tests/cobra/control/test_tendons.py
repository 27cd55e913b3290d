"""Claims about tendons with losses on the twin: what is known of them, what is taken out, and which fault is whose."""

from dataclasses import fields, replace

import numpy as np
import pytest
from msgspec.structs import replace as replace_part

from cobra.control.tension import CREEP_M_S
from cobra.description import Compensation
from cobra.loading import load_description
from cobra.mechanics.losses import Losses
from cobra.messages import Intent, Request
from cobra.simulation.drives import world_of
from tests.bench import CHANNEL, Bench


@pytest.fixture
def bench():
    with Bench(seed=3, losses="nominal") as bench:
        assert bench.home().phase == "ready"
        for _ in range(5):
            bench.tick()
        yield bench


def drive(bench: Bench, seconds: float, **intent) -> None:
    for _ in range(round(seconds / bench.loop.period_s)):
        bench.tick(Intent(**intent))


def test_homing_leaves_a_rubbing_robot_straight(bench):
    bends = np.degrees(np.linalg.norm(world_of(CHANNEL).truth().bends, axis=1))
    assert bends == pytest.approx(0.0, abs=2.5)


def test_bends_arrive_and_return_with_compensation(bench):
    for sign in (1.0, -1.0):
        drive(bench, 1.5, primary=(sign, 0.0))
        wanted = bench.states[-1].commanded[2]
        truth = world_of(CHANNEL).truth()
        assert truth.bends[0, 0] == pytest.approx(wanted, abs=np.radians(4.0))
    drive(bench, 0.3)
    told = bench.states[-1].tendons.tension
    assert world_of(CHANNEL).truth().tensions == pytest.approx(told, abs=0.3)


BENDING = {"primary": (0.7, 0.7), "section": 1}
FAULTS = {
    "break": lambda world: world.plant.break_tendon("E2"),
    "slip": lambda world: world.plant.slip("E2", 0.002),
}


@pytest.mark.parametrize(
    ("fault", "held", "words"),
    [
        ("break", True, "is broken"),
        ("break", False, "is broken"),
        ("slip", True, "has slipped"),
        ("slip", False, "has slipped"),
    ],
)
def test_a_faulty_tendon_is_named_within_half_a_second_and_holds_the_robot(bench, fault, held, words):
    drive(bench, 0.5, **BENDING)
    intent = Intent(**BENDING) if held else None
    for _ in range(0 if held else 30):
        bench.tick()
    FAULTS[fault](world_of(CHANNEL))
    ticks = 0
    while not bench.loop.tendons.faults and ticks < 50:
        bench.tick(intent)
        ticks += 1
    print(f"{fault}, {'driving' if held else 'holding'}: named after {ticks * bench.loop.period_s:.2f} s")
    (named,) = bench.loop.tendons.faults
    assert "E2" in named
    assert words in named
    assert any(named in event.text for event in bench.events)
    if held:
        assert bench.tick(intent).phase == "holding"


def test_an_encoder_that_slips_is_told_by_its_drive_with_the_angle(bench):
    drive(bench, 0.5, **BENDING)
    world = world_of(CHANNEL)
    world.drives[world.description.tendon_drives[5]].slip(-15.0)
    ticks, state = 0, bench.states[-1]
    while state.phase == "driving" and ticks < 5:
        state = bench.tick(Intent(**BENDING))
        ticks += 1
    print(f"encoder, driving: named after {ticks * bench.loop.period_s:.2f} s")
    assert state.phase == "fault"
    assert "drive E2: its angle jumped by -15." in state.cause
    assert not state.homed


def test_a_jammed_tendon_is_named_once_the_others_bend_the_robot_without_it():
    with Bench(seed=3, losses="nominal") as bench:
        # As sure as a sweep is.
        known = bench.loop.tendons.identified
        shares = {field.name: 0.05 * getattr(known.deviation, field.name) for field in fields(Losses)}
        bench.loop.tendons.use(replace(known, deviation=Losses(**shares), source="a sweep"))
        assert bench.home().phase == "ready"
        for _ in range(5):
            bench.tick()
        x, y = float(np.cos(np.pi / 6)), float(np.sin(np.pi / 6))
        drive(bench, 0.5, primary=(x, y), section=2)
        assert bench.loop.tendons.faults == (), "healthy tendons are not blamed"
        world_of(CHANNEL).plant.jam("E2")
        ticks = 0
        while not bench.loop.tendons.faults and ticks < 150:
            bench.tick(Intent(primary=(x, y), section=1))
            ticks += 1
        print(f"jam, driving: named after {ticks * bench.loop.period_s:.2f} s")
        assert bench.loop.tendons.faults == ("tendon E2 is jammed: it does not follow its drive",)


def test_the_bends_are_known_as_well_as_is_said():
    """Of a robot whose losses are up to 30 % from what is described, by the twin's truth."""
    errors, sigmas = [], []
    with Bench(seed=1, losses="seeded") as bench:
        assert bench.home().phase == "ready"
        for _ in range(5):
            bench.tick()
        for k in range(600):
            turn = 2.4 * (k // 80)
            bench.tick(Intent(primary=(float(np.cos(turn)), float(np.sin(turn))), section=k // 160 % 3))
            estimate = bench.loop.tendons.estimate
            errors.append(estimate.bends - world_of(CHANNEL).truth().bends.ravel())
            sigmas.append(estimate.deviation)
    z = np.array(errors) / np.array(sigmas)
    print(
        f"RMS error {np.degrees(np.sqrt(np.mean(np.square(errors)))):.1f} degrees, in standard deviations {np.sqrt(np.mean(z**2)):.2f}"
    )
    assert np.mean(np.abs(z) < 2.0) > 0.9
    assert np.sqrt(np.mean(z**2)) > 0.15, "nor is it said to be known worse than it is by far"


def test_slack_is_told_at_once_and_taken_up_slowly_while_the_robot_stands(bench):
    drive(bench, 0.3, **BENDING)
    bench.loop.tendons._health.observe = lambda *_: None  # the keeper alone, not who would call it a fault
    plant = world_of(CHANNEL).plant
    plant.slip("E2", 0.006)
    ticks = 0
    while not any("E2 is slack" in warning for warning in bench.states[-1].tendons.warnings) and ticks < 50:
        bench.tick(Intent(**BENDING))
        ticks += 1
    print(f"slack, driving: named after {ticks * bench.loop.period_s:.2f} s")
    assert ticks < 50
    before = np.array(bench.states[-1].drives.setpoint)
    state = bench.tick(Intent(**BENDING))
    wound = before - np.array(state.drives.setpoint)
    assert 0.0 < wound[bench.description.tendon_drives[5]] <= 1.01 * CREEP_M_S * bench.loop.period_s
    for _ in range(200):
        bench.tick()
    assert plant.truth().tensions[5] > bench.description.tendon.min_tension_N
    assert bench.states[-1].tendons.warnings == ()


def pushed_tip(admittance: float) -> tuple[float, float]:
    """Commanded bends of all sections together [rad], and how far the tip stands aside [m], after a push to the right."""
    wanted = Compensation(admittance_rad_s_Nm=admittance)
    with Bench(
        seed=3, losses="nominal", description=replace_part(load_description("cobra"), compensation=wanted)
    ) as bench:
        assert bench.home().phase == "ready"
        for _ in range(5):
            bench.tick()
        drive(bench, 0.3, primary=(0.1, 0.0))
        world_of(CHANNEL).plant.push(-1, np.array([0.3, 0.0, 0.0]))
        drive(bench, 2.0)
        truth = world_of(CHANNEL).truth()
        assert truth.tensions.min() > bench.description.tendon.min_tension_N
        return float(np.sum(bench.states[-1].commanded[2::2])), float(truth.tip_position[0])


def test_with_admittance_the_robot_gives_way_when_pushed_and_without_it_holds():
    (stiff, stood), (soft, moved) = pushed_tip(0.0), pushed_tip(60.0)
    assert abs(stiff) < np.radians(5.0)
    assert soft > stiff + np.radians(10.0)
    assert moved > stood + 0.01


def test_healthy_tendons_raise_no_alarm(bench):
    for direction in ((1.0, 0.0), (-1.0, 0.5), (0.0, -1.0)):
        drive(bench, 1.0, primary=direction, section=1)
    assert bench.states[-1].tendons.warnings == ()


def test_switching_compensation_moves_nothing_and_is_said(bench):
    drive(bench, 1.0, primary=(1.0, 0.0))
    for _ in range(60):
        bench.tick()
    before = np.array(bench.states[-1].drives.travel)
    assert bench.ask(Request(what="compensation", lease=bench.lease, value=0.0)).ok
    for _ in range(20):
        state = bench.tick()
    assert state.tendons.compensation == "off"
    assert np.array(state.drives.travel) == pytest.approx(before, abs=3e-5)
