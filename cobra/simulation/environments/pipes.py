"""Pipes that the robot is fed into: straight, and with a bend as narrow as the robot can follow."""

import numpy as np

from cobra.description import RobotDescription
from cobra.simulation.environments.surface import Environment, Floats, grid_faces

BORE = 2.6
"""Inner diameter, of the body's."""
RUN_IN = 1.1
"""Straight length before the bend, of the active length: the robot starts inside it."""
BEND_RADIUS = 1.6
"""Of the pipe's centre line, of the smallest that the sections can follow."""
BEND_RAD = np.pi / 2
SIDES = 24
STEP_RAD = np.radians(6.0)
GAP = 0.05
"""Between port and pipe, of the active length: what the introducer's nose takes."""


def straight_pipe(d: RobotDescription) -> Environment:
    """As long as the robot reaches, and a little longer."""
    reach = d.feed.range_m[1] if d.feed else d.active_length_m
    s = np.linspace(GAP * d.active_length_m, 1.1 * reach, 12)
    line = np.stack([0 * s, 0 * s, s], axis=1)
    return _pipe(d, "straight-pipe", f"straight pipe of {1e3 * _bore(d):.0f} mm", line)


def bent_pipe(d: RobotDescription) -> Environment:
    """A straight run, a quarter turn towards +x, and as far as the robot reaches."""
    curvature = max(section.max_curvature_1_m for section in d.sections if section.active)
    radius = BEND_RADIUS / curvature
    run_in = RUN_IN * (d.feed.start_m if d.feed else d.active_length_m)
    reach = d.feed.range_m[1] if d.feed else 2 * d.active_length_m
    s = np.linspace(GAP * d.active_length_m, run_in, 6)[:-1]
    angle = np.linspace(0.0, BEND_RAD, round(BEND_RAD / STEP_RAD) + 1)
    run_out = np.linspace(0.0, max(1.1 * reach - run_in - BEND_RAD * radius, 0.3 * d.active_length_m), 6)[1:]
    line = np.concatenate(
        [
            np.stack([0 * s, 0 * s, s], axis=1),
            np.stack([radius * (1 - np.cos(angle)), 0 * angle, run_in + radius * np.sin(angle)], axis=1),
            np.stack([radius + run_out, 0 * run_out, np.full_like(run_out, run_in + radius)], axis=1),
        ]
    )
    title = f"pipe of {1e3 * _bore(d):.0f} mm, bent by 90 degrees at {1e3 * radius:.0f} mm"
    return _pipe(d, "bent-pipe", title, line)


def _bore(d: RobotDescription) -> float:
    return BORE * d.backbone.diameter_m


def _pipe(d: RobotDescription, name: str, title: str, line: Floats) -> Environment:
    """A tube around a centre line (n, 3) in the plane y = 0."""
    tangents = np.gradient(line, axis=0)
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    across = np.stack([tangents[:, 2], 0 * tangents[:, 0], -tangents[:, 0]], axis=1)
    around = np.linspace(0.0, 2 * np.pi, SIDES, endpoint=False)
    ring = np.cos(around)[:, None] * across[:, None, :] + np.sin(around)[:, None] * np.array([0.0, 1.0, 0.0])
    vertices = line[:, None, :] + _bore(d) / 2 * ring
    return Environment(name, title, vertices.reshape(-1, 3), grid_faces(len(line), SIDES, closed=True))
