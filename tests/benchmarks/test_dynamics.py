"""SRC-Bot's dynamics: time and error of the paper's simulated case together, cost against segments, energy drift."""

import time

import msgspec
import numpy as np
import pytest

from cobra.loading import load_description
from cobra.mechanics.cases import load_case
from cobra.mechanics.chain import MOUNTINGS, SrcBotParameters, guider_frames, potential_energy
from cobra.mechanics.dynamics import DEFAULT_STEP_S, Chain, simulate
from cobra.mechanics.inverse import equilibrium, inverse_statics
from cobra.mechanics.schedule import Cables, Load, Schedule
from cobra.simulation.chain_plant import ChainPlant
from cobra.simulation.twin import build_twin
from tests.elastica import beam

pytestmark = pytest.mark.benchmark

PAPER_S = 0.8
"""What the paper says its own simulation of this case takes, compiled."""
REPEATS = 15


def run(case, **options):
    return simulate(case.parameters, case.file.duration_s, case.cables, case.loads, start=case.chain(), **options)


def timed(call, repeats=REPEATS):
    """Best and median time [s] after a first call that is not counted, and the last result."""
    call()
    times = []
    for _ in range(repeats):
        before = time.perf_counter()
        out = call()
        times.append(time.perf_counter() - before)
    return min(times), float(np.median(times)), out


def test_the_papers_case_in_time_and_error():
    case = load_case("paper-simulation")
    fine = run(case, step_s=0.1 * DEFAULT_STEP_S).positions_m
    print()
    for name, options in (
        (f"default step {DEFAULT_STEP_S * 1e3:g} ms", {}),
        ("half of it", {"step_s": 0.5 * DEFAULT_STEP_S}),
        ("adaptive, 1 µm a step", {"tolerance_m": 1e-6}),
    ):
        best, median, motion = timed(lambda options=options: run(case, **options))
        error = 1e3 * np.abs(motion.positions_m - fine).max()
        print(
            f"15 s of the paper's case, {name}: best {best * 1e3:.1f} ms, median {median * 1e3:.1f} ms "
            f"({PAPER_S / median:.0f} times as fast as the paper, {15.0 / median:.0f} times real time), {motion.steps} steps, "
            f"within {error:.4f} mm of a tenth of the default step"
        )
        assert error < 0.1
    best, median, _ = timed(lambda: run(case, formulation="published"))
    print(f"the paper's own equations: best {best * 1e3:.1f} ms, median {median * 1e3:.1f} ms")


def test_cost_against_the_number_of_segments():
    print()
    first = None
    for n in (1, 2, 5, 10, 20, 40):
        robot = SrcBotParameters(segments=n)
        cables, load = Cables.constant([4.0, 0.0, 0.0]), [Load(n, Schedule.constant([0.05, 0.05, 0.0]))]
        best, median, motion = timed(
            lambda robot=robot, cables=cables, load=load: simulate(robot, 1.0, cables, load), repeats=9
        )
        step = best / motion.steps
        first = first or step
        print(
            f"{n:3d} segments: {step * 1e6:6.2f} µs a step at best (median {median / motion.steps * 1e6:.2f}), "
            f"{step / first / n:.2f} of proportional to one segment's, {1.0 / median:.0f} times real time"
        )


def test_energy_drift():
    free = msgspec.structs.replace(
        SrcBotParameters(), damping_bend_Nms=0.0, damping_twist_Nms=0.0, damping_axial_Ns_m=0.0, friction=0.0
    )
    rest = equilibrium(free, np.zeros(3))
    q = rest + np.array([0.15, -0.1, 0.05, 0.001])
    print()
    for share in (1.0, 0.5, 0.1):
        motion = simulate(
            free, 15.0, Cables.constant(np.zeros(3)), start=Chain(free, q), step_s=share * DEFAULT_STEP_S, record_s=0.05
        )
        energy = motion.energy_J() - potential_energy(free, rest)
        print(
            f"energy over 15 s at {share:g} of the default step: {np.abs(energy / energy[0] - 1.0).max():.4%} of drift"
        )


def test_inverse_statics_and_a_live_step():
    robot = SrcBotParameters()
    angles = iter(np.linspace(0.0, 1.0, 1000))
    best, median, _ = timed(lambda: inverse_statics(robot, (next(angles), 0.2), 0.222), repeats=50)
    chain = Chain(robot)
    tick, tick_median, _ = timed(lambda: chain.advance(0.01, forces_N=np.array([5.0, 1.0, 2.0])), repeats=200)
    print(
        f"\ncable forces for a posture: best {best * 1e3:.2f} ms, median {median * 1e3:.2f} ms; "
        f"10 ms of a live robot: best {tick * 1e6:.0f} µs, median {tick_median * 1e6:.0f} µs ({0.01 / tick_median:.0f} times real time)"
    )


def test_statics_against_a_beam_and_the_mujoco_twin():
    """Worst deviation of any guider in share of the length: loads at the tip and in the middle, with gravity three ways."""
    print()
    hanging = SrcBotParameters()
    for mounting in ("hanging", "upright", "horizontal"):
        gravity = np.array(MOUNTINGS[mounting])
        if mounting == "horizontal":
            gravity = np.roll(gravity, -1)  # into the plane of the forces
        robot = msgspec.structs.replace(hanging, gravity_m_s2=tuple(gravity))
        worst = 0.0
        for guider, force in ((5, 2.0), (5, -5.0), (3, 6.0), (1, 0.0)):
            loads = np.zeros((5, 3))
            loads[guider - 1, 0] = force
            ours = guider_frames(equilibrium(robot, np.zeros(3), loads))[:, [0, 2], 3]
            theirs = beam(robot, loads[:, [0, 2]] + robot.guider_mass_kg * gravity[[0, 2]])
            worst = max(worst, float(np.abs(ours - theirs).max()))
        print(
            f"{mounting}: guiders within {1e3 * worst:.2f} mm ({worst / 0.25:.2%} of length) of an elastica by solve_bvp"
        )
        assert worst < 0.02 * 0.25
    description = load_description("src-bot")
    worst = 0.0
    for bend in (0.0, 0.6):
        for guider, force in ((4, 0.0), (4, 2.0), (2, 2.0)):
            travel = -0.025 - 0.03 * bend * np.cos(np.radians([0.0, 120.0, 240.0]))
            places = []
            for plant in (ChainPlant(description), build_twin(description, "default")):
                plant.advance(np.zeros(3), 0.0)
                plant.advance(travel, 1.0)
                plant.push(guider, np.array([force, 0.0, 0.0]))
                plant.advance(travel, 4.0)
                places.append(plant.truth().vertebrae)
            worst = max(worst, float(np.linalg.norm(places[0] - places[1], axis=1).max()))
    print(
        f"driven by its cables, 2 N on the top and on the middle guider: within {1e3 * worst:.2f} mm ({worst / 0.25:.2%} of "
        "length) of the MuJoCo twin"
    )
    assert worst < 0.02 * 0.25


def test_the_dynamics_as_a_plant_in_real_time():
    plant = ChainPlant(load_description("src-bot"))
    plant.advance(np.zeros(3), 0.0)
    travel = iter(-0.03 * np.abs(np.sin(np.linspace(0.0, 20.0, 20000))))
    best, median, _ = timed(lambda: plant.advance(np.full(3, next(travel)), 0.002), repeats=2000)
    print(
        f"\n2 ms of the plant: best {best * 1e6:.0f} µs, median {median * 1e6:.0f} µs ({0.002 / median:.0f} times real time)"
    )
