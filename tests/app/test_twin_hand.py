"""Claims about the hand that feeds a simulated robot: the twin is where the page says that the robot is."""

import math

import numpy as np
import pytest

from app.twin_hand import TwinHand
from cobra.kinematics.backbone import Backbone
from cobra.kinematics.configuration import FEED
from cobra.loading import load_description
from cobra.messages import Intent, Request
from cobra.simulation.drives import world_of
from cobra.simulation.environments import environment
from cobra.simulation.twin import HAND_SPEED_M_S, build_twin
from tests.bench import Bench

ACTIVE = load_description("cobra-active")


def test_what_is_told_is_fed_on_the_twin_while_the_robot_takes_it_in():
    """Bent, then fed back by 60 mm by hand: the port takes 60 mm of the bend, on the twin as in the kinematics."""
    backbone = Backbone(ACTIVE)
    with Bench(seed=1, twin="ideal", robot="cobra-active") as bench:
        world = world_of("cobra-active#main")
        hand = TwinHand(world.plant, ACTIVE)

        def tick(intent=None):
            state = bench.tick(intent)
            hand.state(state)
            return state

        def off_m(state):
            return float(np.linalg.norm(world.truth().tip_position - backbone.tip(np.array(state.measured))[:3, 3]))

        assert bench.home().phase == "ready"
        for _ in range(300):
            tick(Intent(primary=(1.0, 0.0), section=0))
        for _ in range(50):
            state = tick()
        bent, off_bent = world.truth().tip_position, off_m(state)
        assert bench.ask(Request(what="hand_feed", value=0.24, lease=bench.lease)).ok
        for _ in range(100):
            tick()
        np.testing.assert_allclose(world.truth().tip_position, bent, atol=1e-4)
        for _ in range(300):
            tick(Intent())
        for _ in range(50):
            state = tick()
    print(f"twin off the kinematics by {1e3 * off_bent:.1f} mm bent, {1e3 * off_m(state):.1f} mm fed back")
    assert state.measured[FEED] == pytest.approx(0.24, abs=1e-6)
    assert np.linalg.norm(world.truth().tip_position - bent) > 0.05
    assert off_m(state) < off_bent + 0.005
    assert math.hypot(*world.truth().bends[0]) == pytest.approx(math.hypot(*state.measured[2:4]), abs=0.05)


def test_a_hand_needs_its_time_and_never_pulls_it_out_of_the_port():
    twin = build_twin(ACTIVE, "ideal")
    travel = np.zeros(len(ACTIVE.drives))
    twin.advance(travel, 0.0)
    start = twin.truth().tip_position[2]
    twin.feed_by_hand(-1.0)
    twin.advance(travel, 1.0)
    assert start - twin.truth().tip_position[2] == pytest.approx(HAND_SPEED_M_S, abs=0.002)
    for _ in range(7):
        twin.advance(travel, 1.0)
    assert twin.truth().tip_position[2] == pytest.approx(0.0, abs=0.002)


def test_among_walls_it_is_fed_as_far_as_there_is_a_body():
    twin = build_twin(ACTIVE, "default", environment=environment("straight-pipe", ACTIVE))
    travel = np.zeros(len(ACTIVE.drives))
    twin.advance(travel, 0.0)
    twin.feed_by_hand(0.4)
    for _ in range(5):
        twin.advance(travel, 0.5)
    truth = twin.truth()
    assert truth.tip_position[2] == pytest.approx(0.4, abs=0.003)
    assert truth.passive[-1, 2] == pytest.approx(0.1, abs=0.003)
    assert twin.chain.longest_m == pytest.approx(0.9)


def test_a_robot_that_nobody_feeds_is_not_fed():
    with pytest.raises(ValueError, match="src-bot is not fed by hand"):
        build_twin(load_description("src-bot"), "ideal").feed_by_hand(0.1)
