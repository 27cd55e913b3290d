from fractions import Fraction
from math import factorial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from cobra.kinematics import section

angles = st.floats(-4.0, 4.0)
bends = st.tuples(angles, angles).map(np.array)
near_straight = st.tuples(st.floats(-1e-3, 1e-3), st.floats(-1e-3, 1e-3)).map(np.array)
lengths = st.floats(0.01, 0.5)


def screw(bend, length):
    """An arc as the exponential of its constant twist: an independent way to C-1 that knows no polar angle."""
    x, y = bend
    return expm(np.array([[0, 0, x, 0], [0, 0, y, 0], [-x, -y, 0, length], [0, 0, 0, 0]]))


@settings(deadline=None)
@given(st.floats(0.01, 6.0), st.floats(-np.pi, np.pi), lengths)
def test_it_is_the_papers_polar_formula_away_from_straight(theta, phi, length):
    bend = theta * np.array([np.cos(phi), np.sin(phi)])
    printed = (
        length / theta * np.array([np.cos(phi) * (1 - np.cos(theta)), np.sin(phi) * (1 - np.cos(theta)), np.sin(theta)])
    )
    turn = Rotation.from_euler("ZYZ", [phi, theta, -phi]).as_matrix()
    np.testing.assert_allclose(section.translation(bend, length), printed, atol=2e-15)
    np.testing.assert_allclose(section.rotation(bend), turn, atol=5e-15)


@settings(deadline=None)
@given(st.one_of(bends, near_straight), lengths)
def test_it_is_a_constant_twist_from_straight_to_beyond_a_half_turn(bend, length):
    np.testing.assert_allclose(section.transform(bend, length), screw(bend, length), atol=2e-14)


def test_straight_is_exact():
    np.testing.assert_array_equal(section.translation(np.zeros(2), 0.1), [0, 0, 0.1])
    np.testing.assert_array_equal(section.rotation(np.zeros(2)), np.eye(3))


@settings(deadline=None)
@given(st.floats(0.0, 0.3))
def test_coefficients_are_right_to_rounding_where_closed_forms_lose_digits(theta):
    t2 = theta * theta
    exact = Fraction(t2)
    powers = [(-exact) ** k for k in range(14)]

    def series(odd):
        return sum(p / factorial(2 * k + odd) for k, p in enumerate(powers))

    def slope(odd):
        return -sum(k * powers[k - 1] / factorial(2 * k + odd) for k in range(1, 14))

    expected = [float(v) for v in (series(1), series(2), series(3), slope(1), slope(2))]
    np.testing.assert_allclose(section.coefficients(t2), expected, rtol=4e-16 * 2)


@settings(deadline=None)
@given(st.floats(0.25, 0.40))
def test_series_and_closed_form_agree_where_they_meet(theta):
    t2 = theta * theta
    powers = [(-t2) ** k for k in range(12)]
    expected = [sum(p / factorial(2 * k + odd) for k, p in enumerate(powers)) for odd in (1, 2, 3)]
    got = section.coefficients(t2)
    np.testing.assert_allclose(got[:3], expected, rtol=1e-14)
    np.testing.assert_allclose(got.D1, (np.cos(theta) - expected[0]) / (2 * t2), rtol=2e-14)


@settings(deadline=None)
@given(st.one_of(bends, near_straight, st.just(np.zeros(2))), lengths)
def test_the_jacobian_is_the_complex_step_of_the_twist(bend, length):
    found = section.jacobian(bend, length)
    end = screw(bend, length)
    step = 1e-30
    for k in range(3):
        x = np.array([*bend, length], dtype=complex)
        x[k] += 1j * step
        slope = screw(x[:2], x[2]).imag / step
        np.testing.assert_allclose(found.translation[:, k], slope[:3, 3], atol=1e-14)
        spin = slope[:3, :3] @ end[:3, :3].T
        turning = [spin[2, 1], spin[0, 2], spin[1, 0]]
        expected = found.rotation[:, k] if k < 2 else np.zeros(3)
        np.testing.assert_allclose(expected, turning, atol=2e-14)


@settings(deadline=None)
@given(bends)
def test_no_twist_is_left_behind(bend):
    axis = np.array([-bend[1], bend[0], 0.0])
    np.testing.assert_allclose(section.rotation(bend), Rotation.from_rotvec(axis).as_matrix(), atol=1e-14)


def test_it_broadcasts_over_leading_dimensions():
    rng = np.random.default_rng(1)
    b = rng.normal(size=(4, 3, 2)) * [[[1.0]], [[0.01]], [[2.0]], [[0.0]]]
    length = rng.uniform(0.05, 0.1, size=3)
    together = section.transform(b, length)
    jacobian = section.jacobian(b, length)
    assert together.shape == (4, 3, 4, 4)
    for i in range(4):
        for j in range(3):
            np.testing.assert_allclose(together[i, j], section.transform(b[i, j], length[j]), atol=1e-15)
            one = section.jacobian(b[i, j], length[j]).translation
            np.testing.assert_allclose(jacobian.translation[i, j], one, atol=1e-15)


@pytest.mark.parametrize("phi", [0.0, 0.7, -2.0])
def test_src_bots_printed_rotation_turns_what_follows_about_the_backbone(phi):
    theta = 0.8
    bend = theta * np.array([np.cos(phi), np.sin(phi)])
    printed = section.printed_rotation_src_bot(phi, theta)
    np.testing.assert_allclose(printed[:, 2], section.rotation(bend)[:, 2], atol=1e-15)
    left_behind = section.rotation(bend).T @ printed
    np.testing.assert_allclose(left_behind, Rotation.from_euler("z", phi).as_matrix(), atol=1e-15)
