"""Claims about SRC-Bot on its equations of motion as the plant: what it bears, what pushes it, and the loop on top of it."""

import numpy as np
import pytest

from cobra.errors import OperatorError
from cobra.kinematics.backbone import Backbone
from cobra.loading import load_description
from cobra.mechanics.chain import guider_frames
from cobra.mechanics.described import is_chain, parameters_of
from cobra.mechanics.inverse import equilibrium
from cobra.messages import Intent
from cobra.simulation.chain_plant import ChainPlant
from cobra.simulation.drives import world_of
from cobra.simulation.options import Simulation, SimulationError
from cobra.simulation.twin import build_twin
from tests.bench import Bench

SRC_BOT = load_description("src-bot")
SHORT, BENT = np.full(3, -0.03), -0.025 - 0.03 * 0.6 * np.cos(np.radians([0.0, 120.0, 240.0]))


def settled(plant, travel, seconds=3.0):
    plant.advance(np.zeros(3), 0.0)
    plant.advance(travel, 1.0)
    return plant.advance(travel, seconds)


def test_the_preset_has_the_numbers_of_the_paper_and_of_the_models_assumptions():
    p = parameters_of(SRC_BOT)
    assert (p.segments, p.bending_stiffness_Nm2, p.torsional_stiffness_Nm2, p.axial_stiffness_N_m) == (
        5, 0.1006, 0.2106, 5136.0,
    )  # fmt: skip
    assert p.guider_mass_kg == pytest.approx(0.08)
    assert p.cable_stiffness_N_m == pytest.approx(3e4)
    assert p.rest_length_m == pytest.approx(0.05)


def test_only_robots_with_equations_of_motion_have_this_plant():
    assert is_chain(SRC_BOT)
    with pytest.raises(OperatorError, match="cobra: has no equations of motion"):
        parameters_of(load_description("cobra"))
    with pytest.raises(SimulationError, match="dynamics"):
        Simulation(twin="dynamics").true(load_description("cobra"))
    with pytest.raises(SimulationError, match="no walls"):
        Simulation(twin="dynamics", world="straight-pipe")


def test_it_comes_to_rest_where_the_statics_have_their_balance():
    plant = ChainPlant(SRC_BOT)
    settled(plant, BENT)
    top = plant.truth().tension_profile[:, -1]
    q = equilibrium(plant.parameters, top, guess=plant.chain.q)
    assert plant.truth().vertebrae == pytest.approx(guider_frames(q)[1:, :3, 3], abs=3e-4)


@pytest.mark.parametrize("travel", [SHORT, BENT])
def test_it_and_the_mujoco_twin_agree_on_shape_and_tension(travel):
    plant, twin = ChainPlant(SRC_BOT), build_twin(SRC_BOT, "default")
    loads, others = settled(plant, travel), settled(twin, travel)
    apart = np.linalg.norm(plant.truth().vertebrae - twin.truth().vertebrae, axis=1)
    assert apart.max() < 0.02 * 0.25
    assert loads == pytest.approx(others, abs=2.0)


def test_a_push_on_a_guider_moves_it_while_no_drive_moves_and_ends_with_it():
    plant = ChainPlant(SRC_BOT)
    settled(plant, SHORT)
    before = plant.truth().vertebrae
    plant.push(2, np.array([4.0, 0.0, 0.0]))
    plant.advance(SHORT, 2.0)
    moved = plant.truth().vertebrae - before
    assert moved[2, 0] > 0.002
    plant.push(2, np.zeros(3))
    plant.advance(SHORT, 3.0)
    # The cables' friction keeps a little of it.
    assert plant.truth().vertebrae == pytest.approx(before, abs=1e-3)


def test_what_no_chamber_could_bear_is_survived_and_counted():
    plant = ChainPlant(SRC_BOT)
    settled(plant, SHORT)
    plant.push(4, np.array([1e5, 0.0, 0.0]))
    plant.advance(SHORT, 0.5)
    assert plant.recoveries > 0
    plant.push(4, np.zeros(3))
    plant.advance(SHORT, 3.0)
    assert np.isfinite(plant.truth().vertebrae).all()
    assert plant.truth().tip_position[2] > 0.15


def test_the_loop_homes_and_drives_it_through_the_same_frames_as_the_other_twin():
    with Bench(0, "dynamics", "src-bot") as bench:
        state = bench.home()
        assert (state.phase, state.homed) == ("ready", True)
        for _ in range(20):
            bench.tick()
        for _ in range(120):
            bench.tick(Intent(primary=(0.8, 0.6)))
        for _ in range(100):
            state = bench.tick()
        truth = world_of("src-bot").truth()
        q = np.array(state.commanded)
        assert np.hypot(*q[2:4]) > 0.4
        assert np.linalg.norm(truth.tip_position - Backbone(SRC_BOT).tip(q)[:3, 3]) < 0.03 * 0.25
        assert truth.bends[0] == pytest.approx(q[2:4], abs=0.06)
