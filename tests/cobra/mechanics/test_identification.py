"""Claims about stiffness, damping and friction from measured data, against motions integrated step by step."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cobra.errors import OperatorError
from cobra.mechanics.estimates import spread
from cobra.mechanics.friction import transmission
from cobra.mechanics.identification import (
    fit_sweep,
    friction_in_guiders,
    points_in_another_unit,
    stiffness_from_load_test,
)
from cobra.mechanics.release import coefficients, fit_release, release_motion

EI, L0 = 0.1006, 0.05


def load_test(rng, sets=10, points=8, scatter=0.03):
    """Moments and angles of `sets` repetitions, each with a stiffness of its own."""
    own = EI * (1.0 + scatter * rng.standard_normal(sets))
    angle = np.tile(np.radians(np.linspace(2.0, 30.0, points)), sets)
    moment = np.repeat(own, points) / L0 * angle + 0.002 * rng.standard_normal(sets * points)
    return moment, angle, np.repeat(np.arange(sets), points), own


def test_stiffness_is_the_mean_slope_times_the_length():
    """S-38: EI = τ L₀/Δθ, as the mean over the sets, as the paper takes it over ten."""
    moment, angle, sets, own = load_test(np.random.default_rng(1))
    found = stiffness_from_load_test("bending", moment, angle, rest_length_m=L0, sets=sets)
    assert found.stiffness.value == pytest.approx(own.mean(), rel=0.01)
    assert found.set_stiffness == pytest.approx(own, rel=0.03)
    assert found.stiffness.low < own.mean() < found.stiffness.high
    force = 5136.0 * np.linspace(0.0, 0.008, 9) + 3.0
    pulled = stiffness_from_load_test("elongation", force, np.linspace(0.0, 0.008, 9), rest_length_m=L0)
    assert pulled.stiffness.value == pytest.approx(5136.0)
    assert pulled.offsets == pytest.approx([3.0])
    assert pulled.nonlinearity < 1e-9


@pytest.mark.parametrize("sets", [1, 6])
def test_the_interval_holds_the_true_stiffness_as_often_as_it_says(sets):
    rng = np.random.default_rng(2)
    inside = 0
    for _ in range(400):
        moment, angle, labels, _ = load_test(rng, sets=sets, scatter=0.03 if sets > 1 else 0.0)
        found = stiffness_from_load_test("bending", moment, angle, rest_length_m=L0, sets=labels).stiffness
        inside += found.low < EI < found.high
    assert 0.91 < inside / 400 < 0.99


@pytest.mark.parametrize(
    ("moment", "angle", "says"),
    [
        ([1.0, 2.0, 3.0], [3.0, 2.0, 1.0], "count both in the same direction"),
        ([1.0, 2.0, 3.0], [0.1, 0.1, 0.1], "different deflections"),
        ([1.0, 2.0], [0.1, 0.2], "3 points or more"),
    ],
)
def test_a_load_test_that_tells_nothing_says_so(moment, angle, says):
    with pytest.raises(OperatorError, match=says):
        stiffness_from_load_test("bending", moment, angle, rest_length_m=L0)


def test_points_in_another_unit_are_found_and_others_are_not():
    moment, angle, _, _ = load_test(np.random.default_rng(3))
    assert points_in_another_unit(moment, angle) == {}
    wrong_angle, wrong_moment = angle.copy(), moment.copy()
    wrong_angle[23] *= 1e-3
    wrong_moment[30] *= 1e3
    assert set(points_in_another_unit(moment, wrong_angle)) == {23}
    assert set(points_in_another_unit(wrong_moment, angle)) == {30}


def stepped(time, start, omega, zeta, friction, let_go):
    """x″ = −ω²x − 2ζω x′ − ω² x_c sign x′ by small steps; it sticks where the spring cannot overcome friction."""
    out, x, v = [], start, 0.0
    fine = 200
    h = (time[1] - time[0]) / fine
    for t in time:
        out.append(x)
        if t < let_go - 1e-9:
            continue
        for _ in range(fine):
            free = -omega * omega * x - 2.0 * zeta * omega * v
            held = omega * omega * friction
            if v == 0.0 and abs(free) <= held:
                break
            accelerated = free - held * np.sign(v if v != 0.0 else free)
            faster = v + h * accelerated
            v = 0.0 if v * faster < 0.0 else faster
            x += h * v
    return np.array(out)


@pytest.mark.parametrize(("zeta", "friction"), [(0.05, 0.01), (0.02, 0.0), (0.01, 0.02)])
def test_damping_and_friction_are_told_apart_in_a_release(zeta, friction):
    """The recording begins before the release, at a clock of its own, about a rest that is not zero, with noise."""
    rng = np.random.default_rng(4)
    time = np.arange(0.0, 4.0, 0.01)
    x = 0.1 + stepped(time, 0.3, 12.0, zeta, friction, 0.5) + 0.001 * rng.standard_normal(len(time))
    found = fit_release(time + 1.7e9, x)
    assert found.natural_rad_s.value == pytest.approx(12.0, rel=0.01)
    assert found.damping_ratio.value == pytest.approx(zeta, abs=0.002)
    assert found.friction.value == pytest.approx(friction, abs=0.0007)
    assert found.rest.value == pytest.approx(0.1, abs=0.001)
    assert found.begin_s == pytest.approx(1.7e9 + 0.5, abs=0.01)
    assert found.rms < 0.0013
    numbers = coefficients(found, 2.0)
    assert numbers.inertia == pytest.approx(2.0 / 144.0, rel=0.02)
    assert numbers.damping.value == pytest.approx(2.0 * zeta * 2.0 / 12.0, abs=0.001)


def test_an_overdamped_release_does_not_claim_to_know_friction():
    """One swing that never turns back: friction only shifts where it comes to rest."""
    time = np.arange(0.0, 3.0, 0.01)
    x = stepped(time, 0.3, 12.0, 2.0, 0.01, 0.2) + 0.001 * np.random.default_rng(5).standard_normal(len(time))
    found = fit_release(time, x)
    assert found.friction.high - found.friction.low > 1.0
    slow = found.natural_rad_s.value * (found.damping_ratio.value - np.sqrt(found.damping_ratio.value**2 - 1.0))
    assert slow == pytest.approx(12.0 * (2.0 - np.sqrt(3.0)), rel=0.02)


@given(zeta=st.floats(0.0, 3.0), friction=st.floats(0.0, 0.05))
@settings(max_examples=30, deadline=None)
def test_the_exact_release_is_the_stepped_one(zeta, friction):
    time = np.arange(0.0, 1.0, 0.02)
    exact = release_motion(time, 0.3, 12.0, zeta, friction, 0.0, begin_s=0.1)
    assert exact == pytest.approx(stepped(time, 0.3, 12.0, zeta, friction, 0.1), abs=2e-3)


@pytest.mark.parametrize("x", [np.zeros(50), np.arange(5.0)])
def test_a_release_that_does_not_move_is_refused(x):
    with pytest.raises(OperatorError, match="at least 12 samples of something that moves"):
        fit_release(np.arange(len(x)) * 0.1, x)


def sweep(rng, speeds=(0.3, 0.6, 1.2)):
    time = np.arange(0.0, 30.0, 0.02)
    phase = np.cumsum(np.repeat(speeds, len(time) // len(speeds))) * 0.02
    x = 0.5 * np.sin(phase)
    v = np.gradient(x, time)
    load = 2.0 * x + 0.1 * v + 0.05 * np.sign(v) + 0.3 + 0.003 * rng.standard_normal(len(time))
    return time, x, load


def test_a_sweep_tells_stiffness_damping_and_friction():
    found = fit_sweep(*sweep(np.random.default_rng(6)))
    for estimate, true, tolerance in (
        (found.stiffness, 2.0, 0.01),
        (found.damping, 0.1, 0.01),
        (found.friction, 0.05, 0.002),
        (found.offset, 0.3, 0.002),
    ):
        assert estimate.value == pytest.approx(true, abs=tolerance)
        assert estimate.low - 1e-3 < true < estimate.high + 1e-3
    assert not found.used.all(), "around the reversals friction has no clear direction"


def test_a_sweep_that_never_turns_back_cannot_tell_friction():
    time = np.arange(0.0, 5.0, 0.1)
    with pytest.raises(OperatorError, match="never turns back"):
        fit_sweep(time, 0.1 * time, 2.0 * time)
    with pytest.raises(OperatorError, match="at least 12"):
        fit_sweep(time[:5], time[:5], time[:5])


def test_friction_in_the_guiders_comes_from_both_directions():
    """S-36 on winding in, S-37 on paying out."""
    rng = np.random.default_rng(7)
    angles = np.radians(rng.uniform(-18.0, 18.0, (60, 5)))
    winding = np.arange(60) % 2 == 0
    motor = rng.uniform(5.0, 15.0, 60)
    g = transmission(angles, 0.12)
    top = motor * np.where(winding, g, 1.0 / g) * (1.0 + 0.005 * rng.standard_normal(60))
    found = friction_in_guiders(motor, top, angles, winding)
    assert found.value == pytest.approx(0.12, abs=0.01)
    assert found.low < 0.12 < found.high
    swapped = friction_in_guiders(motor, top, angles, ~winding)
    assert swapped.value < 0.01, "friction never adds force"
    with pytest.raises(OperatorError, match="tensions above zero"):
        friction_in_guiders(motor, 0.0 * top, angles, winding)
    with pytest.raises(OperatorError, match="straight throughout"):
        friction_in_guiders(motor, top, 0.0 * angles, winding)


def test_neighbours_that_share_their_errors_count_for_less():
    rng = np.random.default_rng(8)
    white = rng.standard_normal(2000)
    smooth = np.convolve(rng.standard_normal(2019), np.ones(20) / np.sqrt(20.0), mode="valid")
    column = np.ones((2000, 1))
    assert spread(column, white, in_order=True).deviation[0] == pytest.approx(1.0 / np.sqrt(2000.0), rel=0.1)
    assert spread(column, smooth, in_order=True).deviation[0] > 3.0 / np.sqrt(2000.0)
