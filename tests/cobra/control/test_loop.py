"""Claims about the loop on its twin: bumpless arming, limits that bind, and what happens when nobody is there any more."""

import numpy as np
import pytest

from cobra.messages import Intent, Request
from cobra.simulation.drives import world_of
from tests.bench import CHANNEL, Bench


@pytest.fixture
def bench():
    with Bench(seed=0) as bench:
        bench.home()
        for _ in range(5):
            bench.tick()
        yield bench


def drive(bench: Bench, seconds: float, **intent) -> None:
    for _ in range(round(seconds / bench.loop.period_s)):
        bench.tick(Intent(**intent))


def test_arming_again_while_bent_does_not_move_the_drives(bench):
    drive(bench, 1.0, primary=(1.0, 0.0))
    for _ in range(50):
        bench.tick()
    assert bench.ask(Request(what="disarm", lease=bench.lease)).ok
    # Switched off, the spools give way until their gears' friction holds the tendons.
    for _ in range(300):
        bench.tick()
    stood = bench.states[-1].drives.travel
    assert bench.ask(Request(what="arm", lease=bench.lease)).ok
    for _ in range(50):
        state = bench.tick()
    assert state.phase == "ready"
    assert state.drives.travel == pytest.approx(stood, abs=2e-5)
    assert np.hypot(*state.commanded[2:4]) > 0.1, "it starts from the bend it has"


def test_an_overloaded_tendon_freezes_what_tightens_it_and_names_it(bench):
    drive(bench, 2.0, primary=(1.0, 0.0))
    tensions = bench.states[-1].tendons.tension
    highest = tensions[1] - 0.3
    assert sorted(tensions)[-2] < highest, "only E1 is to be overloaded"
    bench.loop.tendons._keeper._high = highest
    drive(bench, 0.3, primary=(1.0, 0.0))
    frozen = bench.states[-1]
    assert "E1" in frozen.cause
    before = frozen.commanded[2]
    drive(bench, 0.3, primary=(1.0, 0.0))
    assert bench.states[-1].commanded[2] == pytest.approx(before, abs=0.05)
    drive(bench, 1.0, primary=(-1.0, 0.0))
    assert bench.states[-1].commanded[2] < before - 0.1


def test_an_abandoned_robot_lowers_its_tension_holds_and_leaves(bench):
    assert bench.description.teleop.final_action == "hold"
    tense = world_of(CHANNEL).truth().tensions
    shape = world_of(CHANNEL).truth().bends
    bench.loop.abandon(leave=True)
    for _ in range(1000):
        bench.loop.tick()
        bench.clock.advance(bench.loop.period_s)
        if bench.loop.quit_requested:
            break
    truth = world_of(CHANNEL).truth()
    assert bench.loop.quit_requested
    assert bench.states[-1].phase == "disarmed"
    assert truth.tensions.max() < 0.7 * tense.min()
    assert np.degrees(np.abs(truth.bends - shape)).max() < 3.0
    assert bench.states[-1].lease.holder == ""
