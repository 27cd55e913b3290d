"""A stage of an axial compressor, entered from the casing: a rotor's blades on one side, a stator's vanes on the other.

The engine's axis lies across, along x, one casing radius below the port; the port is a hole in the casing, and straight ahead is
the hub. All lengths follow the robot's, so that it starts free between the two rows.
"""

import numpy as np

from cobra.description import RobotDescription
from cobra.simulation.environments.surface import Environment, Floats, Indices, grid_faces, joined

CASING_RADIUS = 2.5
HUB_RADIUS = 1.15
"""Of the active length; between them is the height of the annulus."""
SECTOR_RAD = np.radians(30.0)
"""Half of the sector that is drawn, either side of the port."""
HALF_AXIAL = 0.85
ROW_AT = 0.52
"""Where the rows stand, of the active length from the port's plane."""
CHORD = 0.42
BLADES = 17
"""Around half the engine, in each row."""
TIP_GAP = 0.01
HOLE = 1.6
"""Radius of the port's hole, of the body's diameter."""
THICKNESS = 0.1
"""Of the chord."""
SPAN_STEPS, CHORD_STEPS = 10, 12


def engine_stage(d: RobotDescription) -> Environment:
    """Casing, hub, rotor and stator."""
    unit = d.active_length_m
    casing, hub = CASING_RADIUS * unit, HUB_RADIUS * unit
    parts = [_casing(casing, unit, HOLE * d.backbone.diameter_m)]
    seen_through = len(parts[0][1])
    parts.append(_hub(casing, hub, unit))
    pitch = np.pi / BLADES
    count = int(SECTOR_RAD / pitch)
    rotor = np.arange(-count, count + 1) * pitch
    stator = rotor[:-1] + pitch / 2
    tip = casing - TIP_GAP * unit
    parts += [_blade(casing, hub, tip, a, -ROW_AT * unit, CHORD * unit, 0.45, 1.05) for a in rotor]
    parts += [_blade(casing, hub, casing, a, ROW_AT * unit, CHORD * unit, -0.55, -0.25) for a in stator]
    return Environment(
        "engine-stage", "stage of a compressor, entered through its casing", *joined(parts), seen_through
    )


def _around(axis_depth: float, radius: Floats, azimuth: Floats, axial: Floats) -> Floats:
    """From the engine's cylinder coordinates to the port's frame: azimuth 0 is the port's own meridian."""
    return np.stack([axial, radius * np.sin(azimuth), axis_depth - radius * np.cos(azimuth)], axis=-1)


def _casing(radius: float, unit: float, hole: float) -> tuple[Floats, Indices]:
    """A patch of cylinder from the hole outwards: rings that turn from a circle into the patch's rim."""
    sides, rings = 96, 18
    turn = np.linspace(0.0, 2 * np.pi, sides, endpoint=False)
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    rim = circle / np.abs(circle).max(axis=1, keepdims=True) * [HALF_AXIAL * unit, SECTOR_RAD * radius]
    share = np.linspace(0.0, 1.0, rings)[:, None, None] ** 1.6
    flat = (1 - share) * hole * circle + share * rim
    return _around(radius, np.full(flat.shape[:2], radius), flat[..., 1] / radius, flat[..., 0]).reshape(
        -1, 3
    ), grid_faces(rings, sides, closed=True)


def _hub(depth: float, radius: float, unit: float) -> tuple[Floats, Indices]:
    azimuth, axial = np.meshgrid(
        np.linspace(-SECTOR_RAD, SECTOR_RAD, 25), np.linspace(-HALF_AXIAL, HALF_AXIAL, 9) * unit, indexing="ij"
    )
    return _around(depth, np.full_like(azimuth, radius), azimuth, axial).reshape(-1, 3), grid_faces(25, 9)


def _blade(
    depth: float, root: float, tip: float, azimuth: float, axial: float, chord: float, root_rad: float, tip_rad: float
) -> tuple[Floats, Indices]:
    """A cambered, twisted blade from root to tip, staggered by `root_rad` and `tip_rad` at its ends; both ends closed."""
    x = (1 - np.cos(np.linspace(0.0, np.pi, CHORD_STEPS))) / 2
    half = THICKNESS * 5 * (0.2969 * np.sqrt(x) - 0.126 * x - 0.3516 * x**2 + 0.2843 * x**3 - 0.1036 * x**4)
    camber = 0.28 * x * (1 - x) * np.sign(root_rad)
    outline = np.concatenate(
        [np.stack([x - 0.5, camber + half], axis=1), np.stack([x - 0.5, camber - half], axis=1)[-2:0:-1]]
    )
    share = np.linspace(0.0, 1.0, SPAN_STEPS)
    stagger = root_rad + (tip_rad - root_rad) * share
    cos, sin = np.cos(stagger)[:, None], np.sin(stagger)[:, None]
    size = chord * (1 - 0.15 * share)[:, None]
    along = size * (cos * outline[:, 0] - sin * outline[:, 1])
    aside = size * (sin * outline[:, 0] + cos * outline[:, 1])
    radius = (root + (tip - root) * share)[:, None] * np.ones_like(along)
    vertices = _around(depth, radius, azimuth + aside / radius, axial + along).reshape(-1, 3)
    n = len(outline)
    cap = np.stack([np.full(n - 2, 0), np.arange(1, n - 1), np.arange(2, n)], axis=1)
    last = (SPAN_STEPS - 1) * n
    return vertices, np.concatenate([grid_faces(SPAN_STEPS, n, closed=True), cap, cap[:, ::-1] + last])
