"""The exact chain: its equations against its energies, and its motion against general-purpose integrators and MuJoCo."""

import msgspec
import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.integrate import solve_ivp
from scipy.linalg import eigh

from cobra.mechanics.chain import (
    MOUNTINGS,
    SrcBotParameters,
    cable_forces,
    guider_frames,
    kinetic_energy,
    potential_energy,
)
from cobra.mechanics.dynamics import DEFAULT_STEP_S, Chain, SimulationError, simulate
from cobra.mechanics.inverse import equilibrium
from cobra.mechanics.kernels.articulated import accelerations
from cobra.mechanics.kernels.balance import generalised_forces, stiffness
from cobra.mechanics.schedule import Cables, Load, Schedule

ROBOT = SrcBotParameters(gravity_m_s2=(1.0, 2.0, 9.0))
FREE = SrcBotParameters(damping_bend_Nms=0.0, damping_twist_Nms=0.0, damping_axial_Ns_m=0.0, friction=0.0)
"""Without anything that takes energy."""
SLACK = Cables.constant(np.zeros(3))
STILL = np.zeros((5, 4))


def replaced(parameters, **changes):
    return msgspec.structs.replace(parameters, **changes)


def somewhere(seed):
    """A bent, twisted, stretched robot in motion: q, v, a (n, 4), forces on the guiders (n, 3)."""
    rng = np.random.default_rng(seed)
    q = ROBOT.rest + rng.normal(size=(5, 4)) * [0.5, 0.5, 0.3, 0.005]
    return q, rng.normal(size=(5, 4)) * [2.0, 2.0, 1.0, 0.3], rng.normal(size=(5, 4)), rng.normal(size=(5, 3))


def slope(function, q, difference=1e-6):
    """∂function/∂q (n, 4), by central differences."""
    out = np.zeros(q.shape)
    for at in np.ndindex(q.shape):
        step = np.zeros(q.shape)
        step[at] = difference
        out[at] = (function(q + step) - function(q - step)) / (2.0 * difference)
    return out


@pytest.mark.parametrize("seed", range(3))
def test_at_rest_the_generalised_forces_are_the_slope_of_the_energies(seed):
    q, _, _, load = somewhere(seed)

    def energy(q):
        return potential_energy(ROBOT, q) - np.sum(load * guider_frames(q)[1:, :3, 3])

    forces = generalised_forces(ROBOT.constants, q, STILL, STILL, load)
    assert forces == pytest.approx(slope(energy, q), rel=1e-6, abs=1e-7)


@pytest.mark.parametrize("seed", range(3))
def test_motion_obeys_lagrange_with_the_kinetic_energy(seed):
    q, v, a, load = somewhere(seed)

    def momentum(q, v):
        return slope(lambda rate: kinetic_energy(ROBOT, q, rate), v, 1e-3)

    h = 1e-5
    inertia = (momentum(q + h * v, v + h * a) - momentum(q - h * v, v - h * a)) / (2.0 * h)
    inertia -= slope(lambda at: kinetic_energy(ROBOT, at, v), q)
    damping = v * [ROBOT.damping_bend_Nms, ROBOT.damping_bend_Nms, ROBOT.damping_twist_Nms, ROBOT.damping_axial_Ns_m]
    static = generalised_forces(ROBOT.constants, q, STILL, STILL, load)
    assert generalised_forces(ROBOT.constants, q, v, a, load) == pytest.approx(inertia + damping + static, abs=2e-6)


@settings(max_examples=60, deadline=None)
@given(
    bends=arrays(np.float64, (5, 3), elements=st.floats(-1.5, 1.5)),
    rates=arrays(np.float64, (5, 4), elements=st.floats(-3.0, 3.0)),
    tensions=arrays(np.float64, 3, elements=st.floats(0.0, 50.0)),
)
def test_accelerations_and_generalised_forces_are_inverse_to_each_other(bends, rates, tensions):
    q = np.column_stack([bends, np.full(5, 0.047)])
    load = np.outer(np.arange(5.0), [0.3, -0.2, 0.1])
    a = accelerations(ROBOT.constants, ROBOT.cable_matrix, q, rates, tensions, load)
    left = generalised_forces(ROBOT.constants, q, rates, a, load)
    given_by_cables = np.broadcast_to(cable_forces(ROBOT, tensions), (5, 4))
    assert left == pytest.approx(given_by_cables, rel=1e-6, abs=1e-6)


def mass_matrix(parameters, q):
    """(4 n, 4 n)"""
    n = len(q)
    still, none = np.zeros((n, 4)), np.zeros((n, 3))
    rest = generalised_forces(parameters.constants, q, still, still, none)
    columns = [
        (generalised_forces(parameters.constants, q, still, unit.reshape(n, 4), none) - rest).ravel()
        for unit in np.eye(4 * n)
    ]
    return np.array(columns).T


