"""Cables that only pull, friction that never adds force, and chambers that lock and let go."""

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from cobra.mechanics.chain import (
    MOUNTINGS,
    SrcBotParameters,
    cable_forces,
    cable_lengths,
    cable_tensions,
    kinetic_energy,
    potential_energy,
)
from cobra.mechanics.dynamics import Chain, simulate
from cobra.mechanics.friction import tension_band, top_tension, transmission
from cobra.mechanics.inverse import equilibrium, inverse_statics
from cobra.mechanics.schedule import Cables, Load, Schedule

ROBOT = SrcBotParameters()
WEIGHTLESS = SrcBotParameters(gravity_m_s2=MOUNTINGS["weightless"])


def share(motion):
    """g of S-37 at every recorded moment (m, 1)."""
    q = motion.q
    return transmission(np.hypot(q[..., 0], q[..., 1]), motion.parameters.friction)[:, None]


@given(arrays(np.float64, 3, elements=st.floats(0.0, 30.0)), st.floats(0.1, 2.0), st.floats(-3.0, 3.0))
def test_generalised_forces_are_minus_the_slope_of_the_cable_lengths(tensions, theta, phi):
    """S-34 as printed in (θ, φ, L), with its errata: the rows of J_d, and the minus sign; S-8 written out here."""

    def lengths(theta, phi, length):
        return length - 0.03 * theta * np.cos(phi - np.radians([0.0, 120.0, 240.0]))

    h = 1e-6
    by_theta = (lengths(theta + h, phi, 0.2) - lengths(theta - h, phi, 0.2)) / (2.0 * h)
    by_phi = (lengths(theta, phi + h, 0.2) - lengths(theta, phi - h, 0.2)) / (2.0 * h)
    x, y, twist, along = cable_forces(ROBOT, tensions)
    assert x * np.cos(phi) + y * np.sin(phi) == pytest.approx(-by_theta @ tensions, abs=1e-7)
    assert theta * (y * np.cos(phi) - x * np.sin(phi)) == pytest.approx(-by_phi @ tensions, abs=1e-7)
    assert along == pytest.approx(-tensions.sum())
    assert twist == 0.0


@given(arrays(np.float64, 3, elements=st.floats(0.0, 30.0)))
def test_tensions_come_back_from_their_generalised_forces_straight_or_bent(tensions):
    x, y, _, along = cable_forces(ROBOT, tensions)
    assert cable_tensions(ROBOT, [x, y], along) == pytest.approx(tensions, abs=1e-9)


@given(arrays(np.float64, 5, elements=st.floats(-1.5, 1.5)), st.floats(0.0, 0.9))
def test_friction_never_adds_force_whatever_the_sign_of_the_bends(angles, friction):
    g = transmission(angles, friction)
    assert 0.0 < g <= 1.0
    assert g == transmission(np.abs(angles), friction)


def test_five_chambers_of_12_degrees_pass_what_the_formula_says():
    """S-37 by hand: (1 − η sin 6°)^9."""
    angles = np.radians(np.full(5, 12.0))
    for eta in (0.1, 0.3):
        assert transmission(angles, eta) == pytest.approx((1.0 - eta * np.sin(np.radians(6.0))) ** 9, rel=1e-12)


def test_a_cable_at_rest_keeps_its_tension_inside_the_band_and_slides_at_its_ends():
    low, high = tension_band(10.0, 0.9)
    assert (low, high) == (pytest.approx(9.0), pytest.approx(10.0 / 0.9))
    assert top_tension(9.7, 0.0, 10.0, 0.9, 3e4) == pytest.approx(9.7)
    assert top_tension(9.7, 1e-3, 10.0, 0.9, 3e4) == pytest.approx(high)
    assert top_tension(9.7, -1e-3, 10.0, 0.9, 3e4) == pytest.approx(low)
    assert top_tension(9.7, 1e-5, 10.0, 0.9, 3e4) == pytest.approx(10.0)


@settings(max_examples=25, deadline=None)
@given(arrays(np.float64, (3, 3), elements=st.floats(0.0, 20.0)), st.floats(0.0, 0.4))
def test_tensions_stay_in_the_friction_band_and_never_push(forces, friction):
    robot = msgspec.structs.replace(ROBOT, friction=friction)
    motion = simulate(robot, 0.9, Cables.table([0.0, 0.3, 0.6], forces))
    low, high = tension_band(motion.motor_N, share(motion))
    settled = np.ones(len(motion.time_s), bool)
    settled[0] = False
    # The tension is that of the last half step, in which g was a little different.
    assert (motion.tensions_N[settled] >= 0.98 * low[settled] - 1e-9).all()
    assert (motion.tensions_N[settled] <= 1.02 * high[settled] + 1e-9).all()


