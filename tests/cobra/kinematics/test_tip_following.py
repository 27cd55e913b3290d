import numpy as np
import pytest
from hypothesis import Phase, example, given, settings
from hypothesis import strategies as st

from cobra.kinematics.configuration import FEED
from cobra.kinematics.tip_following import TipFollowing
from cobra.kinematics.tip_path import SPACING_M, TipPath

DT = 0.01
STILL = np.zeros(2)


@pytest.fixture(scope="module")
def cobra_following(cobra):
    following = TipFollowing(cobra)
    following.warm_up()
    return following


def start(following, feed_m):
    q = following.configuration.rest()
    q[FEED] = feed_m
    following.reset(q)
    return following


def drive(following, steer, feed, seconds):
    for _ in range(round(seconds / DT)):
        following.take(*following.propose(np.asarray(steer, dtype=float), feed, DT))


def feed_to(following, feed_m):
    while abs(distance := feed_m - following.q[FEED]) > 1e-4:
        following.take(*following.propose(STILL, np.clip(8 * distance, -0.03, 0.03), DT))


def test_a_straight_robot_fed_straight_stays_straight(cobra_following):
    following = start(cobra_following, 0.05)
    drive(following, STILL, 0.02, 5.0)
    np.testing.assert_array_equal(following.q[2:], 0.0)
    assert following.q[FEED] == pytest.approx(0.15, abs=0.003)
    assert following.deviation_max_m < 1e-12
    np.testing.assert_allclose(following.path.points[:, :2], 0.0, atol=1e-15)


def test_the_body_goes_where_the_tip_has_passed_and_back(cobra_following):
    """Turn 70° aside while feeding, feed on, then retract: the body stays within 3 % of its length, and unbends."""
    following = start(cobra_following, 0.10)
    drive(following, [0.28, 0.1], 0.025, 4.0)
    drive(following, STILL, 0.015, 0.5)
    bent = following.path.points.copy()
    feed_to(following, 0.29)
    assert following.deviation_max_m < 0.03 * 0.3
    np.testing.assert_array_equal(following.path.points[: len(bent)], bent)
    there = following.q.copy()
    feed_to(following, 0.15)
    feed_to(following, 0.29)
    np.testing.assert_allclose(following.q, there, atol=0.02)
    feed_to(following, 0.01)
    np.testing.assert_array_equal(following.q[2:6], 0.0)
    assert following.deviation_max_m < 0.03 * 0.3


def test_steering_while_feeding_turns_the_path_at_the_rate_of_the_stick(cobra_following):
    following = start(cobra_following, 0.05)
    drive(following, [0.2, 0.0], 0.02, 4.0)
    heading = following.path.points[-1] - following.path.points[-2]
    heading /= np.linalg.norm(heading)
    assert np.arccos(heading[2]) == pytest.approx(0.2 * 4.0, rel=0.05)
    assert following.path.length_m == pytest.approx(following.q[FEED], abs=SPACING_M)
    # The tip looks where the path goes, as well as arcs can, and the section behind has learnt the turn.
    tip = following._backbone.tip(following.q)[:3, 2]
    assert np.arccos(tip @ heading) < 0.15
    assert following.q[4] > 0.1
    assert following.deviation_max_m < 0.01 * 0.3


def test_steering_never_makes_the_path_sharper_than_the_sections_can_bend(cobra_following):
    following = start(cobra_following, 0.12)
    for feed in (0.0, 0.004, 0.0, 0.004):
        drive(following, [0.5, 0.0], feed, 3.0)
    assert following.path.sharpness(0.0) < 0.95 * np.radians(90) / 0.1
    assert following.q[6] > 1.0


def test_steering_at_a_standstill_rewrites_only_what_lies_under_the_leading_section(cobra_following):
    following = start(cobra_following, 0.10)
    drive(following, [0.3, 0.0], 0.015, 2.0)
    feed_to(following, 0.25)
    before = following.path.points.copy()
    drive(following, [0.0, 0.3], 0.0, 1.5)
    after = following.path.points
    behind = int((following.q[FEED] - 0.1) / SPACING_M)
    np.testing.assert_array_equal(after[:behind], before[:behind])
    assert np.linalg.norm(after[behind + 95] - before[behind + 95]) > 0.005
    np.testing.assert_allclose(after[behind + 1], before[behind + 1], atol=1e-5)
    gaps = np.linalg.norm(np.diff(after, axis=0), axis=1)
    np.testing.assert_allclose(gaps, SPACING_M, rtol=0.1)


def test_steering_after_retracting_forgets_what_lay_ahead(cobra_following):
    following = start(cobra_following, 0.10)
    drive(following, [0.3, 0.0], 0.015, 2.0)
    feed_to(following, 0.25)
    feed_to(following, 0.18)
    assert following.path.length_m == pytest.approx(0.25, abs=0.002)
    drive(following, [-0.3, 0.0], 0.0, 0.5)
    assert following.path.length_m == pytest.approx(0.18, abs=0.002)