def mujoco_chain(parameters):
    """The straight robot without weight: in the middle of each chamber a spring hinge about x, y and z and a spring slide."""
    p = parameters
    half = 0.5 * p.rest_length_m
    bend, twist = p.bending_stiffness_Nm2 / p.rest_length_m, p.torsional_stiffness_Nm2 / p.rest_length_m
    j, k = p.guider_inertia_bend_kgm2, p.guider_inertia_twist_kgm2
    body = ""
    for i in range(p.segments):
        body += (
            f'<body pos="0 0 {half if i == 0 else 2 * half}">'
            f'<joint type="hinge" axis="0 1 0" stiffness="{bend}"/><joint type="hinge" axis="-1 0 0" stiffness="{bend}"/>'
            f'<joint type="hinge" axis="0 0 1" stiffness="{twist}"/>'
            f'<joint type="slide" axis="0 0 1" stiffness="{p.axial_stiffness_N_m}"/>'
            f'<inertial pos="0 0 {half}" mass="{p.guider_mass_kg}" diaginertia="{j} {j} {k}"/>'
        )
    xml = f'<mujoco><option gravity="0 0 0"/><worldbody>{body}{"</body>" * p.segments}</worldbody></mujoco>'
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    return inertia, np.diag(model.jnt_stiffness)


@pytest.mark.parametrize("segments", [1, 5, 12])
def test_natural_frequencies_are_those_of_a_mujoco_chain(segments):
    robot = SrcBotParameters(segments=segments, gravity_m_s2=MOUNTINGS["weightless"])
    springs = stiffness(robot.constants, robot.rest, np.zeros((segments, 3)), 1e-5)
    ours = np.sqrt(eigh(springs, mass_matrix(robot, robot.rest), eigvals_only=True))
    inertia, mujoco_springs = mujoco_chain(robot)
    theirs = np.sqrt(eigh(mujoco_springs, inertia, eigvals_only=True))
    assert ours == pytest.approx(theirs, rel=1e-6)


def test_the_simulated_robot_swings_with_the_first_natural_frequency():
    robot = replaced(FREE, gravity_m_s2=MOUNTINGS["weightless"])
    inertia, springs = mujoco_chain(robot)
    squares, modes = eigh(springs, inertia)
    # The first mode bends about y: MuJoCo's first coordinate of each chamber is b_x.
    mode = modes[:, 0].reshape(5, 4)
    mode = mode if abs(mode[0, 0]) > abs(mode[0, 1]) else modes[:, 1].reshape(5, 4)
    q = robot.rest.copy()
    q[:, 0] += 1e-3 * mode[:, 0] / np.abs(mode[:, 0]).max()
    motion = simulate(robot, 5.0, SLACK, start=Chain(robot, q), record_s=0.001)
    swing = motion.q[:, 0, 0]
    rising = np.flatnonzero((swing[:-1] < 0.0) & (swing[1:] >= 0.0))
    crossings = motion.time_s[rising] - swing[rising] * 0.001 / (swing[rising + 1] - swing[rising])
    assert 2.0 * np.pi / np.diff(crossings).mean() == pytest.approx(np.sqrt(squares[0]), rel=1e-3)


def test_motion_is_that_of_a_general_purpose_integrator():
    robot = replaced(ROBOT, friction=0.0, locked_length_m=0.01, unlocked_length_m=0.011)
    tensions, load = np.array([9.0, 2.0, 5.0]), np.zeros((5, 3))
    load[2] = [0.5, -1.0, 0.0]

    def rates(_, y):
        q, v = y[:20].reshape(5, 4), y[20:].reshape(5, 4)
        a = accelerations(robot.constants, robot.cable_matrix, q, v, tensions, load)
        return np.concatenate([v.ravel(), a.ravel()])

    start = np.concatenate([robot.rest.ravel(), np.zeros(20)])
    there = solve_ivp(rates, (0.0, 1.0), start, rtol=1e-9, atol=1e-11, t_eval=[0.25, 0.5, 1.0])
    motion = simulate(
        robot, 1.0, Cables.constant(tensions), [Load(3, Schedule.constant(load[2]))], step_s=1e-4, record_s=0.25
    )
    for row, at in ((1, 0), (2, 1), (4, 2)):
        theirs = guider_frames(there.y[:20, at].reshape(5, 4))[:, :3, 3]
        assert motion.positions_m[row] == pytest.approx(theirs, abs=2e-5)


def test_halving_the_step_quarters_the_error():
    cables = Cables.constant([8.0, 0.0, 3.0])
    robot = replaced(ROBOT, friction=0.0)
    fine = simulate(robot, 0.5, cables, step_s=2e-5).positions_m
    coarse, half = (np.abs(simulate(robot, 0.5, cables, step_s=h).positions_m - fine).max() for h in (1e-3, 5e-4))
    assert coarse / half == pytest.approx(4.0, rel=0.15)


