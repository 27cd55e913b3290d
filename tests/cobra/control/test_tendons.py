"""Claims about tendons with losses on the twin: what is known of them, what is taken out, and which fault is whose."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from msgspec.structs import replace as replace_part

from cobra.control.tension import CREEP_M_S
from cobra.description import Compensation, RobotDescription
from cobra.loading import load_description
from cobra.mechanics.losses import Identified
from cobra.messages import Intent, Request
from cobra.simulation.drives import world_of
from tests.bench import CHANNEL, Bench
from tests.swept import swept


@contextmanager
def homed(
    seed: int, knows: Callable[[int, Bench], Identified] | None = None, description: RobotDescription | None = None
) -> Iterator[Bench]:
    """A robot whose losses are up to 30 % from what its description says, homed and ready to be driven."""
    with Bench(seed=seed, losses="seeded", description=description) as bench:
        if knows:
            bench.loop.tendons.use(knows(seed, bench))
        assert bench.home().phase == "ready"
        settle(bench)
        yield bench


def settle(bench: Bench) -> None:
    for _ in range(5):
        bench.tick()


def drive(bench: Bench, seconds: float, **intent) -> None:
    for _ in range(round(seconds / bench.loop.period_s)):
        bench.tick(Intent(**intent))


def test_a_healthy_rubbing_robot_is_homed_straight_bends_as_wanted_and_raises_no_alarm():
    with homed(seed=3) as bench:
        bends = np.degrees(np.linalg.norm(world_of(CHANNEL).truth().bends, axis=1))
        assert bends == pytest.approx(0.0, abs=2.5)
        for sign in (1.0, -1.0):
            drive(bench, 1.5, primary=(sign, 0.0))
            wanted = bench.states[-1].commanded[2]
            assert world_of(CHANNEL).truth().bends[0, 0] == pytest.approx(wanted, abs=np.radians(6.0))
        drive(bench, 0.3)
        told = bench.states[-1].tendons.tension
        assert world_of(CHANNEL).truth().tensions == pytest.approx(told, abs=0.8)

        for direction in ((1.0, 0.0), (-1.0, 0.5), (0.0, -1.0)):
            drive(bench, 1.0, primary=direction, section=1)
        assert bench.states[-1].tendons.warnings == ()

        # Switching compensation moves nothing, and is said.
        for _ in range(60):
            bench.tick()
        before = np.array(bench.states[-1].drives.travel)
        assert bench.ask(Request(what="compensation", lease=bench.lease, value=0.0)).ok
        for _ in range(20):
            state = bench.tick()
        assert state.tendons.compensation == "off"
        assert np.array(state.drives.travel) == pytest.approx(before, abs=3e-5)


BENDING = {"primary": (0.7, 0.7), "section": 1}


@pytest.mark.parametrize(("seed", "last"), [(1, ("broken", "S3", False)), (2, ("broken", "N2", True))])
def test_faulty_tendons_are_named_within_half_a_second_and_hold_the_robot(seed, last):
    """One after the other on one robot. At rest a drive's gear may hide what its tendon has lost, until it is driven."""
    with homed(seed) as bench:
        faults = bench.loop.tendons

        def ticks_until_named(intent: Intent | None) -> int:
            for ticks in range(1, 51):
                bench.tick(intent)
                if faults.faults != known:
                    return ticks
            return 0

        for fault, name, while_driving in (
            ("slipped", "W1", True),
            ("slipped", "E2", True),
            last,
        ):
            drive(bench, 0.5, **BENDING)
            assert bench.states[-1].phase == "driving", bench.states[-1].cause
            for _ in range(0 if while_driving else 30):
                bench.tick()
            known, plant = faults.faults, world_of(CHANNEL).plant
            plant.break_tendon(name) if fault == "broken" else plant.slip(name, 0.003)
            ticks = 0 if while_driving else ticks_until_named(None)
            when = "at rest" if ticks else "driving"
            ticks = ticks or ticks_until_named(Intent(**BENDING))
            print(f"{name} {fault}, {when}: named after {ticks * bench.loop.period_s:.2f} s")
            (named,) = faults.faults[len(known) :]
            assert name in named
            assert fault in named
            assert any(named in event.text for event in bench.events)
            if when == "driving":
                assert bench.tick(Intent(**BENDING)).phase == "holding"
            settle(bench)


