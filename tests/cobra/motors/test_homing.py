"""Claims about homing, on the simulated drives and the physics twin in step with a clock of the test's own."""

import numpy as np
import pytest

from cobra.messages import Intent, Request
from cobra.motors.homing import Homing, HomingError
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


def test_it_ends_straight_from_a_strongly_bent_pose_too():
    """A body bent by 90 degrees pulls its tendons taut again while they are paid out."""
    with Bench(1, losses="seeded") as bench:
        bench.home()
        for _ in range(5):
            bench.tick()
        for _ in range(300):
            bench.tick(Intent(primary=(0.3, -0.95), secondary=(0.95, -0.3), section=1))
        assert np.degrees(np.linalg.norm(world_of(CHANNEL).truth().bends, axis=1))[1:].min() > 80.0
        for _ in range(20):
            bench.tick()
        assert bench.ask(Request(what="home", lease=bench.lease)).ok
        out_m = 0.0
        while bench.tick().phase == "homing":
            out_m = max(out_m, *bench.states[-1].drives.travel[:12])
        assert bench.states[-1].phase == "ready", bench.states[-1].cause
        assert out_m < 0.04, "no tendon comes off its spool"
        assert np.degrees(np.linalg.norm(world_of(CHANNEL).truth().bends, axis=1)) == pytest.approx(0.0, abs=3.0)


def test_a_drive_that_reads_tension_for_ever_pays_no_tendon_out_for_ever():
    with Bench(0) as bench:
        homing = Homing(bench.description, bench.loop.drivetrain.tendons.bending)
    n = len(bench.description.drives)
    travel, load, speed = np.zeros(n), np.zeros(n), np.zeros(n)
    hard = np.arange(n) == bench.description.tendon_drives[0]

    def home(travel, load, speed):
        for _ in range(2500):
            told = homing.step(travel, load, speed, 0.01)
            speed = (told - travel) / 0.01
            # Tension where they are wound in; S1 turns harder than it should.
            load, travel = np.where(told < 0.001, 4.0, 0.0) + hard, told

    with pytest.raises(HomingError, match="tendon S1 was paid out by 40 mm and still reads tension"):
        home(travel, load, speed)