def test_steps_that_later_limits_shorten_leave_the_body_on_its_path(cobra_following):
    following = start(cobra_following, 0.12)
    for tick in range(600):
        q, _ = following.propose(np.array([0.2, 0.1 * np.sin(tick / 50)]), 0.015, DT)
        taken = following.q + (0.4 if tick % 3 else 1.0) * (q - following.q)
        following.take(taken, (taken - following.q) / DT)
    assert following.path.length_m == pytest.approx(following.q[FEED], abs=SPACING_M)
    assert following.deviation_max_m < 0.015 * 0.3


def test_letting_go_stops_within_the_ramp(cobra_following):
    following = start(cobra_following, 0.15)
    drive(following, [0.3, 0.2], 0.03, 2.0)
    drive(following, STILL, 0.0, 0.5)
    standing = following.q.copy()
    drive(following, STILL, 0.0, 0.2)
    np.testing.assert_allclose(following.q, standing, atol=1e-9)


def test_taking_over_a_bent_robot_moves_nothing(cobra_following):
    q = cobra_following.configuration.rest()
    q[FEED], q[2:] = 0.27, [0.4, 0.2, -0.5, 0.1, 0.3, 0.3]
    cobra_following.reset(q)
    drive(cobra_following, STILL, 0.0, 0.1)
    np.testing.assert_array_equal(cobra_following.q, q)
    assert cobra_following.deviation_m < 1e-5


def test_it_tells_how_much_of_the_passive_body_is_outside(cobra_following):
    following = start(cobra_following, 0.30)
    assert following.beyond_m == 0.0
    drive(following, STILL, 0.02, 2.0)
    assert following.beyond_m == pytest.approx(following.q[FEED] - 0.30)


def test_a_robot_fed_by_hand_follows_the_length_it_is_told(robots):
    following = TipFollowing(robots["by-hand"])
    start(following, 0.15)
    drive(following, [0.4, 0.0], 0.0, 1.5)
    for feed in np.arange(0.15, 0.28, 0.0002):
        following.take(*following.propose(STILL, 0.03, DT, hand_fed_m=feed))
    assert following.q[FEED] == pytest.approx(0.28, abs=3e-4)
    assert following.deviation_max_m < 0.03 * 0.3


def test_a_robot_without_tendons_is_refused(robots):
    with pytest.raises(ValueError, match="needs a section with tendons"):
        TipFollowing(robots["twist-feed"])


stick = st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.sampled_from([-1.0, -0.3, 0.0, 0.5, 1.0]), st.integers(5, 80))


@settings(max_examples=10, deadline=None, phases=[Phase.explicit, Phase.reuse, Phase.generate])
@example([(-2e-221, 0.0, 0.0, 20), (0.44, 2e-16, 0.0, 54), (-0.97, 0.53, 0.5, 35)], 0.02)
@given(st.lists(stick, min_size=2, max_size=8), st.sampled_from([0.02, 0.12, 0.3]))
def test_limits_hold_at_every_tick_whatever_the_stick_does(cobra_following, history, feed_m):
    following = start(cobra_following, feed_m)
    layout, backbone = following.configuration, following._backbone
    for x, y, feed, ticks in history:
        for _ in range(ticks):
            q, velocity = following.propose(0.5 * np.array([x, y]), 0.03 * feed, DT)
            step = q - following.q
            assert np.all(np.isfinite(q))
            assert layout.low[FEED] <= q[FEED] <= layout.high[FEED]
            assert abs(velocity[FEED] - following.velocity[FEED]) <= layout.acceleration[FEED] * DT * (1 + 1e-9)
            for where, limit, before in zip(
                layout.bends, backbone.bend_limits(q), following.velocity[2:].reshape(3, 2), strict=True
            ):
                assert np.hypot(*q[where]) <= limit + 1e-12
                assert np.hypot(*step[where]) <= layout.rate[where.start] * DT * (1 + 1e-9)
                if np.hypot(*q[where]) < limit - 1e-9:  # else the port itself straightens what slides into it
                    change = np.hypot(*(velocity[where] - before))
                    assert change <= layout.acceleration[where.start] * DT * (1 + 1e-6)
            following.take(q, velocity)
    if following.beyond_m == 0.0:
        assert following.deviation_m < 0.06 * 0.3


def test_a_path_along_a_robot_is_its_body(cobra_following):
    backbone = cobra_following._backbone
    q = cobra_following.configuration.rest()
    q[FEED], q[2:] = 0.4, [0.4, 0.2, -0.5, 0.1, 0.3, 0.3]
    path = TipPath.along(backbone, q)
    np.testing.assert_array_equal(path.points[0], 0.0)
    np.testing.assert_allclose(path.points[50], [0, 0, 0.05], atol=1e-15)
    np.testing.assert_allclose(path.points[350], backbone.poses_at(q, np.array([0.25])).positions[0], atol=1e-12)
    assert path.extended(0.5).length_m == pytest.approx(0.5, abs=SPACING_M)
