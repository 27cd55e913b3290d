import msgspec
import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from scipy.optimize import LinearConstraint, minimize

from cobra.kinematics import resolved_rates
from cobra.kinematics.backbone import Backbone, in_tip_frame
from cobra.kinematics.configuration import FEED, TWIST
from cobra.kinematics.resolved_rates import ResolvedRates
from cobra.kinematics.tendons import TendonMap

DT = 0.01


def with_travel(robot, travel_m):
    """The robot with tendons that can be wound in and paid out only so far."""
    drives = [
        msgspec.structs.replace(drive, travel_range=(-travel_m, travel_m)) if drive.moves == "tendon" else drive
        for drive in robot.drives
    ]
    return msgspec.structs.replace(robot, drives=tuple(drives))


class Driven:
    """A robot driven by resolved rates, tick by tick."""

    def __init__(self, robot, q=None):
        self.rates = ResolvedRates(robot)
        self.rates.warm_up()
        self.backbone = Backbone(robot)
        self.q = self.rates.configuration.rest() if q is None else np.array(q, dtype=float)
        self.velocity = np.zeros_like(self.q)

    def step(self, command):
        step = self.rates.step(self.q, self.velocity, np.array(command, dtype=float), DT)
        self.q, self.velocity = step.q, step.velocity
        return step

    def drive(self, command, seconds):
        for _ in range(round(seconds / DT)):
            step = self.step(command)
        return step

    def tip(self):
        return self.backbone.tip(self.q)

    def tip_velocity(self):
        return in_tip_frame(self.tip(), self.backbone.tip_jacobian(self.q)) @ self.velocity


BENT = [0.2, 0.35, 0.5, 0.2, 0.3, -0.4, -0.2, 0.3]


@pytest.mark.parametrize("command", [[0.02, 0, 0], [0, -0.02, 0], [0, 0, 0.02], [0.01, 0.01, -0.01]])
def test_the_tip_moves_as_commanded_in_its_camera_frame(cobra, command):
    driven = Driven(cobra, BENT)
    driven.drive([*command, 0, 0, 0.1], 0.5)
    step = driven.drive([*command, 0, 0, 0.1], 0.2)
    assert (step.solver, step.scale) == ("qp", pytest.approx(1.0, abs=0.01))
    np.testing.assert_allclose(driven.tip_velocity()[:3], command, atol=4e-4)
    assert driven.tip_velocity()[5] == pytest.approx(0.1, abs=0.003)


def test_a_square_drawn_in_tip_mode_closes(cobra):
    """Right, down, left, up in the plane across the start's view, with the roll held: back within 1 % of reach."""
    driven = Driven(cobra)
    begin = driven.tip()
    for aim in ([0.06, 0, 0], [0.06, 0.06, 0], [0, 0.06, 0], [0, 0, 0]):
        for _ in range(600):
            tip = driven.tip()
            error = begin[:3, 3] + begin[:3, :3] @ aim - tip[:3, 3]
            speed = error * min(2.0, 0.03 / max(np.linalg.norm(error), 1e-9))
            driven.step([*(tip[:3, :3].T @ speed), 0, 0, 0])
        assert np.linalg.norm(error) < 0.002
    assert np.linalg.norm(driven.tip()[:3, 3] - begin[:3, 3]) < 0.01 * cobra.active_length_m


@pytest.mark.parametrize("command", [[0.03, 0, 0], [0.02, 0.02, -0.02], [0, 0, -0.03]])
def test_what_cannot_be_reached_slows_and_stops_along_its_direction(cobra, command):
    """To the right, or back into the port, without end: the tip keeps its line while it moves, never jumps, and stops."""
    driven = Driven(cobra, BENT)
    before, scales = np.zeros(3), []
    wanted = np.linalg.norm(command)
    for tick in range(2500):
        tip = driven.tip()
        step = driven.step([*command, 0, 0, 0])
        velocity = tip[:3, :3].T @ (driven.tip() - tip)[:3, 3] / DT
        speed = np.linalg.norm(velocity)
        scales.append(step.scale)
        if tick > 10:
            assert np.linalg.norm(velocity - before) < 0.004
        if speed > 0.3 * wanted:
            assert velocity @ command / (speed * wanted) > np.cos(np.radians(10))
        before = velocity
    assert scales[-1] < 0.3
    assert step.binding
    assert speed < 0.3 * wanted


