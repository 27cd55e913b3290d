import numpy as np

from cobra.kinematics.configuration import FEED, TWIST, Configuration


def test_cobra_has_eight_degrees_of_freedom_in_the_order_of_the_brief(cobra):
    layout = Configuration(cobra)
    assert layout.size == 8
    assert layout.names == ("twist", "feed", "base x", "base y", "middle x", "middle y", "tip x", "tip y")
    assert layout.units == ("rad", "m", *["rad"] * 6)
    assert (TWIST, FEED) == (0, 1)
    assert layout.bends == (slice(2, 4), slice(4, 6), slice(6, 8))
    assert layout.actuated == tuple(range(8))


def test_cobra_starts_straight_with_its_active_segment_outside(cobra):
    np.testing.assert_array_equal(Configuration(cobra).rest(), [0, 0.30, 0, 0, 0, 0, 0, 0])


def test_an_elongating_section_brings_its_length_after_its_bend(robots):
    layout = Configuration(robots["elongating"])
    assert layout.lengths == (4, None, 9)
    assert layout.names[2:5] == ("base x", "base y", "base length")
    assert layout.units[4] == layout.units[9] == "m"
    rest = layout.rest()
    assert (rest[4], rest[9], rest[FEED]) == (0.1, 0.1, 0.1 + 0.06 + 0.1)


def test_what_no_drive_moves_has_no_rate(robots):
    by_hand = Configuration(robots["by-hand"])
    assert by_hand.actuated == tuple(range(2, 8))
    assert by_hand.low[TWIST] == by_hand.high[TWIST] == 0.0
    passive = Configuration(robots["passive-between"])
    assert passive.actuated == (0, 1, 2, 3, 6, 7)


def test_limits_hold_the_rest_configuration_and_cannot_be_changed(robot):
    layout = Configuration(robot)
    rest = layout.rest()
    assert np.all(layout.low <= rest)
    assert np.all(rest <= layout.high)
    assert np.all((layout.rate > 0) == (layout.acceleration > 0))
    assert not layout.low.flags.writeable


def test_section_lengths_follow_q_where_they_can(robots):
    layout = Configuration(robots["elongating"])
    q = np.stack([layout.rest(), layout.rest()])
    q[1, 4] = 0.09
    np.testing.assert_allclose(layout.section_lengths(q), [[0.1, 0.06, 0.1], [0.09, 0.06, 0.1]])
