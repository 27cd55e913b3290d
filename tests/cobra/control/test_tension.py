"""Claims about keeping tensions: on the worst robot there is, which does not give way to its tendons at all."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cobra.control.estimation import TendonEstimate
from cobra.control.tension import CREEP_M_S, SLACK_HOLD_S, TRIM_M_S, TensionKeeper
from cobra.control.tension_steps import TensionSteps
from cobra.loading import load_description
from cobra.mechanics.losses import described
from cobra.mechanics.rubbing import Rubbing

DT = 0.01
COBRA = load_description("cobra")
MODEL = Rubbing(COBRA, described(COBRA).losses)
E1, W1, E3 = (COBRA.tendon_names.index(name) for name in ("E1", "W1", "E3"))
LOWEST, HIGHEST = COBRA.tendon.min_tension_N, COBRA.tendon.max_tension_N
TURN = 1e-4
"""A section's bend of a tick [rad]."""
bend = st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6).map(np.array)


class Blocked:
    """A robot that walls hold: each tendon answers its drive with its own stiffness alone."""

    def __init__(self, tension_N: float = 8.0) -> None:
        self.tension = np.full(12, tension_N)
        self.keeper = TensionKeeper(COBRA, MODEL, described(COBRA))
        self.look()

    def look(self) -> None:
        profile = np.tile(np.maximum(self.tension, 0.0)[:, None], (1, 5))
        seen = TendonEstimate(
            profile[:, 0], profile[:, 0], profile, np.zeros(6), np.zeros(6), np.zeros(12), np.zeros(12), 0.0
        )
        self.keeper.observe(seen, np.zeros(12), DT)

    def tick(self, wanted: np.ndarray) -> np.ndarray:
        """Want a step; the step that was made."""
        before = self.keeper.offset_m
        self.keeper.step(wanted, True, DT)
        made = wanted + self.keeper.offset_m - before
        self.tension = self.tension - MODEL.stiffness_N_m * made
        self.look()
        return made


def bending(bends: np.ndarray) -> np.ndarray:
    return MODEL.slopes @ bends


def along(tendon: int, size: float = TURN) -> np.ndarray:
    """A step that bends the tendon's own section so that it is paid out; negative winds it in."""
    own = bending(np.where(MODEL.column_section == MODEL.section_of[tendon], MODEL.slopes[tendon], 0.0))
    return own * size / np.abs(own).max()


@given(step=st.lists(st.floats(-1e-3, 1e-3), min_size=12, max_size=12).map(np.array))
def test_trims_have_no_moment_and_the_rest_is_bends(step):
    steps = TensionSteps(MODEL.slopes, MODEL.stiffness_N_m)
    assert MODEL.slopes.T @ (MODEL.stiffness_N_m * steps.trims(step)) == pytest.approx(0.0, abs=1e-9)
    assert steps.trims(step) + bending(steps.bends(step)) == pytest.approx(step, abs=1e-12)


@settings(max_examples=25)
@given(wants=st.lists(bend, min_size=1, max_size=4))
def test_no_tendon_leaves_its_limits_whatever_is_wanted_of_a_robot_that_walls_hold(wants):
    robot = Blocked()
    for want in wants:
        for _ in range(80):
            robot.tick(bending(0.01 * want))
            assert robot.tension.min() > LOWEST
            assert robot.tension.max() < HIGHEST
    assert robot.keeper._steps.failures == 0


def test_while_trims_can_help_the_robot_bends_as_wanted():
    robot = Blocked(tension_N=4.0)
    for _ in range(400):
        wanted = along(E1, 1e-5)
        made = robot.tick(wanted)
        assert robot.keeper._steps.bends(made) == pytest.approx(robot.keeper._steps.bends(wanted), abs=1e-5)
    assert robot.tension[W1] > 12.0, "it was wound in by the motion, and by the trims that hold E1"
    assert robot.tension[E1] > LOWEST + 1.0


def test_where_the_highest_tension_binds_the_motion_slows_and_the_pretension_stays():
    robot = Blocked(tension_N=30.0)
    shares = []
    for _ in range(800):
        wanted = along(E1, -2e-5)
        share, why = robot.keeper.allow(wanted, 0.0)
        shares.append(share)
        robot.tick(share * wanted)
    assert shares[0] == 1.0
    assert shares[-1] < 0.05
    assert "E1 is near 40 N" in why
    assert robot.tension.mean() == pytest.approx(30.0, abs=0.1)
    assert robot.keeper.allow(-wanted, 0.0) == (1.0, ""), "what relieves it is free"


def test_overload_freezes_bend_and_feed_and_says_whose_it_is():
    robot = Blocked()
    robot.tension[E3] = HIGHEST + 0.5
    robot.look()
    for wanted, fed_m in ((along(E3, -TURN), 0.0), (along(W1), 0.0), (np.zeros(12), 1e-4)):
        share, why = robot.keeper.allow(wanted, fed_m)
        assert share == 0.0
        assert "E3 is above 40 N" in why
    assert robot.keeper.allow(along(E3), 0.0)[0] == 1.0, "what relieves it is free"
    assert robot.keeper.allow(np.zeros(12), -1e-4)[0] == 1.0, "and feeding out"
    for _ in range(20):
        robot.tick(np.zeros(12))
    assert robot.tension.max() < HIGHEST, "it is paid out"


def test_slack_is_taken_up_at_creep_speed_before_it_is_paid_out_and_bends_nothing():
    robot = Blocked()
    robot.tension[E3] = -2.0
    for _ in range(round(SLACK_HOLD_S / DT) + 1):
        robot.look()
    share, why = robot.keeper.allow(along(E3), 0.0)
    assert share == 0.0
    assert "E3 is slack: it is taken up first" in why
    assert any("E3" in warning for warning in robot.keeper.warnings)
    made = robot.tick(np.zeros(12))
    assert made[E3] == pytest.approx(-CREEP_M_S * DT)
    assert robot.keeper._steps.bends(made) == pytest.approx(0.0, abs=1e-5)
    for _ in range(100):
        made = robot.tick(np.zeros(12))
        assert np.abs(made).max() <= TRIM_M_S * DT
    assert robot.tension[E3] > LOWEST
    assert robot.keeper.warnings == ()


def test_what_cannot_be_held_is_given_way_to():
    robot = Blocked()
    # Both of a pair at their highest and another at its lowest: no trim helps.
    robot.tension[:] = HIGHEST - 0.5
    robot.tension[E1] = HIGHEST + 2.0
    robot.tension[W1] = LOWEST + 1.0
    robot.look()
    for _ in range(60):
        robot.tick(np.zeros(12))
    given_way = robot.keeper.give_way(DT)
    assert bending(given_way)[E1] > 0.0, "it pays out what is overloaded"
    assert robot.tension.max() < HIGHEST