def test_at_a_singularity_nothing_is_fast(robots):
    """The straight active segment, fed by hand, cannot go forward: the bends stay slow instead of exploding."""
    driven = Driven(robots["by-hand"])
    for _ in range(100):
        step = driven.step([0, 0, 0.03, 0, 0, 0])
        assert np.abs(driven.velocity).max() < 0.05
    assert step.damping > 0
    assert step.scale < 0.05
    assert any("singular" in word for word in step.binding)


def test_a_borescope_without_tendons_feeds_and_rolls_and_says_what_it_cannot(robots):
    driven = Driven(robots["twist-feed"])
    step = driven.drive([0, 0, 0.02, 0, 0, 0.3], 1.0)
    assert step.scale == pytest.approx(1.0, abs=0.01)
    np.testing.assert_allclose(driven.velocity[:2], [0.3, 0.02], atol=1e-3)
    driven.drive(np.zeros(6), 0.5)
    step = driven.drive([0.02, 0, 0, 0, 0, 0], 1.0)
    assert step.scale < 0.05
    assert step.binding
    np.testing.assert_allclose(driven.velocity, 0.0, atol=1e-6)


def test_letting_go_brakes_at_once_and_stands(cobra):
    driven = Driven(cobra, BENT)
    driven.drive([0.03, 0.02, 0.01, 0, 0, 0], 1.0)
    speed = np.abs(driven.velocity)
    for _ in range(30):
        assert driven.step(np.zeros(6)).solver == "braking"
        assert np.all(np.abs(driven.velocity) <= speed)
        speed = np.abs(driven.velocity)
    np.testing.assert_array_equal(driven.velocity, 0.0)


def test_the_null_space_straightens_a_winding_body_while_the_tip_obeys(cobra, monkeypatch):
    def wound(centring):
        monkeypatch.setattr(resolved_rates, "CENTRING", centring)
        driven = Driven(cobra, [0.0, 0.4, 1.0, 0.0, -1.2, 0.3, 0.6, -0.4])
        start = driven.tip()[:3, 3]
        driven.drive([0.0, 0.0, 0.005, 0, 0, 0], 2.0)
        return np.sum(driven.q[2:] ** 2), np.linalg.norm(driven.tip()[:3, 3] - start)

    with_centring, without = wound(resolved_rates.CENTRING), wound(0.0)
    assert with_centring[0] < without[0] - 0.005
    assert with_centring[1] == pytest.approx(without[1], rel=0.05)


@pytest.mark.parametrize("seed", range(12))
def test_the_program_is_solved_as_a_general_purpose_solver_does(cobra, seed):
    """Random shapes, rates and commands; the objective of the module's docstring, by scipy's SLSQP."""
    rng = np.random.default_rng(seed)
    rates = ResolvedRates(with_travel(cobra, 0.006) if seed % 2 else cobra)
    q = rates.configuration.rest()
    q[FEED], q[TWIST] = rng.uniform(0.22, 0.4), rng.uniform(-1, 1)
    limits = Backbone(cobra).bend_limits(q)
    q[2:] = (rng.uniform(-0.6, 0.6, (3, 2)) * np.minimum(limits, 0.5)[:, None]).ravel()
    velocity = rates.configuration.rate * rng.uniform(-0.1, 0.1, 8)
    bounds = rates.limits.bounds(q, velocity, DT)
    assert np.all(bounds.rows @ bounds.braking <= bounds.high[8:])  # there is a step that keeps everything
    J, e = rng.normal(size=(4, 8)), rng.normal(size=4)
    e /= np.linalg.norm(e)
    scale = rates.configuration.rate * 10 ** rng.uniform(-1.5, 0.3)
    damping, centre = 0.01, rng.uniform(-0.3, 0.3, 8)
    Q = np.linalg.qr(rng.normal(size=(8, 8)))[0][:, :4]
    null = Q @ Q.T

    def cost(x):
        y, s = x[:8], x[8]
        kept = null @ (y - centre)
        return 0.5 * (
            np.sum((J @ y - s * e) ** 2)
            + resolved_rates.DIRECTION * (1 - s) ** 2
            + damping * y @ y
            + resolved_rates.CENTRING * kept @ kept
        )

    y, share = resolved_rates._solve(J, e, damping, null, centre, scale, bounds)
    A = np.column_stack([np.vstack([np.eye(8), bounds.rows]) * scale, np.zeros(8 + len(bounds.rows))])
    A = np.vstack([A, np.eye(9)[8]])
    low, high = np.append(bounds.low, 0.0), np.append(bounds.high, 1.0)
    found = np.append(y, share)
    assert np.all(A @ found <= high + 1e-5)
    assert np.all(A @ found >= low - 1e-5)
    start = np.append(bounds.braking / scale, 0.0)
    constraint = LinearConstraint(A, low, high)
    best = minimize(cost, start, method="SLSQP", constraints=constraint, options={"maxiter": 500, "ftol": 1e-13})
    assert cost(found) <= best.fun + 1e-6
    if best.success:
        assert cost(found) >= best.fun - 1e-4 * (1 + best.fun)


