"""Claims about sections under tendons that stretch, go slack, pass load on and remember: against robots made of holes."""

import numpy as np
import pytest

from cobra.mechanics.robot_model import RobotModel, blocks, nominal
from cobra.mechanics.tendon_statics import TANGENT_STEP, Drive, Springs, log_age, solve, solve_with_tangents
from tests.calibration_recordings import nominal_robot
from tests.tendon_robots import DISCS, TendonRobot, two_sections

N = 2


def springs_of(robot: TendonRobot) -> Springs:
    """The true numbers of a robot made of holes, as the model takes them."""
    r, k = robot.radius_m, robot.bending_Nm[0]
    direction = np.zeros((len(robot.ends), N, 2))
    for t, end in enumerate(robot.ends):
        direction[t, : end + 1] = [np.cos(robot.azimuth[t]), np.sin(robot.azimuth[t])]
    one = np.zeros(1)
    return Springs(
        rest=robot.rest.ravel(),
        bending=robot.bending_Nm / k,
        slip_stiffness=np.zeros(N),
        slip_moment=np.zeros(N),
        length=robot.length_m / r,
        chord=np.full(N, 1.0 / (24.0 * DISCS**2)),
        direction=direction,
        zero=robot.taut_m / r,
        gain=robot.gain,
        stiffness=robot.stiffness_N_m * r**2 / k,
        hardening=np.zeros(len(robot.ends)),
        play=one,
        friction=one,
        creep=one,
        clock=one,
    )


def drive(wound):
    return Drive(wound, np.zeros_like(wound), np.zeros(len(wound)))


def one_pulls(wound):
    """The first tendon alone, the others paid out."""
    return np.concatenate([wound[:, None], np.full((len(wound), 6), -1.0)], axis=-1)


@pytest.fixture(scope="module")
def robot():
    return two_sections(np.random.default_rng(2))


def test_shapes_are_those_of_a_robot_made_of_holes(robot):
    rng = np.random.default_rng(3)
    wound = rng.uniform(-0.02, 0.02, (40, len(robot.ends)))
    found = solve(springs_of(robot), drive(wound / robot.radius_m), robot.ends).reshape(-1, N, 2)
    true = robot.shapes(wound)
    assert np.degrees(np.linalg.norm(true, axis=-1)).max() > 40.0
    assert np.degrees(np.linalg.norm(found - true, axis=-1)).max() < 0.5


def test_a_tendon_cannot_push(robot):
    springs = springs_of(robot)._replace(rest=np.zeros(2 * N))
    paid_out = np.full((1, len(robot.ends)), -0.5)
    assert solve(springs, drive(paid_out), robot.ends) == pytest.approx(np.zeros((1, 2 * N)), abs=1e-9)
    pushed = solve(springs, drive(paid_out * np.eye(7)[0]), robot.ends, slack=False)
    assert np.linalg.norm(pushed[0, :2]) > 0.1


def test_pulling_a_distal_tendon_bends_the_sections_that_it_passes(robot):
    springs = springs_of(robot)._replace(rest=np.zeros(2 * N), zero=np.zeros(7))
    wound = np.zeros((1, 7))
    wound[0, 4] = 0.5
    bend = solve(springs, drive(wound), robot.ends).reshape(N, 2)
    towards = np.array([np.cos(robot.azimuth[4]), np.sin(robot.azimuth[4])])
    assert bend[0] @ towards > 0.03
    assert bend[1] @ towards > bend[0] @ towards


def test_stiffer_tendons_bend_more_for_the_same_travel(robot):
    wound = one_pulls(np.array([0.5]))
    soft = springs_of(robot)
    stiff = soft._replace(stiffness=10.0 * soft.stiffness)
    angles = [np.linalg.norm(solve(s, drive(wound), robot.ends)[0, :2]) for s in (soft, stiff)]
    assert angles[1] > 1.05 * angles[0]


