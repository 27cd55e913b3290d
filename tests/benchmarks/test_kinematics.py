"""The kinematics of a control tick, compiled against the plain reference, in one run."""

import time

import daqp
import numpy as np
import pytest
from scipy.optimize import minimize

from cobra.kinematics import resolved_rates
from cobra.kinematics.backbone import Backbone
from cobra.kinematics.compiled import CompiledKinematics
from cobra.kinematics.resolved_rates import ResolvedRates
from cobra.kinematics.tendons import TendonMap
from cobra.loading import load_description

pytestmark = pytest.mark.benchmark


def median_us(call, qs):
    times = []
    for q in qs:
        start = time.perf_counter()
        call(q)
        times.append(time.perf_counter() - start)
    return np.median(times) * 1e6


def test_a_tick_of_61_points_jacobian_and_tendons(capsys):
    cobra = load_description("cobra")
    backbone, tendons, compiled = Backbone(cobra), TendonMap(cobra), CompiledKinematics(cobra)
    compiled.warm_up()
    rng = np.random.default_rng(7)
    qs = np.tile(compiled.rest, (3000, 1))
    qs[:, 2:] += rng.normal(size=(3000, 6)) * 0.7
    qs[:, 1] = rng.uniform(0.05, 0.5, 3000)

    def reference(q):
        return backbone.points(q, 61), backbone.tip_jacobian(q), tendons.lengths(q)

    plain, fast = median_us(reference, qs[:500]), median_us(compiled, qs)
    with capsys.disabled():
        print("\nkinematics tick (61 points, tip Jacobian, 12 tendons; one configuration a call), median")
        print(f"  reference, NumPy  {plain:8.1f} µs   {1e6 / plain:9.0f} a second")
        print(f"  compiled          {fast:8.1f} µs   {1e6 / fast:9.0f} a second   {plain / fast:.0f} times faster")
    assert fast < plain


def test_a_step_of_resolved_rates(capsys, monkeypatch):
    """A driver who circles, advances and rolls; the whole step, the solver's part, and scipy's SLSQP on the same programs."""
    rates = ResolvedRates(load_description("cobra"))
    rates.warm_up()
    problems, steps, solves = [], [], []
    solve = daqp.solve

    def timed(*problem):
        start = time.perf_counter()
        found = solve(*problem)
        solves.append(time.perf_counter() - start)
        problems.append(problem)
        return found

    monkeypatch.setattr(resolved_rates.daqp, "solve", timed)
    q = rates.configuration.rest()
    velocity, scales = np.zeros_like(q), []
    for tick in range(2000):
        phase = tick / 150
        command = np.array([0.03 * np.cos(phase), 0.03 * np.sin(phase), 0.02 * np.sin(phase / 3), 0, 0, 0.2])
        start = time.perf_counter()
        step = rates.step(q, velocity, command, 0.01)
        steps.append(time.perf_counter() - start)
        q, velocity = step.q, step.velocity
        scales.append(step.scale)
    general = []
    for H, f, A, high, low, _ in problems[::100]:
        k = len(f)
        rows = np.vstack([np.eye(k), A])
        limits = [(rows[high < 1e20], high[high < 1e20]), (-rows[low > -1e20], -low[low > -1e20])]
        G, g = np.vstack([limit[0] for limit in limits]), np.concatenate([limit[1] for limit in limits])
        room = {"type": "ineq", "fun": lambda x, G=G, g=g: g - G @ x, "jac": lambda x, G=G: -G}
        start = time.perf_counter()
        minimize(
            lambda x, H=H, f=f: 0.5 * x @ H @ x + f @ x,
            np.zeros(k),
            jac=lambda x, H=H, f=f: H @ x + f,
            method="SLSQP",
            constraints=[room],
        )
        general.append(time.perf_counter() - start)
    with capsys.disabled():
        print("\nresolved rates, 8 variables, 2000 ticks")
        p50, p99 = np.percentile(steps, [50, 99]) * 1e6
        print(f"  whole step          median {p50:7.0f} µs   p99 {p99:7.0f} µs")
        p50, p99 = np.percentile(solves, [50, 99]) * 1e6
        print(f"  of it the solver    median {p50:7.0f} µs   p99 {p99:7.0f} µs")
        slow = np.median(general) * 1e6
        print(f"  scipy's SLSQP       median {slow:7.0f} µs   {slow / p50:.0f} times as long")
        print(f"  ticks at the full command {np.mean(np.array(scales) > 0.99):.0%}, fallbacks {rates.fallbacks}")
    assert rates.fallbacks == 0
