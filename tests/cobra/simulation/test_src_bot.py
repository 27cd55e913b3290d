"""Claims about SRC-Bot on its MuJoCo twin, through the whole control loop: homing, driving, and the guiders' contact."""

import re

import numpy as np
import pytest

from cobra.kinematics.backbone import Backbone
from cobra.loading import load_description
from cobra.messages import Intent, Request, RobotState
from cobra.simulation.drives import world_of
from cobra.simulation.twin import build_twin
from tests.bench import Bench

ROBOT = "src-bot"
SRC_BOT = load_description(ROBOT)
LENGTH, BENDS = 4, slice(2, 4)
"""Where q holds them."""


def drive(bench: Bench, seconds: float, **intent) -> None:
    for _ in range(round(seconds / bench.loop.period_s)):
        bench.tick(Intent(**intent))


def settle(bench: Bench, seconds: float = 1.0) -> None:
    for _ in range(round(seconds / bench.loop.period_s)):
        bench.tick()


@pytest.mark.parametrize(("twin", "seed"), [("ideal", 0), ("default", 1)])
def test_homing_against_the_stop_finds_straight_and_length_in_spite_of_friction_and_coarse_currents(twin, seed):
    with Bench(seed, twin, ROBOT) as bench:
        state = bench.home()
        assert (state.phase, state.homed) == ("ready", True)
        settle(bench)
        truth = world_of(ROBOT).truth()
        assert np.degrees(np.linalg.norm(truth.bends)) < 0.5
        assert truth.tip_position[2] == pytest.approx(state.commanded[LENGTH], abs=0.0015)
        assert not any(truth.locked), "it has let go of the stop"


def test_bent_it_is_homed_straight_again_or_it_says_that_it_is_bent(monkeypatch):
    def home_bent(bench: Bench) -> RobotState:
        drive(bench, 3.0, primary=(0.3, -0.95))
        assert np.degrees(np.linalg.norm(world_of(ROBOT).truth().bends)) > 45.0
        settle(bench, 0.3)
        assert bench.ask(Request(what="home", lease=bench.lease)).ok
        while bench.tick().phase == "homing":
            pass
        return bench.states[-1]

    with Bench(1, "default", ROBOT) as bench:
        bench.home()
        settle(bench, 0.1)
        assert home_bent(bench).homed
        assert np.degrees(np.linalg.norm(world_of(ROBOT).truth().bends)) < 2.0
        settle(bench)
        monkeypatch.setattr("cobra.motors.homing._body_compliance", lambda description: 0.0)
        assert re.search("let go of the stop, tendon .* carries .* is the robot bent", home_bent(bench).cause)


def test_the_twins_tip_follows_bend_direction_and_length():
    with Bench(0, "ideal", ROBOT) as bench:
        bench.home()
        settle(bench, 0.1)
        drive(bench, 1.0, length=-1.0)
        drive(bench, 1.2, primary=(0.6, -0.8))
        settle(bench)
        q = np.array(bench.states[-1].commanded)
        assert 0.4 < np.hypot(*q[BENDS]) < 0.7
        assert q[LENGTH] < 0.219
        tip = Backbone(SRC_BOT).tip(q)[:3, 3]
        truth = world_of(ROBOT).truth()
        assert np.linalg.norm(truth.tip_position - tip) < 0.004
        assert truth.bends[0] == pytest.approx(q[BENDS], abs=0.03)


def pulled(bend_rad: float, to_m: float, twin=None):
    """The twin with its cables wound in evenly and along one bend; gives it and its tensions."""
    twin = twin or build_twin(SRC_BOT, "ideal")
    azimuths = np.radians(SRC_BOT.sections[0].routing.azimuths_deg)
    travel = to_m - 0.25 - 0.03 * bend_rad * np.cos(azimuths)
    twin.advance(travel, 1.5)
    return twin, twin.advance(travel, 1.0)


