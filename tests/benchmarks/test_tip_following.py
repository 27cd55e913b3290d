"""Following 48 paths: all bends fitted together against one section after the other, in one run.

The paths, from seed 7: plane arcs, S-curves, helices and random smooth curves, four each at a peak curvature of 0.35,
0.6 and 0.9 of the robot's limit. Each enters along the port's axis: straight for 20 to 80 mm, then the curvature comes
up over 10 mm. The robot is fed along each from nothing to its whole active length.
"""

import time
from collections import defaultdict

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from cobra.kinematics.backbone import Backbone
from cobra.kinematics.configuration import FEED
from cobra.kinematics.path_fit import PathFit
from cobra.kinematics.tip_path import SPACING_M, TipPath
from cobra.loading import load_description

pytestmark = pytest.mark.benchmark

FAMILIES = ("arc", "S-curve", "helix", "smooth")
PEAKS = (0.35, 0.6, 0.9)
INSERTIONS_M = np.arange(0.004, 0.3001, 0.004)
BODY_SPACING_M = 0.002
VOXEL_M = 0.0015


def curvature(family, peak, rng):
    """A curvature vector (2,) along the path, in the frame that is carried along without twist."""
    lead_in = rng.uniform(0.02, 0.08)

    def ramp(s):
        return np.clip((s - lead_in) / 0.01, 0.0, 1.0)

    if family == "arc":
        return lambda s: (peak * ramp(s), 0 * s)
    if family == "S-curve":
        middle = lead_in + rng.uniform(0.06, 0.14)
        return lambda s: (peak * ramp(s) * np.clip((middle - s) / 0.01, -1.0, 1.0), 0 * s)
    if family == "helix":
        turning = rng.uniform(-15.0, 15.0)
        return lambda s: (peak * ramp(s) * np.cos(turning * s), peak * ramp(s) * np.sin(turning * s))
    height, phase = rng.normal(size=(2, 3)), rng.uniform(0, 2 * np.pi, (2, 3))
    wave = 2 * np.pi / rng.uniform(0.15, 0.5, (2, 3))

    def raw(s):
        return [ramp(s) * sum(height[j, m] * np.sin(wave[j, m] * s + phase[j, m]) for m in range(3)) for j in range(2)]

    scale = peak / np.hypot(*raw(np.linspace(0, 0.32, 3201))).max()
    return lambda s: tuple(scale * part for part in raw(s))


def path_of(profile, plane_rad, length=0.32, step=1e-4):
    s = (np.arange(round(length / step)) + 0.5) * step
    x, y = profile(s)
    kx, ky = np.cos(plane_rad) * x - np.sin(plane_rad) * y, np.sin(plane_rad) * x + np.cos(plane_rad) * y
    turns = np.stack([-ky, kx, 0 * s], axis=1) * step
    whole, half = Rotation.from_rotvec(turns).as_matrix(), Rotation.from_rotvec(turns / 2).as_matrix()
    frame, points = np.eye(3), [np.zeros(3)]
    for i in range(len(s)):
        points.append(points[-1] + (frame @ half[i])[:, 2] * step)
        frame = frame @ whole[i]
    return TipPath(np.array(points)[:: round(SPACING_M / step)].copy())


def forty_eight_paths(limit_1_m):
    rng = np.random.default_rng(7)
    for family in FAMILIES:
        for peak in PEAKS:
            for _ in range(4):
                plane = rng.uniform(0, 2 * np.pi)
                yield family, peak, path_of(curvature(family, peak * limit_1_m, rng), plane)


def swept_volume(bodies, radius):
    """Volume that the exposed body passes through [m³], counted in voxels."""
    tree = cKDTree(bodies)
    low, high = bodies.min(axis=0) - radius, bodies.max(axis=0) + radius
    axes = [np.arange(a, b, VOXEL_M) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    near = tree.query(grid, distance_upper_bound=radius)[0] <= radius
    return near.sum() * VOXEL_M**3


class Runner:
    def __init__(self):
        self.robot = load_description("cobra")
        self.backbone, self.fit = Backbone(self.robot), PathFit(self.robot)
        self.fit.warm_up()

    def follow(self, path, solve):
        """Feed along the path; distances of the body at every 2 mm, places it passed, and the time of every solve."""
        q = self.backbone.configuration.rest()
        distances, bodies, times = [], [], []
        for insertion in INSERTIONS_M:
            q = q.copy()
            q[FEED] = insertion
            start = time.perf_counter()
            q = solve(q, path)
            times.append(time.perf_counter() - start)
            count = round(insertion / BODY_SPACING_M)
            distances.append(self.fit.distances(q, path, count))
            s = 0.3 - insertion + insertion * np.arange(1, count + 1) / count
            bodies.append(self.backbone.poses_at(q, s).positions)
        return np.concatenate(distances), np.concatenate(bodies), times


def test_joint_fit_against_sequential_on_48_paths(capsys):
    runner = Runner()
    length, radius = runner.robot.active_length_m, runner.robot.backbone.diameter_m / 2
    limit = runner.backbone.max_curvature_1_m.min()
    solvers = {
        "sequential": runner.fit.sequential,
        "joint": lambda q, path: runner.fit.joint(q, path).q,
    }
    table = defaultdict(list)
    times = defaultdict(list)
    for family, peak, path in forty_eight_paths(limit):
        row = []
        for name, solve in solvers.items():
            distances, bodies, took = runner.follow(path, solve)
            row += [100 * distances.mean() / length, 100 * distances.max() / length]
            row.append(swept_volume(bodies, radius) / (np.pi * radius**2 * length))
            times[name] += took
        table[family, peak].append(row)
    every = np.array([row for rows in table.values() for row in rows])
    ratio = every[:, 4] / every[:, 1]
    with capsys.disabled():
        print("\ndeviation of the body from the path, % of the active length; volume swept, in volumes of the body")
        print(f"{'family':9}{'peak':>5}   sequential: mean   max  swept      joint: mean   max  swept   max joint/seq")
        for (family, peak), rows in table.items():
            a = np.array(rows)
            m = a.mean(axis=0)
            print(
                f"{family:9}{peak:5.2f}   {m[0]:16.2f} {a[:, 1].max():5.2f} {m[2]:6.2f} {m[3]:16.2f} {a[:, 4].max():5.2f} "
                f"{m[5]:6.2f} {np.median(a[:, 4] / a[:, 1]):12.2f}"
            )
        m = every.mean(axis=0)
        print(
            f"{'all':9}{'':5}   {m[0]:16.2f} {every[:, 1].max():5.2f} {m[2]:6.2f} {m[3]:16.2f} {every[:, 4].max():5.2f} "
            f"{m[5]:6.2f} {np.median(ratio):12.2f}"
        )
        print(f"maximum, joint / sequential: median {np.median(ratio):.2f}, worst {ratio.max():.2f} (to reach: 0.60)")
        print(f"mean deviation, joint: {m[3]:.2f} % (to reach: 0.50); worst path {every[:, 3].max():.2f} %")
        for name, took in times.items():
            p50, p99 = np.percentile(took, [50, 99]) * 1e6
            print(
                f"solve, {name}: median {p50:.0f} µs, p99 {p99:.0f} µs"
                + (" (to reach: 1000)" if name == "joint" else "")
            )
    assert np.median(ratio) <= 0.60
    assert m[3] <= 0.50