def test_the_compiled_law_is_the_plain_one_step_by_step():
    step = 2e-4
    robot = msgspec.structs.replace(ROBOT, friction=0.2)
    cables = Cables.table([0.0, 0.4, 0.8], [[12.0, 2.0, 0.0], [4.0, 9.0, 2.0], [11.0, 3.0, 6.0]])
    motion = simulate(robot, 1.2, cables, step_s=step, record_s=step)
    middle = motion.q[:-1] + 0.5 * np.diff(motion.q, axis=0)
    lengths, g = cable_lengths(robot, middle), share(motion)[:-1]
    tension, errors = motion.tensions_N[1], []
    for k in range(1, len(middle)):
        tension = top_tension(
            tension, lengths[k] - lengths[k - 1], motion.motor_N[k + 1], g[k], robot.cable_stiffness_N_m
        )
        errors.append(np.abs(tension - motion.tensions_N[k + 1]).max())
    assert max(errors) < 0.02
    # It stuck, slid in and slid out on the way.
    ratio = motion.tensions_N[2:, 0] / motion.motor_N[2:, 0]
    assert ratio.min() < 0.97
    assert ratio.max() > 1.03


def test_friction_takes_energy_and_leaves_hysteresis():
    still = msgspec.structs.replace(WEIGHTLESS, friction=0.3, damping_bend_Nms=0.05, damping_axial_Ns_m=30.0)
    up = Cables.table([0.0, 8.0], [[0.0, 0.0, 0.0], [10.0, 0.0, 0.0]], linear=True)
    bend = {}
    chain = Chain(still)
    simulate(still, 8.0, up, start=chain, record_s=0.1)
    bend["pulling"] = chain.q[:, 0].sum()
    simulate(still, 4.0, Cables.table([0.0, 4.0], [[10.0, 0.0, 0.0], [16.0, 0.0, 0.0]], linear=True), start=chain)
    simulate(still, 4.0, Cables.table([0.0, 4.0], [[16.0, 0.0, 0.0], [10.0, 0.0, 0.0]], linear=True), start=chain)
    bend["letting out"] = chain.q[:, 0].sum()
    assert bend["letting out"] > 1.1 * bend["pulling"]


def test_cables_wound_to_lengths_hold_the_posture_of_those_lengths():
    robot = msgspec.structs.replace(ROBOT, friction=0.0, damping_bend_Nms=0.1, damping_axial_Ns_m=40.0)
    posture = inverse_statics(robot, (0.4, 0.3), 0.23)
    wound = cable_lengths(robot, posture.q) - posture.tensions_N / robot.cable_stiffness_N_m
    motion = simulate(robot, 8.0, Cables.constant(wound, "lengths"))
    assert motion.q[-1] == pytest.approx(posture.q, abs=1e-5)
    assert motion.tensions_N[-1] == pytest.approx(posture.tensions_N, abs=0.02)
    assert motion.motor_N[-1] == pytest.approx(posture.tensions_N, abs=0.02)


def test_a_cable_paid_out_goes_slack_and_does_not_push():
    motion = simulate(ROBOT, 2.0, Cables.constant([0.24, 0.30, 0.30], "lengths"))
    assert (motion.tensions_N[:, 1:] == 0.0).all()
    assert motion.tensions_N[-1, 0] > 1.0
    assert motion.q[-1, :, 0].sum() > 0.05


def locked_robot(chain=None):
    """A straight robot pulled until every chamber has locked."""
    chain = chain or Chain(ROBOT)
    for pull in np.linspace(5.0, 22.0, 18):
        chain.advance(0.2, forces_N=np.full(3, pull))
    return chain


def test_pulled_to_the_locked_length_the_robot_is_a_rigid_body():
    chain = locked_robot()
    assert chain.locked.all()
    assert chain.stopped.all()
    assert chain.q[:, 3] == pytest.approx(np.full(5, 0.040), abs=1e-9)
    before = chain.q
    loads = np.zeros((5, 3))
    loads[4] = [5.0, -3.0, 0.0]
    chain.advance(1.0, forces_N=np.array([40.0, 20.0, 20.0]), loads_N=loads)
    assert chain.q == pytest.approx(before, abs=1e-9), "neither a bending command nor a force across may bend it"
    assert np.abs(chain.v).max() < 1e-9