def test_sections_that_slip_come_back_short_and_close_the_loop_again(robot):
    """Rate-independent: the way back differs from the way there, and the second loop is the first."""
    springs = springs_of(robot)._replace(
        rest=np.zeros(2 * N), slip_stiffness=np.full(N, 0.5), slip_moment=np.full(N, 0.05)
    )
    swing = 0.5 * np.abs(np.sin(np.linspace(0.0, 2.0 * np.pi, 81)))
    wound = one_pulls(swing)
    bend = solve(springs, drive(wound), robot.ends)[:, 0]
    slow = solve(springs, drive(np.repeat(wound, 3, axis=0)), robot.ends)[2::3, 0]
    assert slow == pytest.approx(bend, abs=1e-9), "how long it takes does not matter"
    there, back = bend[10], bend[30]
    assert swing[10] == pytest.approx(swing[30])
    assert back - there > 0.01
    assert bend[60] == pytest.approx(bend[20], abs=1e-3), "at the same peak"
    assert bend[70] == pytest.approx(bend[30], abs=1e-3), "on the same way back"


def test_slip_follows_an_elastic_plastic_element_written_out(robot):
    """One section told to bend by stiff tendons: the moment is K b + an element that yields at M."""
    k, moment = 0.6, 0.04
    springs = springs_of(robot)._replace(
        rest=np.zeros(2 * N),
        slip_stiffness=np.array([k, 0.0]),
        slip_moment=np.array([moment, 0.0]),
        chord=np.zeros(N),
        zero=np.zeros(7),
    )
    wound = one_pulls(0.4 * np.sin(np.linspace(0.0, np.pi, 60)))
    bends = solve(springs, drive(wound), robot.ends)
    along = np.array([np.cos(robot.azimuth[0]), np.sin(robot.azimuth[0])])
    anchor, held = np.zeros(2), []
    for b in bends[:, :2]:
        off = b - anchor
        if np.linalg.norm(off) > moment / k:
            anchor = b - off / np.linalg.norm(off) * moment / k
        held.append(k * (b - anchor))
    pull = springs.stiffness[0] * np.maximum(springs.gain[0] * wound[:, 0] - bends[:, :2] @ along, 0.0)
    balance = pull[:, None] * along - bends[:, :2] - np.array(held)
    assert np.abs(balance).max() < 1e-4
    assert np.linalg.norm(held, axis=-1).max() == pytest.approx(moment)


@pytest.mark.parametrize("effect", [("section hysteresis",), ("tendon friction",), ("section hysteresis", "vertebrae")])
def test_sensitivities_are_those_of_small_changes(effect):
    """Through slack and slip, whose states depend on the parameters too."""
    rng = np.random.default_rng(7)
    robot = nominal(nominal_robot())
    model = RobotModel(robot, blocks(robot), ("elastic one-sided tendons", *effect), oriented=False)
    x = 0.2 * rng.standard_normal(model.size)
    told = 0.8 * np.sin(np.linspace(0.0, 5.0, 40))[:, None] * rng.uniform(-1.0, 1.0, 7)
    seen = Drive(told, np.zeros_like(told), log_age(np.arange(40.0)))

    def at(y):
        return model.springs(model.values(y))

    unit = np.eye(model.size)
    raised = [at(x + TANGENT_STEP * unit[p]) for p in range(model.size)]
    _, tangents = solve_with_tangents(at(x), raised, seen, robot.ends)
    h = 1e-4
    wrong = 0
    for p in range(model.size):
        across = (solve(at(x + h * unit[p]), seen, robot.ends) - solve(at(x - h * unit[p]), seen, robot.ends)) / (2 * h)
        # Where something begins to slip between x − h and x + h, the difference has a kink and says nothing.
        wrong += np.mean(np.abs(tangents[:, p] - across) > 0.02 * max(np.abs(across).max(), 1e-3)) > 0.1
    assert wrong <= 1
