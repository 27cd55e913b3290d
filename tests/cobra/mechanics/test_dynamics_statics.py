"""Postures in balance against beam theory, the lever-arm erratum in numbers, and the inverse problems."""

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cobra.mechanics.chain import MOUNTINGS, SrcBotParameters, cable_forces, guider_frames
from cobra.mechanics.dynamics import Chain, simulate
from cobra.mechanics.inverse import BalanceError, equilibrium, forces_for_motion, inverse_dynamics, inverse_statics
from cobra.mechanics.kernels.articulated import accelerations
from cobra.mechanics.published import chain_coordinates, polar_coordinates
from cobra.mechanics.schedule import Cables, Load, Schedule
from tests.elastica import beam

WEIGHTLESS = SrcBotParameters(gravity_m_s2=MOUNTINGS["weightless"])
HANGING = SrcBotParameters()
SLACK = np.zeros(3)
STILL = np.zeros((5, 4))


def tilt(q):
    """Tilt of the top guider in the x-z plane [rad]."""
    x, _, z = guider_frames(q)[-1, :3, 2]
    return np.arctan2(x, z)


def force_at(guider, *force):
    loads = np.zeros((5, 3))
    loads[guider - 1] = force
    return loads


@pytest.mark.parametrize("mounting", ["hanging", "upright", "horizontal"])
@pytest.mark.parametrize(("guider", "force"), [(5, 2.0), (5, -5.0), (3, 6.0), (1, 0.0)])
def test_deflection_is_that_of_a_beam(mounting, guider, force):
    gravity = {"hanging": (0.0, 9.81), "upright": (0.0, -9.81), "horizontal": (9.81, 0.0)}[mounting]
    robot = msgspec.structs.replace(HANGING, gravity_m_s2=(gravity[0], 0.0, gravity[1]))
    forces = np.tile(gravity, (5, 1)) * robot.guider_mass_kg
    forces[guider - 1, 0] += force
    theirs = beam(robot, forces)
    q = equilibrium(robot, SLACK, force_at(guider, force, 0.0, 0.0))
    ours = guider_frames(q)[:, [0, 2], 3]
    assert np.abs(ours - theirs).max() < 0.02 * 0.25


def test_the_simulation_settles_in_the_posture_in_balance():
    robot = msgspec.structs.replace(HANGING, damping_bend_Nms=0.1, damping_axial_Ns_m=40.0, friction=0.0)
    motion = simulate(robot, 8.0, Cables.constant([9.0, 0.0, 4.0]), [Load(3, Schedule.constant([0.5, -0.7, 0.0]))])
    q = equilibrium(robot, np.array([9.0, 0.0, 4.0]), force_at(3, 0.5, -0.7, 0.0))
    assert motion.positions_m[-1] == pytest.approx(guider_frames(q)[:, :3, 3], abs=2e-6)


def test_the_printed_lever_arms_turn_the_tip_by_20_and_the_right_ones_by_12_and_a_half():
    """In units of F L²/EI; beam theory says (n L)² F / (2 EI), which is 12.5 for five chambers."""
    robot = msgspec.structs.replace(
        WEIGHTLESS, damping_bend_Nms=0.2, damping_axial_Ns_m=40.0, damping_twist_Nms=0.2, friction=0.0
    )
    force = 0.002
    unit = force * robot.rest_length_m**2 / robot.bending_stiffness_Nm2
    load = [Load(5, Schedule.constant([force, 0.0, 0.0]))]
    chain, published = (
        simulate(robot, 20.0, Cables.constant(SLACK), load, formulation=form, record_s=1.0)
        for form in ("chain", "published")
    )
    assert tilt(chain.q[-1]) / unit == pytest.approx(12.5, rel=1e-3)
    assert tilt(equilibrium(robot, SLACK, force_at(5, force, 0.0, 0.0))) / unit == pytest.approx(12.5, rel=1e-4)
    assert tilt(published.q[-1]) / unit == pytest.approx(20.0, rel=1e-3)


