import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cobra.kinematics.ramps import approached, braking_speed, reached, shortened

DT = 0.01


@settings(deadline=None)
@given(st.floats(0.0, 2.0), st.floats(0.1, 5.0))
def test_from_the_braking_speed_it_comes_to_rest_exactly_at_the_limit(distance, acceleration):
    speed, left, ticks = braking_speed(distance, acceleration, DT), distance, 0
    while left > 1e-9 and ticks < 1000:
        left -= speed * DT
        slower = braking_speed(left, acceleration, DT)
        assert slower >= speed - acceleration * DT - 1e-9
        speed, ticks = min(slower, speed), ticks + 1
    assert left == pytest.approx(0.0, abs=1e-8)
    # As fast as continuous braking would be, and at most a tick or two more.
    assert ticks <= math.sqrt(2 * distance / acceleration) / DT + 2


def test_nothing_is_left_to_move_at_or_beyond_the_limit():
    assert braking_speed(0.0, 1.0, DT) == 0.0
    assert braking_speed(-0.1, 1.0, DT) == 0.0


def test_a_vector_is_shortened_and_keeps_its_direction():
    np.testing.assert_allclose(shortened(np.array([3.0, 4.0]), 1.0), [0.6, 0.8])
    np.testing.assert_array_equal(shortened(np.array([0.3, 0.4]), 1.0), [0.3, 0.4])
    np.testing.assert_array_equal(shortened(np.zeros(2), 0.0), [0.0, 0.0])


def test_a_value_approaches_by_no_more_than_a_step():
    assert approached(0.0, 1.0, 0.1) == pytest.approx(0.1)
    assert approached(0.0, -1.0, 0.1) == pytest.approx(-0.1)
    assert approached(0.95, 1.0, 0.1) == 1.0


def test_a_way_ends_on_the_rim_of_the_disc():
    end = reached(np.zeros(2), np.array([2.0, 0.0]), np.array([0.0, 0.5]), 1.0)
    np.testing.assert_allclose(end, [math.sqrt(0.75), 0.0])
    np.testing.assert_array_equal(reached(np.zeros(2), np.array([0.2, 0.0]), np.zeros(2), 1.0), [0.2, 0.0])
    np.testing.assert_array_equal(reached(np.ones(2), np.ones(2), np.zeros(2), 2.0), [1.0, 1.0])
