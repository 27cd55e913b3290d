"""Surfaces of the 3D view: everything round is rings swept along frames. Shapes (n, 3) and (m, 3), metres, +z forward."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Indices = NDArray[np.uint32]
Profile = tuple[tuple[float, float], ...]
"""Corners (z, radius) of a solid of revolution, with its outside on the left (z to the right, radius up)."""

CREASE_RAD = 0.5
"""A corner that turns more is an edge, one that turns less is part of a rounding."""


def single(values: Floats) -> NDArray[np.float32]:
    """As viser sends geometry: single precision."""
    return values.astype(np.float32)


def unit_circle(sides: int) -> Floats:
    """(sides, 3) points of the unit circle about +z, from +x towards +y."""
    angle = np.linspace(0.0, 2.0 * np.pi, sides, endpoint=False)
    return np.stack([np.cos(angle), np.sin(angle), np.zeros(sides)], axis=-1)


def sweep(points: Floats, rotations: Floats, radii: Floats, circle: Floats) -> Floats:
    """Vertices of rings of `radii` (n,) in the x-y planes of the frames `rotations` (n, 3, 3) at `points` (n, 3).

    The frames carry the rings, so the surface does not twist about the backbone. Returns (n · sides, 3), ring by ring.
    """
    rings = np.einsum("nij,sj->nsi", rotations[:, :, :2], circle[:, :2]) * radii[:, None, None]
    return (points[:, None, :] + rings).reshape(-1, 3)


def sweep_faces(rings: int, sides: int) -> Indices:
    """Triangles (2 · (rings − 1) · sides, 3) between neighbouring rings, their outside away from the axis."""
    ring = np.arange(rings - 1)[:, None] * sides
    here, right = np.arange(sides)[None, :], np.roll(np.arange(sides), -1)[None, :]
    a, b, c, d = ring + here, ring + right, ring + sides + here, ring + sides + right
    return np.stack([np.stack([a, b, c], -1), np.stack([b, d, c], -1)], axis=2).reshape(-1, 3).astype(np.uint32)


def lathe(profile: Profile, sides: int) -> tuple[Floats, Indices]:
    """Vertices and faces of a solid of revolution about z: smooth, but crisp at every corner over `CREASE_RAD`.

    Browsers shade by vertex normals: a ring that stands twice shares no normal across the edge.
    """
    corners = np.asarray(profile, dtype=float)
    steps = np.diff(corners, axis=0)
    heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    crisp = np.concatenate([[False], np.abs(np.diff(heading)) > CREASE_RAD, [False]])
    z, radius = np.repeat(corners, 1 + crisp, axis=0).T
    points = np.stack([np.zeros_like(z), np.zeros_like(z), z], axis=-1)
    frames = np.broadcast_to(np.eye(3), (len(z), 3, 3))
    return sweep(points, frames, radius, unit_circle(sides)), sweep_faces(len(z), sides)


def quaternions(rotations: Floats) -> Floats:
    """Unit quaternions (n, 4), w first, of rotation matrices (n, 3, 3): the largest component first (Shepperd)."""
    trace = np.trace(rotations, axis1=-2, axis2=-1)
    diagonal = np.diagonal(rotations, axis1=-2, axis2=-1)
    # Four times the square of each component, less one: the largest is never near zero.
    squares = np.concatenate([trace[:, None], 2.0 * diagonal - trace[:, None]], axis=1) + 1.0
    products = np.empty((len(rotations), 4, 4))
    products[:, range(4), range(4)] = squares
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        products[:, 0, i + 1] = products[:, i + 1, 0] = rotations[:, k, j] - rotations[:, j, k]
        products[:, i + 1, j + 1] = products[:, j + 1, i + 1] = rotations[:, j, i] + rotations[:, i, j]
    rows = products[np.arange(len(rotations)), np.argmax(squares, axis=1)]
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)