def test_without_damping_the_energy_stays():
    rest = equilibrium(FREE, np.zeros(3))
    q = rest + np.array([0.15, -0.1, 0.05, 0.001])
    drifts = []
    for step in (DEFAULT_STEP_S, 0.1 * DEFAULT_STEP_S):
        motion = simulate(FREE, 15.0, SLACK, start=Chain(FREE, q), step_s=step, record_s=0.05)
        energy = motion.energy_J() - potential_energy(FREE, rest)
        drifts.append(np.abs(energy / energy[0] - 1.0).max())
    print(f"energy drift over 15 s: {drifts[0]:.2%} at the default step, {drifts[1]:.4%} at a tenth of it")
    assert drifts[1] < 1e-3


def test_with_damping_the_energy_only_falls():
    robot = replaced(FREE, damping_bend_Nms=0.01, damping_twist_Nms=0.01, damping_axial_Ns_m=8.0)
    motion = simulate(
        robot, 2.0, SLACK, start=Chain(robot, robot.rest + np.array([0.2, 0.1, 0.05, 0.002])), step_s=1e-4
    )
    assert (np.diff(motion.energy_J()) < 1e-7).all()


def test_turning_the_cables_turns_the_motion():
    robot = replaced(ROBOT, gravity_m_s2=MOUNTINGS["upright"])
    one = simulate(robot, 0.6, Cables.constant([9.0, 1.0, 4.0]))
    other = simulate(robot, 0.6, Cables.constant([4.0, 9.0, 1.0]))
    c, s = np.cos(2.0 * np.pi / 3.0), np.sin(2.0 * np.pi / 3.0)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    assert other.positions_m == pytest.approx(one.positions_m @ turn.T, abs=1e-9)


@pytest.mark.parametrize("segments", [1, 2, 40])
def test_any_number_of_segments_moves(segments):
    robot = SrcBotParameters(segments=segments)
    motion = simulate(
        robot, 0.3, Cables.constant([2.0, 0.0, 0.0]), [Load(segments, Schedule.constant([0.1, 0.2, 0.0]))]
    )
    assert motion.positions_m.shape == (len(motion.time_s), segments + 1, 3)
    assert motion.positions_m[-1, -1, 0] > 0.0


def test_an_adaptive_step_keeps_to_its_tolerance():
    cables = Cables.table([0.0, 0.3], [[7.0, 0.0, 0.0], [7.0, 9.0, 12.0]])
    fine = simulate(ROBOT, 1.0, cables, step_s=5e-5)
    for tolerance, error in ((1e-5, 1e-3), (1e-7, 5e-5)):
        motion = simulate(ROBOT, 1.0, cables, tolerance_m=tolerance)
        assert np.abs(motion.positions_m - fine.positions_m).max() < error
    assert motion.steps < 3 * fine.steps


def test_a_blow_up_says_when_and_where():
    pulled = Load(2, Schedule(np.array([1.0]), np.array([[0.0, 0.0, 5000.0]])))
    with pytest.raises(
        SimulationError, match=r"blew up at t = 1\.\d+ s: segment 2 has no length left, or more than 3"
    ) as caught:
        simulate(ROBOT, 3.0, SLACK, [pulled])
    assert caught.value.segment == 2
    assert 1.0 < caught.value.time_s < 1.1


def test_a_living_chain_moves_as_the_simulation_does_and_stays_whole_after_a_blow_up():
    chain = Chain(ROBOT)
    for _ in range(50):
        chain.advance(0.01, forces_N=np.array([7.0, 0.0, 3.0]))
    motion = simulate(ROBOT, 0.5, Cables.constant([7.0, 0.0, 3.0]))
    assert chain.q == pytest.approx(motion.q[-1], abs=1e-12)
    assert chain.tensions_N == pytest.approx(motion.tensions_N[-1], abs=1e-12)
    with pytest.raises(SimulationError):
        chain.advance(1.0, loads_N=np.full((5, 3), 1e4))
    assert chain.q == pytest.approx(motion.q[-1], abs=1e-12)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"cables": Cables.constant([1.0, 2.0])}, "2 cable forces for 3 cables"),
        ({"cables": Cables.constant([1.0, -2.0, 0.0])}, "cable 2: a cable can only pull"),
        (
            {"loads": [Load(6, Schedule.constant([1.0, 0.0, 0.0]))]},
            "no guider 6; they are numbered 1 .base. to 5 .top.",
        ),
        ({"loads": [Load(1, Schedule.constant([1.0, 0.0]))]}, "three components"),
        ({"duration_s": 0.0}, "duration_s = 0: must be positive"),
        ({"step_s": float("nan")}, "step_s = nan"),
    ],
)
def test_what_cannot_be_simulated_is_said(arguments, message):
    with pytest.raises(ValueError, match=message):
        simulate(**({"parameters": ROBOT, "duration_s": 1.0, "cables": SLACK} | arguments))


def test_a_robot_cannot_start_shorter_than_its_stop():
    q = ROBOT.rest.copy()
    q[1, 3] = 0.039
    with pytest.raises(ValueError, match="segment 2 starts 39 mm long; the guiders touch at 40 mm"):
        Chain(ROBOT, q)
