"""Claims about tendons with losses on the twin: what is known of them, what is taken out, and which fault is whose."""

import numpy as np
import pytest

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


@pytest.mark.parametrize(("fault", "word"), [("break", "broken"), ("slip", "slipped")])
def test_a_faulty_tendon_is_named_within_half_a_second_and_holds_the_robot(bench, fault, word):
    drive(bench, 0.5, primary=(0.7, 0.7), section=1)
    plant = world_of(CHANNEL).plant
    if fault == "break":
        plant.break_tendon("E2")
    else:
        plant.slip("E2", 0.002)
    ticks = 0
    while not bench.loop.tendons.faults and ticks < 50:
        bench.tick(Intent(primary=(0.7, 0.7), section=1))
        ticks += 1
    print(f"{word} after {ticks * bench.loop.period_s:.2f} s")
    (named,) = bench.loop.tendons.faults
    assert "E2" in named
    assert word in named
    assert bench.tick(Intent(primary=(0.7, 0.7), section=1)).phase == "holding"


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