def test_a_jammed_tendon_is_named_within_a_second_of_driving_along_it():
    with homed(2, knows=swept) as bench:
        x, y = float(np.cos(np.pi / 6)), float(np.sin(np.pi / 6))
        drive(bench, 0.5, primary=(x, y), section=2)
        assert bench.loop.tendons.faults == (), "healthy tendons are not blamed"
        world_of(CHANNEL).plant.jam("E2")
        ticks = 0
        while not bench.loop.tendons.faults and ticks < 200:
            bench.tick(Intent(primary=(x, y), section=1))
            ticks += 1
        print(f"jam, driving: named after {ticks * bench.loop.period_s:.2f} s")
        assert bench.loop.tendons.faults == ("tendon E2 is jammed: it does not follow its drive",)
        assert ticks * bench.loop.period_s <= 1.0


def test_the_bends_are_known_as_well_as_is_said():
    """Of a robot whose losses are up to 30 % from what is described, by the twin's truth."""
    errors, sigmas = [], []
    with homed(seed=1) as bench:
        for k in range(600):
            turn = 2.4 * (k // 80)
            bench.tick(Intent(primary=(float(np.cos(turn)), float(np.sin(turn))), section=k // 160 % 3))
            estimate = bench.loop.tendons.estimate
            errors.append(estimate.bends - world_of(CHANNEL).truth().bends.ravel())
            sigmas.append(estimate.deviation)
    z = np.array(errors) / np.array(sigmas)
    print(
        f"RMS error {np.degrees(np.sqrt(np.mean(np.square(errors)))):.1f} degrees, in standard deviations {np.sqrt(np.mean(z**2)):.2f}"
    )
    assert np.mean(np.abs(z) < 2.0) > 0.9
    assert np.sqrt(np.mean(z**2)) > 0.15, "nor is it said to be known worse than it is by far"


def test_slack_is_told_at_once_and_taken_up_slowly_and_an_encoder_that_slips_is_told_by_its_drive():
    with homed(seed=3) as bench:
        drive(bench, 0.3, **BENDING)
        bench.loop.tendons._health.observe = lambda *_: None  # the keeper alone, not who would call it a fault
        plant = world_of(CHANNEL).plant
        plant.slip("E2", 0.01)
        ticks = 0
        while not any("E2 is slack" in warning for warning in bench.states[-1].tendons.warnings) and ticks < 50:
            bench.tick(Intent(**BENDING))
            ticks += 1
        print(f"slack, driving: named after {ticks * bench.loop.period_s:.2f} s")
        assert ticks < 50
        before = np.array(bench.states[-1].drives.setpoint)
        state = bench.tick(Intent(**BENDING))
        wound = before - np.array(state.drives.setpoint)
        assert 0.0 < wound[bench.description.tendon_drives[5]] <= 1.01 * CREEP_M_S * bench.loop.period_s
        for _ in range(200):
            bench.tick()
        assert plant.truth().tensions[5] > bench.description.tendon.min_tension_N
        assert bench.states[-1].tendons.warnings == ()

        drive(bench, 0.3, **BENDING)
        world_of(CHANNEL).drives[bench.description.tendon_drives[5]].slip(-15.0)
        ticks, state = 0, bench.states[-1]
        while state.phase == "driving" and ticks < 5:
            state = bench.tick(Intent(**BENDING))
            ticks += 1
        print(f"encoder, driving: named after {ticks * bench.loop.period_s:.2f} s")
        assert state.phase == "fault"
        assert "drive E2: its angle jumped by -15." in state.cause
        assert not state.homed


def pushed_tip(admittance: float) -> tuple[float, float]:
    """Commanded bends of all sections together [rad], and how far the tip stands aside [m], after a push to the right."""
    wanted = Compensation(admittance_rad_s_Nm=admittance)
    with homed(seed=3, description=replace_part(load_description("cobra"), compensation=wanted)) as bench:
        drive(bench, 0.3, primary=(0.1, 0.0))
        world_of(CHANNEL).plant.push(-1, np.array([0.3, 0.0, 0.0]))
        drive(bench, 2.0)
        truth = world_of(CHANNEL).truth()
        assert truth.tensions.min() > bench.description.tendon.min_tension_N
        return float(np.sum(bench.states[-1].commanded[2::2])), float(truth.tip_position[0])


def test_with_admittance_the_robot_gives_way_when_pushed_and_without_it_holds():
    (stiff, stood), (soft, moved) = pushed_tip(0.0), pushed_tip(60.0)
    assert abs(stiff) < np.radians(5.0)
    assert soft > stiff + np.radians(10.0)
    assert moved > stood + 0.01
