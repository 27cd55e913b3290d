"""Claims about homing a robot again that is fed in and twisted: the tendons find their zero, twist and feed keep theirs."""

import numpy as np
import pytest

from cobra.kinematics.configuration import FEED, TWIST
from cobra.messages import Intent, Request
from cobra.simulation.drives import world_of
from tests.bench import CHANNEL, Bench


def base(bench: Bench) -> tuple[float, float]:
    """The twin's twist [rad] and feed [m]."""
    plant = world_of(CHANNEL).plant
    data = plant.data
    return tuple(float(data.joint(name).qpos[0]) for name in ("twist", "feed"))


def test_a_robot_fed_in_and_twisted_is_there_after_homing_again():
    with Bench(seed=1) as bench:
        assert bench.home().phase == "ready"
        for _ in range(5):
            bench.tick()
        for _ in range(400):
            bench.tick(Intent(primary=(0.5, -0.3), feed=-1.0, twist=0.7, speed=1.0))
        for _ in range(60):
            bench.tick()
        before, true_before = np.array(bench.states[-1].measured), base(bench)
        assert before[FEED] < 0.25
        assert before[TWIST] > 0.5
        assert (before[TWIST], before[FEED]) == pytest.approx(true_before, abs=1e-3)
        assert bench.ask(Request(what="home", lease=bench.lease)).ok
        for _ in range(3000):
            if bench.tick().phase != "homing":
                break
        state = bench.states[-1]
        assert state.phase == "ready", state.cause
        for told in (state.measured, state.commanded):
            assert (told[TWIST], told[FEED]) == pytest.approx(base(bench), abs=1e-3)
        assert base(bench) == pytest.approx(true_before, abs=1e-3)
        assert np.degrees(np.linalg.norm(world_of(CHANNEL).truth().bends, axis=1)).max() < 2.0
