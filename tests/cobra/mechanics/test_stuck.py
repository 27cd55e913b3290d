"""Claims about tendons that are stuck before the port, by the capstan's equation along a bent conduit, written out."""

import numpy as np
import pytest
from scipy.optimize import brentq

from cobra.kinematics.configuration import Configuration
from cobra.loading import load_description
from cobra.mechanics.losses import described
from cobra.mechanics.rubbing import Rubbing
from cobra.mechanics.stuck import StuckTendons

COBRA = load_description("cobra")
LOSSES = described(COBRA).losses
CONDUIT_M = COBRA.tendon.conduit_length_m
REST_N = 8.0


def stuck(paid_out_m: float, steps: int = 50) -> np.ndarray:
    """(copies, m) [N] after this was paid out, from where homing with dither leaves it: as tense everywhere."""
    model = Rubbing(COBRA, LOSSES)
    extension, stiffness, _ = model.conduits
    extension[:] = REST_N / stiffness
    tendons = StuckTendons(model, 2)
    tendons.begin(0)
    tendons.begin(1)
    for _ in range(steps):
        tension = tendons.advance(np.full(len(stiffness), paid_out_m / steps))
    return tension


@pytest.mark.parametrize("wound_in_mm", [0.2, 1.0, 3.0, 8.0])
def test_winding_in_slides_from_the_motor_as_far_as_friction_lets_it(wound_in_mm):
    """T(s) = T_m e^(−κ s) up to where it meets what was there before: as much longer as was wound in."""
    capstan, stretch_N = LOSSES.conduit_capstan / CONDUIT_M, 1e-3 * wound_in_mm * LOSSES.axial_stiffness_N

    def missing(motor_N: float) -> float:
        end = min(np.log(motor_N / REST_N) / capstan, CONDUIT_M)
        return motor_N * -np.expm1(-capstan * end) / capstan - REST_N * end - stretch_N

    expected = brentq(missing, REST_N * (1 + 1e-9), 1000.0)
    assert expected > REST_N + stretch_N / CONDUIT_M
    np.testing.assert_allclose(stuck(-1e-3 * wound_in_mm), expected, rtol=0.03)


def test_paying_out_ends_slack_and_not_below():
    assert np.all(stuck(0.002) < REST_N - 0.002 * LOSSES.axial_stiffness_N / CONDUIT_M)
    assert np.all(stuck(0.1) == 0.0)


def test_a_copy_begins_with_what_the_model_has_then_and_others_go_on():
    model = Rubbing(COBRA, LOSSES)
    model.reset(np.full(12, REST_N))
    tendons = StuckTendons(model, 2)
    tendons.begin(0)
    before = tendons.advance(np.full(12, -0.001))
    model.advance(np.full(12, -0.001), Configuration(COBRA).rest(), np.zeros(6), 0.01)
    tendons.begin(1)
    after = tendons.advance(np.zeros(12))
    np.testing.assert_allclose(after[0], before[0])
    np.testing.assert_allclose(after[1], model.motor_N)
    assert np.all(after[0] > after[1]), "what gives way behind the port carries less"
