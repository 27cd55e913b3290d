"""Claims about section mode: rates, accelerations and limits hold at every tick, whatever the sticks do."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cobra.control.modes.section import SectionMode
from cobra.kinematics.backbone import Backbone
from cobra.kinematics.configuration import FEED, TWIST, Configuration
from cobra.loading import load_description
from cobra.messages import Intent

DT = 0.01
COBRA = load_description("cobra")
LAYOUT = Configuration(COBRA)
RATE = math.radians(COBRA.teleop.bend_rate_deg_s)
ACCELERATION = math.radians(COBRA.teleop.bend_acceleration_deg_s2)


def run(motion: SectionMode, intent: Intent | None, seconds: float) -> None:
    for _ in range(round(seconds / DT)):
        motion.take(*motion.propose(intent, DT))


def test_a_full_stick_reaches_the_described_rate():
    motion = SectionMode(COBRA)
    run(motion, Intent(primary=(1.0, 0.0), section=1), 1.0)
    start = motion.q.copy()
    run(motion, Intent(primary=(1.0, 0.0), section=1), 0.5)
    moved = motion.q - start
    assert moved[LAYOUT.bends[1]] == pytest.approx([0.5 * RATE, 0.0])
    assert np.count_nonzero(moved) == 1


def test_letting_go_ramps_down_with_the_described_deceleration_and_stays():
    motion = SectionMode(COBRA)
    run(motion, Intent(primary=(0.0, -1.0), section=0), 1.0)
    steps = 0
    while np.any(motion.velocity):
        motion.take(*motion.propose(None, DT))
        steps += 1
    assert steps * DT == pytest.approx(RATE / ACCELERATION, abs=DT)
    stood = motion.q.copy()
    run(motion, None, 0.2)
    assert np.array_equal(motion.q, stood)


def test_both_sticks_on_the_tip_section_do_not_add_up_beyond_the_rate():
    motion = SectionMode(COBRA)
    run(motion, Intent(primary=(1.0, 0.0), secondary=(1.0, 0.0), section=2), 0.6)
    assert np.linalg.norm(motion.velocity[LAYOUT.bends[2]]) <= RATE + 1e-12


def test_retracting_unbends_what_enters_the_port():
    motion = SectionMode(COBRA)
    run(motion, Intent(primary=(1.0, 0.0), section=0), 4.0)
    assert motion.q[LAYOUT.bends[0]][0] == pytest.approx(COBRA.sections[0].max_bend_rad)
    run(motion, Intent(feed=-1.0), 20.0)
    assert motion.q[FEED] == pytest.approx(0.0, abs=1e-9)
    assert motion.q[2:] == pytest.approx(0.0, abs=1e-9)


def test_a_bend_that_vanishes_into_the_port_slows_its_turning_in_time():
    """The stick pushes around the edge of a limit that shrinks to nothing: the bend would have to turn ever faster."""
    motion, backbone, bend = SectionMode(COBRA), Backbone(COBRA), LAYOUT.bends[2]
    start = motion.q.copy()
    start[FEED], start[bend] = 0.03, (0.45, 0.0)
    motion.reset(start)
    worst = 0.0
    while motion.q[FEED] > 0.001:
        before, (x, y) = motion.velocity.copy(), motion.q[bend]
        around = np.array([-y, x]) / max(np.hypot(x, y), 1e-9)
        motion.take(*motion.propose(Intent(secondary=tuple(around.tolist()), feed=-1.0), DT))
        if backbone.bend_limits(motion.q)[2] < 0.2:
            worst = max(
                worst, float(np.hypot(*(motion.velocity - before)[bend])) / (LAYOUT.acceleration[bend.start] * DT)
            )
    assert worst < 1.5


stick = st.tuples(st.floats(-1, 1), st.floats(-1, 1))
intents = st.builds(
    Intent,
    primary=stick,
    secondary=stick,
    feed=st.floats(-1, 1),
    twist=st.floats(-1, 1),
    section=st.integers(0, 2),
    speed=st.sampled_from([0.25, 1.0]),
)


@settings(max_examples=100, deadline=None)
@given(st.lists(st.tuples(st.one_of(st.none(), intents), st.integers(1, 80)), max_size=12), st.floats(0.0, 1.0))
def test_limits_rates_and_accelerations_hold_at_every_tick(history, feed):
    motion = SectionMode(COBRA)
    start = motion.q.copy()
    start[FEED] = feed
    motion.reset(start)
    backbone, layout = Backbone(COBRA), LAYOUT
    for intent, ticks in history:
        for _ in range(ticks):
            before, velocity = motion.q.copy(), motion.velocity.copy()
            motion.take(*motion.propose(intent, DT))
            step = (motion.q - before) / DT
            limits = backbone.bend_limits(motion.q)
            assert layout.low[TWIST] <= motion.q[TWIST] <= layout.high[TWIST]
            assert layout.low[FEED] <= motion.q[FEED] <= layout.high[FEED]
            for where, limit in zip(layout.bends, limits, strict=True):
                assert np.hypot(*motion.q[where]) <= limit + 1e-9
                assert np.hypot(*step[where]) <= RATE * (1 + 1e-6)
            assert abs(step[TWIST]) <= layout.rate[TWIST] * (1 + 1e-9)
            assert abs(step[FEED]) <= layout.rate[FEED] * (1 + 1e-9)
            assert abs(step[TWIST] - velocity[TWIST]) <= layout.acceleration[TWIST] * DT * (1 + 1e-6)
            assert abs(step[FEED] - velocity[FEED]) <= layout.acceleration[FEED] * DT * (1 + 1e-6)
