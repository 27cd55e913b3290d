"""Claims about tendons with friction that remember, and the shape in balance with them."""

import numpy as np
import pytest

from cobra.loading import load_description
from cobra.mechanics.losses import Losses
from cobra.mechanics.rubbing import Rubbing

TENSION_N = 8.0


@pytest.fixture
def model() -> Rubbing:
    robot = load_description("cobra")
    model = Rubbing(robot, Losses.described(robot))
    model.reset(np.full(12, TENSION_N))
    return model


def move(model: Rubbing, travel: np.ndarray, steps: int = 40, dt_s: float = 0.5) -> None:
    """Slowly: what is viscous does not count."""
    q = at_rest(model)
    for _ in range(steps):
        model.advance(travel / steps, q, np.zeros(6), dt_s)


def at_rest(model: Rubbing) -> np.ndarray:
    return model.tendons.rest.copy()


def test_tension_falls_along_the_conduit_by_the_capstan_law_either_way(model):
    loss = np.exp(model.losses.conduit_capstan)
    move(model, np.full(12, -0.002))
    assert model.profile_N[:, 0] / model.profile_N[:, 1] == pytest.approx(loss, rel=1e-3)
    move(model, np.full(12, 0.003))
    assert model.profile_N[:, 1] / model.profile_N[:, 0] == pytest.approx(loss, rel=1e-3)


def test_a_reversal_loses_the_motion_that_the_capstan_law_says(model):
    move(model, np.full(12, -0.002))
    port = model.profile_N[:, 1].copy()
    paid, step = 0.0, 2e-5
    while np.all(model.profile_N[:, 1] > port - 0.01):
        move(model, np.full(12, step), steps=1)
        paid += step
    # E6: the tension between motor and port turns from T e^{a x} to T e^{-a x}, and with it the stretch.
    a, length = model.losses.conduit_capstan, 4.7
    lost = port[0] * length / model.losses.axial_stiffness_N * 2.0 * (np.cosh(a) - 1.0) / a
    assert paid == pytest.approx(lost, rel=0.1)


def test_where_it_says_the_motor_ends_must_go_the_bends_arrive_also_after_a_reversal(model):
    q, nothing = at_rest(model), np.zeros(12)
    for goal in (0.6, -0.4, 0.1):
        start = model.bends[0]
        for share in np.linspace(0.0, 1.0, 30)[1:]:
            q[2], q[5] = start + share * (goal - start), 0.5 * share
            shift = model.reach(q, np.zeros_like(q), nothing, np.zeros(6), np.zeros((2, 6)))
            model.advance(model.slopes @ shift, q, np.zeros(6), 0.5)
        assert model.bends[0] == pytest.approx(goal, abs=np.radians(1.0))
        assert model.bends[3] == pytest.approx(0.5, abs=np.radians(1.0))


def test_a_slack_tendon_does_not_push(model):
    paid = np.zeros(12)
    paid[0] = 0.02
    move(model, paid)
    assert model.motor_N[0] == 0.0
    assert np.all(model.motor_N >= 0.0)
