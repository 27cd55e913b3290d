"""Compensation off and on, on the same twins and trajectories: each twin's losses are drawn within ±30 % of the description.

The controller sees frames only. With `swept` its parameters come from the guided sweep of that same twin.
"""

import numpy as np
import pytest

from cobra.control.identification_sweep import steps
from cobra.kinematics.backbone import Backbone
from cobra.mechanics.loss_identification import Sweep, identify
from cobra.mechanics.losses import Identified
from cobra.messages import Intent, Request
from cobra.simulation.drives import world_of
from tests.bench import CHANNEL, Bench

SECONDS = 15.0
REVERSED_S = 1.0
"""A reversal's error is counted for so long after it."""


def trajectory(seed: int, seconds: float, dt_s: float = 0.01) -> list[Intent]:
    """Random bends of random sections, most of them there and back."""
    rng = np.random.default_rng(seed)
    out: list[Intent] = []
    while len(out) < seconds / dt_s:
        section, turn, speed = int(rng.integers(3)), rng.uniform(0.0, 2.0 * np.pi), float(rng.choice([0.5, 1.0]))
        x, y, ticks = float(np.cos(turn)), float(np.sin(turn)), int(rng.uniform(0.5, 2.0) / dt_s)
        out += [Intent(primary=(x, y), section=section, speed=speed)] * ticks
        if rng.uniform() < 0.8:
            out += [Intent(primary=(-x, -y), section=section, speed=speed)] * ticks
        out += [Intent()] * int(rng.uniform(0.0, 0.5) / dt_s)
    return out[: int(seconds / dt_s)]


def drive(seed: int, on: bool, identified: Identified | None = None) -> dict[str, np.ndarray]:
    """Errors of a drive against what was commanded: bends [rad], tip [m], and the bends that the robot believed in."""
    rows = []
    with Bench(seed=seed, losses="seeded") as bench:
        if identified is not None:
            bench.loop.tendons.use(identified)
        assert bench.home().phase == "ready"
        bench.ask(Request(what="compensation", lease=bench.lease, value=float(on)))
        for _ in range(5):
            bench.tick()
        world, backbone, last, since = world_of(CHANNEL), Backbone(bench.description), Intent(), np.inf
        for intent in trajectory(seed + 100, SECONDS):
            if np.dot(intent.primary, last.primary) < 0.0 and intent.section == last.section:
                since = 0.0
            last, since = intent, since + bench.loop.period_s
            state = bench.tick(intent)
            truth, q = world.truth(), np.array(state.commanded)
            tip = truth.tip_position - backbone.tip(q)[:3, 3]
            believed = np.array(state.measured)[2:] - truth.bends.ravel()
            rows.append((truth.bends.ravel() - q[2:], tip, believed, since < REVERSED_S, truth.tensions))
    names = ("bend", "tip", "believed", "reversal", "tension")
    return {name: np.array(column) for name, column in zip(names, zip(*rows, strict=True), strict=True)}


def swept(seed: int) -> Identified:
    """What the guided sweep of this twin tells."""
    states = []
    with Bench(seed=seed, losses="seeded") as bench:
        assert bench.home().phase == "ready"
        bench.ask(Request(what="compensation", lease=bench.lease, value=0.0))
        for step in steps(bench.believed):
            if step.pretension_N is not None:
                assert bench.ask(Request(what="pretension", lease=bench.lease, value=step.pretension_N)).ok
            states += [bench.tick(step.intent) for _ in range(round(step.seconds / bench.loop.period_s))]
        own = list(bench.description.tendon_drives)
        rows = [state.drives for state in states]
        sweep = Sweep(
            np.array([state.stamp for state in states]),
            *(np.array([getattr(row, name) for row in rows])[:, own] for name in ("travel", "velocity", "load")),
        )
        return identify(bench.believed, sweep)


def rms(errors: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum(errors**2, axis=-1))))


LESS_ON_REVERSALS, LESS_AT_THE_TIP = 0.75, 0.70
"""Of the RMS errors without compensation, with what the sweep found."""


@pytest.mark.benchmark
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_off_described_and_swept(seed: int) -> None:
    off = drive(seed, on=False)
    print(
        f"\nseed {seed}, {SECONDS:.0f} s, RMS: {'bends':>12} {'on reversals':>14} {'tip':>10} {'believed':>12} {'tensions':>14}"
    )
    runs = {"off": off, "described": drive(seed, on=True), "swept": drive(seed, on=True, identified=swept(seed))}
    for name, run in runs.items():
        bend, turn = np.degrees(rms(run["bend"])), np.degrees(rms(run["bend"][run["reversal"]]))
        tip, believed = 1e3 * rms(run["tip"]), np.degrees(rms(run["believed"]))
        reversals = 1.0 - rms(run["bend"][run["reversal"]]) / rms(off["bend"][off["reversal"]])
        tips = 1.0 - rms(run["tip"]) / rms(off["tip"])
        print(
            f"  {name:>10} {bend:14.1f} deg {turn:10.1f} deg {tip:7.1f} mm {believed:8.1f} deg "
            f"{run['tension'].min():6.1f}..{run['tension'].max():.1f} N   less: {reversals:.0%} on reversals, {tips:.0%} tip"
        )
    # The last is the one with the sweep's parameters.
    assert reversals > LESS_ON_REVERSALS
    assert tips > LESS_AT_THE_TIP