def test_guiders_pulled_together_straight_catch_and_carry_what_would_bend_a_free_robot():
    moved = {}
    for length in (0.1995, 0.225):
        twin, _ = pulled(0.0, length)
        before = twin.truth().tip_position
        twin.push(-1, np.array([2.0, 0.0, 0.0]))
        twin.advance(np.full(3, length - 0.25), 1.5)
        moved[length] = float(np.linalg.norm(twin.truth().tip_position - before))
        assert all(twin.truth().locked) == (length < 0.2)
    assert moved[0.1995] < 0.1 * moved[0.225]


def test_the_stop_bears_the_pull_that_would_shorten_the_chambers_further():
    twin, tension = pulled(0.0, 0.1985)
    free = 5136.0 * (0.05 - 0.1985 / 5) / 3
    assert tension.min() > 1.5 * free
    assert twin.truth().tip_position[2] > 0.199


def test_the_slots_let_go_beyond_the_unlocking_length_and_not_before():
    twin, _ = pulled(0.0, 0.1995)
    twin, _ = pulled(0.0, 0.207, twin)
    assert all(twin.truth().locked)
    twin, _ = pulled(0.0, 0.214, twin)
    assert not any(twin.truth().locked)


def test_guiders_that_touch_while_bent_do_not_catch():
    twin, _ = pulled(np.radians(40.0), 0.23)
    twin, _ = pulled(np.radians(40.0), 0.1995, twin)
    assert not any(twin.truth().locked)


def test_a_cable_off_its_spool_is_named_when_homing_against_the_stop():
    with Bench(0, "default", ROBOT) as bench:
        world_of(ROBOT).plant.break_tendon("C2")
        state = bench.home()
        assert state.phase == "holding"
        assert "C2" in state.cause
        assert "broken or off its spool" in state.cause


@pytest.mark.parametrize("seed", [1, 2])
def test_homing_finds_straight_with_other_friction_play_and_stiffness_than_described(seed):
    with Bench(seed, "default", ROBOT, losses="seeded") as bench:
        assert bench.home().homed
        settle(bench)
        truth = world_of(ROBOT).truth()
        assert np.degrees(np.linalg.norm(truth.bends)) < 1.0
        assert truth.tip_position[2] == pytest.approx(bench.states[-1].commanded[LENGTH], abs=0.002)


def test_a_cable_that_is_paid_out_hangs_slack_and_does_not_push():
    twin = build_twin(SRC_BOT, "default")
    azimuths = np.radians(SRC_BOT.sections[0].routing.azimuths_deg)
    straight = np.full(3, 0.23 - 0.25)
    twin.advance(straight, 1.5)
    taut = twin.advance(straight, 0.5)
    assert taut.min() > 1.0
    slack = straight + np.array([0.06, 0.0, 0.0])
    twin.advance(slack, 5.0)
    there, tension = twin.truth(), twin.advance(slack, 0.5)
    assert tension[0] == 0.0
    assert tension[1:].min() > 1.0
    # It bends away from the loose cable, and however much more is paid out changes nothing.
    towards = np.array([np.cos(azimuths[0]), np.sin(azimuths[0])])
    assert there.bends[0] @ towards < -0.05
    twin.advance(slack + np.array([0.01, 0.0, 0.0]), 1.5)
    assert twin.truth().tip_position == pytest.approx(there.tip_position, abs=5e-4)


def test_the_cables_rub_so_that_the_tension_falls_in_the_direction_of_motion():
    twin = build_twin(SRC_BOT, "default")
    pulled(0.5, 0.235, twin)
    ratios = []
    for to_m in (0.225, 0.231):  # drawn in, then paid out
        pulled(0.5, to_m, twin)
        profile = twin.truth().tension_profile
        ratios.append(profile[:, 0] / profile[:, -1])
    assert np.all(ratios[0] > 1.02)
    assert np.all(ratios[1] < 0.98)