def test_damped_least_squares_steps_in_and_says_so_when_the_solver_fails(cobra, monkeypatch):
    driven = Driven(cobra, BENT)
    monkeypatch.setattr(resolved_rates.daqp, "solve", lambda *_: (np.full(9, np.nan), 0.0, -1, {}))
    step = driven.drive([0.01, 0, 0, 0, 0, 0], 0.5)
    assert step.solver == "damped least squares"
    assert driven.rates.fallbacks == 50
    np.testing.assert_allclose(driven.tip_velocity()[:3], [0.01, 0, 0], atol=1e-3)


def test_it_tells_which_tendon_is_at_its_end(cobra):
    driven = Driven(with_travel(cobra, 0.001))
    step = driven.drive([0.03, 0, 0, 0, 0, 0], 4.0)
    assert any("tendon E" in word and "end of its travel" in word for word in step.binding)


commands = st.tuples(
    st.lists(st.floats(-1, 1), min_size=6, max_size=6), st.sampled_from([0.0, 0.01, 0.1, 0.4]), st.integers(3, 60)
)


@settings(max_examples=6, deadline=None, phases=[Phase.explicit, Phase.reuse, Phase.generate])
@given(st.lists(commands, min_size=3, max_size=8), st.sampled_from([0.06, 0.17, 0.3]), st.sampled_from([0.003, 0.06]))
def test_limits_hold_at_every_tick_whatever_the_sticks_do(robot, history, feed_m, travel_m):
    robot = with_travel(robot, travel_m)
    driven = Driven(robot)
    layout, tendons = driven.rates.configuration, TendonMap(robot)
    # Tendons that end while a section's length and bend brake in different times: there it may have to stop short.
    ramped = travel_m > 0.01 or not any(layout.lengths)
    if robot.feed:
        driven.q[FEED] = feed_m
    for direction, size, ticks in history:
        for _ in range(ticks):
            q, velocity = driven.q, driven.velocity
            step = driven.step(np.array(direction) * size)
            assert np.all(np.isfinite(step.q))
            assert np.all((layout.low - 1e-12 <= step.q) & (step.q <= layout.high + 1e-12))
            lengths = tendons.lengths(step.q)
            assert np.all(np.abs(lengths) <= travel_m + 1e-12)
            change = np.abs(step.velocity - velocity)
            limits = driven.backbone.bend_limits(step.q)
            for i in robot.active_sections:
                where = layout.bends[i]
                bend = np.hypot(*step.q[where])
                assert bend <= limits[i] + 1e-12
                assert np.hypot(*(step.q - q)[where]) <= layout.rate[where.start] * DT * (1 + 1e-9)
                if ramped and bend < limits[i] - 1e-6:  # else the port itself straightens what slides into it
                    assert np.hypot(*change[where]) <= layout.acceleration[where.start] * DT * 1.001
            for index in (TWIST, FEED, *(k for k in layout.lengths if k is not None)):
                assert abs(step.velocity[index]) <= layout.rate[index] * (1 + 1e-9)
                assert not ramped or change[index] <= layout.acceleration[index] * DT * 1.001 + 1e-12


def test_the_largest_step_of_a_share_stays_within(cobra):
    rates = ResolvedRates(cobra)
    bounds = rates.limits.bounds(rates.configuration.rest(), np.zeros(8), DT)
    wish = np.full(8, 3.0)
    share = bounds.share(wish)
    values = np.concatenate([wish, bounds.rows @ wish]) * share
    assert 0 < share < 1
    assert np.all(values <= bounds.high + 1e-9)
    assert np.any(np.abs(values - bounds.high) < 1e-9)