def test_cables_alone_bend_all_chambers_alike_in_both_forms():
    robot = msgspec.structs.replace(WEIGHTLESS, damping_bend_Nms=0.1, damping_axial_Ns_m=40.0, friction=0.0)
    for form, length_decides in (("chain", False), ("published", True)):
        motion = simulate(robot, 12.0, Cables.constant([5.0, 0.0, 0.0]), formulation=form, record_s=1.0)
        bends = motion.q[-1, :, 0]
        length = motion.q[-1, 0, 3] if length_decides else robot.rest_length_m
        assert bends == pytest.approx(np.full(5, 5.0 * 0.03 * length / robot.bending_stiffness_Nm2), rel=5e-3)


def test_weight_straightens_a_bent_robot_that_hangs_in_the_published_form_too():
    """Printed with absolute values, gravity could only bend it further."""
    heavy, light = (
        simulate(robot, 12.0, Cables.constant([6.0, 0.0, 0.0]), formulation="published", record_s=1.0).tilt_rad[
            -1, -1, 0
        ]
        for robot in (HANGING, WEIGHTLESS)
    )
    assert 0.3 * light < heavy < 0.95 * light


def test_the_published_form_bends_first_towards_the_cable_that_pulls():
    for cable, direction in ((0, 0.0), (1, 120.0), (2, 240.0)):
        motion = simulate(HANGING, 0.3, Cables.constant(10.0 * np.eye(3)[cable]), formulation="published")
        x, y = motion.positions_m[-1, -1, :2]
        assert np.degrees(np.arctan2(y, x)) % 360.0 == pytest.approx(direction, abs=1e-6)


@given(st.integers(0, 1000))
@settings(max_examples=25, deadline=None)
def test_printed_coordinates_describe_the_same_guiders(seed):
    rng = np.random.default_rng(seed)
    q = HANGING.rest + rng.normal(size=(5, 4)) * [0.4, 0.4, 0.2, 0.003]
    polar = polar_coordinates(q)
    there = guider_frames(chain_coordinates(polar))
    assert there[:, :3, 2:] == pytest.approx(guider_frames(q)[:, :3, 2:], abs=1e-12)
    assert (np.abs(polar[:, 1]) <= 0.5 * np.pi + 1e-12).all()


@pytest.mark.parametrize("length_m", [None, 0.213])
@pytest.mark.parametrize("bend_deg", [0.0, 20.0, 60.0])
@pytest.mark.parametrize("direction_deg", [0.0, 70.0, 180.0, 200.0])
def test_the_cable_forces_for_a_posture_give_that_posture(bend_deg, direction_deg, length_m):
    loads = force_at(3, 0.4, -0.3, 0.2)
    bend, direction = np.radians(bend_deg), np.radians(direction_deg)
    wanted = bend * np.array([np.cos(direction), np.sin(direction)])
    posture = inverse_statics(HANGING, wanted, length_m, loads)
    assert posture.reached
    assert posture.stable
    assert (posture.tensions_N >= 0.0).all()
    q = equilibrium(HANGING, posture.tensions_N, loads)
    assert q[:, :2].sum(axis=0) == pytest.approx(wanted, abs=1e-9)
    assert q == pytest.approx(posture.q, abs=1e-9)
    if length_m is None:
        assert posture.tensions_N.min() == 0.0
    else:
        assert q[:, 3].sum() == pytest.approx(length_m, abs=1e-11)


def test_friction_lets_a_band_of_motor_forces_hold_a_posture():
    posture = inverse_statics(HANGING, (0.8, 0.0), 0.23)
    low, high = posture.motor_N
    assert (low < posture.tensions_N).all()
    assert (posture.tensions_N < high).all()
    for motor in (1.02 * low, 0.98 * high):
        motion = simulate(HANGING, 1.0, Cables.constant(motor), start=Chain(HANGING, posture.q, posture.tensions_N))
        assert motion.q[-1] == pytest.approx(posture.q, abs=1e-8)
    motion = simulate(HANGING, 1.0, Cables.constant(1.1 * high), start=Chain(HANGING, posture.q, posture.tensions_N))
    assert np.abs(motion.q[-1] - posture.q).max() > 1e-3


def test_a_posture_that_takes_a_push_is_not_reached_and_said_so():
    posture = inverse_statics(HANGING, (0.5, 0.0), 0.26)
    assert not posture.reached
    assert posture.reasons == ("cable 2, 3 would have to push",)
    assert (posture.tensions_N[1:] == 0.0).all()
    assert posture.missed_bend_rad[0] > 0.1
    assert posture.q[:, 3].sum() < 0.26
    # It is what cables of those lengths do: none is longer, and only taut ones pull.
    q = equilibrium(HANGING, posture.tensions_N)
    assert q == pytest.approx(posture.q, abs=1e-8)


