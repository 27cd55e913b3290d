import numpy as np
import pytest
from scipy.optimize import minimize

from cobra.kinematics.backbone import Backbone
from cobra.kinematics.configuration import FEED
from cobra.kinematics.path_fit import POINTS, PathFit
from cobra.kinematics.tip_path import SPACING_M, TipPath


def arc_path(curvature, lead_in=0.0, length=0.35):
    """A plane arc in the x-z plane after a straight lead-in, by its closed form."""
    s = np.arange(0.0, length, SPACING_M)
    a = np.maximum(s - lead_in, 0.0) * curvature
    x = (1 - np.cos(a)) / curvature
    z = np.minimum(s, lead_in) + np.sin(a) / curvature
    return TipPath(np.stack([x, 0 * s, z], axis=1))


def winding_path(seed, strength=8.0):
    """A random smooth space curve that leaves the port along its axis."""
    rng = np.random.default_rng(seed)
    s = np.arange(0.0, 0.35, 1e-4)
    heading = strength * np.cumsum(
        [np.sin(rng.uniform(10, 30) * s + phase) * np.minimum(s / 0.02, 1) for phase in rng.uniform(0, 6, 2)], axis=1
    )
    heading = heading * 1e-4
    tangent = np.stack([*np.sin(heading), np.cos(heading[0]) * np.cos(heading[1])], axis=1)
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    points = np.concatenate([np.zeros((1, 3)), np.cumsum(tangent, axis=0) * 1e-4])
    return TipPath(np.ascontiguousarray(points[:: round(SPACING_M / 1e-4)]))


def closest(path, positions):
    """Distances from positions to the path, by brute force over a finely divided polyline: an independent measure."""
    fine = np.concatenate(
        [np.linspace(a, b, 20, endpoint=False) for a, b in zip(path.points[:-1], path.points[1:], strict=True)]
    )
    return np.linalg.norm(positions[:, None] - fine[None], axis=2).min(axis=1)


def exposed_points(backbone, q, count=POINTS):
    port = max(backbone.active_length_m - q[FEED], 0.0)
    s = port + (backbone.length(q) - port) * np.arange(1, count + 1) / count
    return backbone.poses_at(q, s).positions


@pytest.mark.parametrize("insertion", [0.05, 0.12, 0.2, 0.3])
def test_a_path_of_constant_curvature_is_met_exactly_at_any_insertion(cobra, insertion):
    fit, path = PathFit(cobra), arc_path(6.0)
    q = Backbone(cobra).configuration.rest()
    q[FEED] = insertion
    joint, sequential = fit.joint(q, path, 20), fit.sequential(q, path)
    # What is left is the sagitta of a 1 mm chord.
    assert joint.distances_m.max() < 2e-6
    assert fit.distances(sequential, path).max() < 2e-6
    np.testing.assert_allclose(joint.q, sequential, atol=1e-3)


@pytest.mark.parametrize("seed", range(3))
def test_distances_are_those_to_the_closest_point(cobra, seed):
    fit, path, backbone = PathFit(cobra), winding_path(seed), Backbone(cobra)
    q = backbone.configuration.rest()
    q[FEED] = 0.26
    q = fit.sequential(q, path)
    expected = closest(path, exposed_points(backbone, q))
    inner = expected > 1e-4  # nearer than that the polyline of the reference is too coarse
    inner[-1] = False  # at the tip the path goes on beyond its foot
    np.testing.assert_allclose(fit.distances(q, path)[inner], expected[inner], rtol=0.02)


@pytest.mark.parametrize("insertion", [0.08, 0.17, 0.3])
@pytest.mark.parametrize("seed", range(2))
def test_the_joint_fit_is_as_good_as_a_general_optimiser_finds(cobra, seed, insertion):
    fit, path, backbone = PathFit(cobra), winding_path(seed), Backbone(cobra)
    q = backbone.configuration.rest()
    q[FEED] = insertion
    limits = backbone.bend_limits(q)
    free = np.flatnonzero(limits > 0)

    def weighed(distances):
        return 1e6 * (np.sum(distances**2) + (POINTS - 1) * distances[-1] ** 2)

    def cost(bends):
        tried = q.copy()
        for i, bend in zip(free, bends.reshape(-1, 2), strict=True):
            tried[2 + 2 * i : 4 + 2 * i] = bend
        return weighed(fit.distances(tried, path))

    room = [
        {"type": "ineq", "fun": lambda b, i=i: limits[free[i]] ** 2 - b[2 * i] ** 2 - b[2 * i + 1] ** 2}
        for i in range(len(free))
    ]
    near = fit.sequential(q, path)
    aside = near.copy()
    aside[2:] += np.random.default_rng(seed).normal(size=6) * 0.2
    for begin in (near, aside):
        best = minimize(cost, begin[2:].reshape(3, 2)[free].ravel(), method="SLSQP", constraints=room).fun
        assert weighed(fit.joint(begin, path, 50).distances_m) <= best * 1.01 + 1e-9


def test_limits_hold_on_a_path_that_turns_too_sharply(robot):
    fit, path, backbone = PathFit(robot), arc_path(40.0, 0.04), Backbone(robot)
    q = backbone.configuration.rest()
    for insertion in np.linspace(0.0, backbone.active_length_m, 40):
        q[FEED] = insertion if robot.feed else q[FEED]
        q = fit.joint(q, path).q
        bends = np.array([np.hypot(*q[bend]) for bend in backbone.configuration.bends])
        assert np.all(bends <= backbone.bend_limits(q) + 1e-12)
        sequential = fit.sequential(q, path)
        bends = np.array([np.hypot(*sequential[bend]) for bend in backbone.configuration.bends])
        assert np.all(bends <= backbone.bend_limits(q) + 1e-12)


def test_sections_behind_the_port_stay_straight_and_passive_ones_as_they_are(robots):
    fit = PathFit(robots["passive-between"])
    q = Backbone(robots["passive-between"]).configuration.rest()
    q[FEED], q[4:6] = 0.2, (0.1, -0.05)
    found = fit.joint(q, winding_path(0)).q
    np.testing.assert_array_equal(found[4:6], [0.1, -0.05])
    assert np.hypot(*found[6:8]) > 0.01
    q[FEED] = 0.1
    np.testing.assert_array_equal(fit.joint(q, winding_path(0)).q[2:4], 0.0)


@pytest.mark.parametrize("seed", range(4))
def test_the_joint_fit_keeps_the_body_nearer_than_one_section_after_the_other(cobra, seed):
    fit, path, backbone = PathFit(cobra), winding_path(seed, 12.0), Backbone(cobra)
    q = backbone.configuration.rest()
    joint, sequential = [], []
    for insertion in np.arange(0.005, 0.3, 0.005):
        q[FEED] = insertion
        q = fit.joint(q, path).q
        joint.append(fit.distances(q, path).max())
        sequential.append(fit.distances(fit.sequential(q, path), path).max())
    assert max(joint) < 0.8 * max(sequential)
