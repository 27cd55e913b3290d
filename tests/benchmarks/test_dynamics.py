"""SRC-Bot's dynamics: time and error of the paper's simulated case together, cost against segments, energy drift."""

import time

import msgspec
import numpy as np
import pytest

from cobra.mechanics.cases import load_case
from cobra.mechanics.chain import SrcBotParameters, potential_energy
from cobra.mechanics.dynamics import DEFAULT_STEP_S, Chain, simulate
from cobra.mechanics.inverse import equilibrium, inverse_statics
from cobra.mechanics.schedule import Cables, Load, Schedule

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
