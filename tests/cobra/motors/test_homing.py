"""Claims about homing, on the simulated drives and the physics twin in step with a clock of the test's own."""

import numpy as np
import pytest

from cobra.simulation.drives import world_of
from tests.bench import CHANNEL, Bench


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_every_tendon_ends_at_its_pretension_and_the_robot_straight(seed):
    with Bench(seed) as bench:
        state = bench.home()
        assert (state.phase, state.homed) == ("ready", True)
        truth = world_of(CHANNEL).truth()
        wanted = bench.description.tendon.pretension_N
        assert truth.tensions == pytest.approx(wanted, rel=0.1)
        assert np.degrees(np.linalg.norm(truth.bends, axis=1)) == pytest.approx(0.0, abs=3.0)
        assert state.measured == pytest.approx(tuple(bench.loop.motion.configuration.rest()), abs=0.01)


def test_a_tendon_off_its_spool_is_named():
    with Bench(0) as bench:
        world = world_of(CHANNEL)
        cut = bench.description.tendon_names.index("N2")
        advance = world.plant.advance

        def with_a_cut_tendon(travel, duration_s):
            travel = travel.copy()
            travel[cut] = 0.05
            return advance(travel, duration_s)

        world.plant.advance = with_a_cut_tendon
        state = bench.home()
        assert state.phase == "holding"
        assert "N2" in state.cause
        assert "broken or off its spool" in state.cause
