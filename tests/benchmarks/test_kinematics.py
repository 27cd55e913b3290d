"""The kinematics of a control tick, compiled against the plain reference, in one run."""

import time

import numpy as np
import pytest

from cobra.kinematics.backbone import Backbone
from cobra.kinematics.compiled import CompiledKinematics
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