def test_it_lets_go_only_beyond_the_unlocking_length():
    chain = locked_robot()
    seen = []
    for pull in np.linspace(22.0, 5.0, 120):
        chain.advance(0.1, forces_N=np.full(3, pull))
        seen.append((chain.q[:, 3].copy(), chain.locked.copy()))
    lengths, locked = (np.array(part) for part in zip(*seen, strict=True))
    assert locked[lengths < 0.0419].all(), "hysteresis: from 40 to 42 mm the slots still hold"
    assert (lengths[locked] < 0.0421).all()
    assert not locked[-1].any()
    still_locked_but_open = locked & (lengths > 0.0402)
    assert still_locked_but_open.any()
    chain.advance(1.0, forces_N=np.array([12.0, 2.0, 2.0]))
    assert chain.q[:, 0].sum() > 0.1, "free again, it bends"


def test_a_bent_chamber_meets_its_stop_but_does_not_lock():
    robot = msgspec.structs.replace(ROBOT, damping_bend_Nms=0.1, damping_axial_Ns_m=40.0)
    chain = Chain(robot)
    for pull in np.linspace(0.0, 1.0, 20):
        chain.advance(0.2, forces_N=pull * np.array([40.0, 22.0, 22.0]))
    assert chain.stopped.any()
    assert (np.hypot(chain.q[:, 0], chain.q[:, 1]) > robot.constants.lock_bend).all()
    assert not chain.locked.any()
    assert (chain.q[:, 3] >= robot.locked_length_m - 1e-9).all()


def test_the_stop_pushes_and_never_pulls():
    chain = locked_robot()
    chain.advance(0.05, forces_N=np.zeros(3))
    assert not chain.stopped.any()
    assert (chain.q[:, 3] > 0.042).all()


def test_meeting_the_stop_takes_energy_and_never_gives_any():
    free = msgspec.structs.replace(
        WEIGHTLESS, friction=0.0, damping_bend_Nms=0.0, damping_twist_Nms=0.0, damping_axial_Ns_m=0.0
    )
    q = free.rest.copy()
    q[:, 3] += 0.012
    q[:, 0] += 0.05
    motion = simulate(free, 0.5, Cables.constant(np.zeros(3)), start=Chain(free, q), step_s=5e-5, record_s=1e-3)
    assert motion.stopped.any()
    energy = kinetic_energy(free, motion.q, motion.v) + potential_energy(free, motion.q)
    assert np.diff(energy).max() < 2e-4 * energy[0]
    assert energy[-1] < 0.95 * energy[0]
    assert motion.q[..., 3].min() > free.locked_length_m - 1e-6


def test_loads_act_from_their_time_on_and_along_lines_between_times():
    robot = msgspec.structs.replace(WEIGHTLESS, damping_bend_Nms=0.2)
    ramp = Schedule(np.array([1.0, 2.0]), np.array([[0.0, 0.0, 0.0], [0.2, 0.0, 0.0]]), linear=True)
    motion = simulate(robot, 10.0, Cables.constant(np.zeros(3)), [Load(5, ramp)], record_s=0.5)
    assert np.abs(motion.positions_m[motion.time_s <= 1.0, :, 0]).max() == 0.0
    assert motion.loads_N[motion.time_s == 1.5, 4, 0] == pytest.approx(0.1)
    assert motion.loads_N[-1, 4, 0] == pytest.approx(0.2)
    loads = np.zeros((5, 3))
    loads[4, 0] = 0.2
    assert motion.q[-1] == pytest.approx(equilibrium(robot, np.zeros(3), loads), abs=1e-5)


@pytest.mark.parametrize(
    ("times", "values", "message"),
    [
        ([], [], "0 values at 0 times"),
        ([0.0, 1.0], [1.0], "one value for each time"),
        ([1.0, 1.0], [1.0, 2.0], "time 1 s follows 1 s"),
        ([0.0, np.nan], [1.0, 2.0], "finite"),
    ],
)
def test_a_schedule_that_makes_no_sense_is_refused(times, values, message):
    with pytest.raises(ValueError, match=message):
        Schedule(np.array(times), np.array(values))