def test_a_posture_beyond_the_stops_is_said():
    posture = inverse_statics(HANGING, (0.0, 0.0), 0.19)
    assert len(posture.reasons) == 1
    assert "shorter than its stop allows" in posture.reasons[0]


def test_a_robot_that_buckles_has_no_stable_posture():
    soft = msgspec.structs.replace(HANGING, bending_stiffness_Nm2=0.01, gravity_m_s2=MOUNTINGS["upright"])
    assert not inverse_statics(soft, (0.0, 0.0)).stable
    with pytest.raises(BalanceError):
        equilibrium(HANGING, np.array([4000.0, 0.0, 0.0]))


def test_inverse_dynamics_finds_the_tensions_of_a_motion_and_what_no_cable_can_do():
    rng = np.random.default_rng(3)
    robot = msgspec.structs.replace(HANGING, friction=0.0)
    tensions = np.array([12.0, 5.0, 3.0])
    motion = simulate(robot, 0.4, Cables.constant(tensions), step_s=1e-5, record_s=0.1)
    a = accelerations(
        robot.constants, robot.cable_matrix, motion.q[2].copy(), motion.v[2].copy(), tensions, np.zeros((5, 3))
    )
    wanted, fit = inverse_dynamics(robot, motion.q[2], motion.v[2], a)
    assert wanted == pytest.approx(np.broadcast_to(cable_forces(robot, tensions), (5, 4)), abs=1e-8)
    assert fit.tensions_N == pytest.approx(tensions, abs=1e-7)
    assert np.abs(fit.residual).max() < 1e-8
    _, fit = inverse_dynamics(robot, motion.q[2], motion.v[2], a + rng.normal(size=(5, 4)))
    assert np.abs(fit.residual).max() > 1e-3
    assert (fit.tensions_N >= 0.0).all()


def test_the_cable_forces_for_a_motion_make_the_robot_follow_it():
    robot = msgspec.structs.replace(HANGING, friction=0.0)
    time = np.linspace(0.0, 3.0, 301)
    bend = np.stack([0.4 * np.sin(time) ** 2, -0.3 * (1.0 - np.cos(2.0 * time))], axis=1)
    length = 0.225 - 0.004 * np.sin(time) ** 2
    motion, missed = forces_for_motion(robot, time, bend, length, force_at(5, 0.2, 0.0, 0.0))
    print(np.abs(missed).max(axis=0), motion.tensions_N.min())
    assert np.abs(missed).max(axis=0) == pytest.approx([0.0, 0.0, 0.0], abs=2e-4)
    assert (motion.tensions_N > 0.0).all()
    replayed = simulate(
        robot,
        3.0,
        Cables.table(time, motion.tensions_N, linear=True),
        [Load(5, Schedule.constant([0.2, 0.0, 0.0]))],
        start=Chain(robot, motion.q[0], motion.tensions_N[0]),
    )
    assert replayed.q[-1, :, :2].sum(axis=0) == pytest.approx(bend[-1], abs=2e-3)


def test_a_motion_that_takes_a_push_falls_behind_and_its_cables_go_slack():
    time = np.linspace(0.0, 1.0, 101)
    bend = np.stack([0.5 * np.sin(6.0 * time), 0.0 * time], axis=1)
    motion, missed = forces_for_motion(HANGING, time, bend, np.full(101, 0.252))
    assert motion.tensions_N.min() == 0.0
    assert np.abs(missed[:, 0]).max() > 0.05


def test_motor_forces_of_a_motion_are_more_than_the_tension_where_the_cable_is_pulled_in():
    time = np.linspace(0.0, 1.0, 101)
    bend = np.stack([0.6 * time, 0.0 * time], axis=1)
    motion, _ = forces_for_motion(HANGING, time, bend, np.full(101, 0.225))
    assert (motion.motor_N[40:, 0] > motion.tensions_N[40:, 0]).all()
    assert (motion.motor_N[40:, 1] < motion.tensions_N[40:, 1]).all()
