"""Spools that are not round, and play between a drive and what it moves."""

import numpy as np
import pytest
from msgspec.structs import replace

from cobra.clock import ManualClock
from cobra.loading import load_description
from cobra.motors.open_bus import open_bus
from cobra.simulation.drives import world_of
from cobra.simulation.lost_motion import LostMotion

COBRA = load_description("cobra")
assert COBRA.tendon
PLAY_M = np.radians(0.8) * 0.010
PLAIN = replace(COBRA, drives=tuple(replace(d, spool_runout_m=0.0, winds_over=False) for d in COBRA.drives))


def lost_motion(description=COBRA) -> LostMotion:
    return LostMotion(description, np.random.default_rng(0))


def test_on_a_reversal_the_tendon_stays_until_the_play_is_crossed() -> None:
    spools = lost_motion(PLAIN)
    paid_out = spools.travel(np.full(14, 1.0))[0]
    assert spools.travel(np.full(14, 1.0 - 0.9 * np.radians(0.8)))[0] == paid_out
    moved = spools.travel(np.full(14, 0.5))[0]
    assert paid_out - moved == pytest.approx(0.5 * 0.010 - PLAY_M)


def test_wiggling_within_the_play_moves_nothing() -> None:
    spools = lost_motion(PLAIN)
    places = {tuple(spools.travel(np.full(14, x))) for x in 0.49 * np.radians(0.8) * np.sin(np.arange(50))}
    assert len(places) == 1


def test_a_spool_that_winds_over_itself_grows_by_a_tendons_diameter_a_turn() -> None:
    layered = replace(PLAIN, drives=tuple(replace(d, winds_over=d.moves == "tendon") for d in COBRA.drives))
    no_play = replace(layered, motors=(replace(COBRA.motors[0], backlash_deg=0.0),))
    spools = lost_motion(no_play)
    assert -spools.lever(np.full(14, 0.0))[0] + spools.lever(np.full(14, -2 * np.pi))[0] == pytest.approx(0.00036)
    # One turn wound in, by adding up small pieces of circle.
    angles = np.linspace(0.0, -2 * np.pi, 2001)
    middles = (angles[:-1] + angles[1:]) / 2
    circles = sum((0.010 - 0.00036 * a / (2 * np.pi)) * (-2 * np.pi / 2000) for a in middles)
    assert spools.travel(np.full(14, -2 * np.pi))[0] == pytest.approx(circles, rel=1e-9)


def test_the_lever_is_how_fast_the_tendon_runs() -> None:
    spools = lost_motion(replace(COBRA, motors=(replace(COBRA.motors[0], backlash_deg=0.0),)))
    for angle in np.linspace(-5.0, 3.0, 9):
        step = 1e-5
        rate = (spools.travel(np.full(14, angle + step)) - spools.travel(np.full(14, angle - step)).copy()) / (2 * step)
        np.testing.assert_allclose(spools.lever(np.full(14, angle)), rate, rtol=1e-6)


def test_an_eccentric_spool_errs_once_a_turn_by_at_most_its_runout_each_way() -> None:
    eccentric = replace(
        PLAIN,
        motors=(replace(COBRA.motors[0], backlash_deg=0.0),),
        drives=tuple(replace(d, spool_runout_m=0.0002 if d.moves == "tendon" else 0.0) for d in PLAIN.drives),
    )
    spools = lost_motion(eccentric)
    turn = np.linspace(0.0, 2 * np.pi, 100)
    error = np.array([spools.travel(np.full(14, a))[0] - 0.010 * a for a in turn])
    assert np.ptp(error) == pytest.approx(0.0004, rel=0.01)
    assert error[-1] == pytest.approx(0.0, abs=1e-9)


def opened(**options):
    bus = replace(COBRA.buses[0], options={"stepping": "inline", **options})
    return open_bus(replace(COBRA, buses=(bus,)), ManualClock())


def test_the_drivers_of_a_seeded_robot_know_the_description_and_the_world_is_another() -> None:
    with opened(losses="seeded", seed=5):
        world = world_of("cobra")
        assert world.description.tendon == COBRA.tendon
        true = world.plant.description  # type: ignore[union-attr]
        assert true.tendon != COBRA.tendon
        assert true.sections[0].routing != COBRA.sections[0].routing
        assert [s.name for s in true.sections] == [s.name for s in COBRA.sections]


@pytest.mark.parametrize("twin", ["ideal", "none"])
def test_the_ideal_twin_and_none_have_no_losses(twin: str) -> None:
    with opened(twin=twin, losses="seeded", seed=5):
        lever = world_of("cobra")._lost_motion.lever(np.full(14, -6.0))
        np.testing.assert_allclose(lever, [d.travel_per_rad for d in COBRA.drives])


def test_losses_that_are_none_are_refused_in_words() -> None:
    with pytest.raises(Exception, match=r"losses = 'some'.*seeded, nominal, off"), opened(losses="some"):
        pass
