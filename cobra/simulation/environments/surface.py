"""An environment is a surface of triangles; how far a point is from it."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from cobra.errors import OperatorError

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

closest_point: Any = trimesh.triangles.closest_point

SAMPLE_SPACING_M = 0.004
"""Between the places by which the triangles near a point are found."""
MAX_SAMPLES = 200_000
CANDIDATES = 12
"""Nearest samples whose triangles are measured exactly."""


class WallsError(OperatorError):
    """An environment that cannot be used. The message says what was given, what is wrong, and what would be right."""


@dataclass(frozen=True)
class Environment:
    """Walls around the robot, in the frame of the entry port."""

    name: str
    title: str
    vertices: Floats
    """(n, 3) [m]"""
    faces: Indices
    """(m, 3) corners of the triangles. Contact is two-sided."""
    solid_from: int | None = None
    """For the eye: triangles from this one on are drawn solid, those before can be seen through; None is all of them."""

    def distance(self, points: Floats) -> tuple[Floats, Floats]:
        """Distance (k,) [m] of points (k, 3) from the surface, and the nearest places on it (k, 3).

        Exact, but for triangles further than the nearest dozen samples: then within a sample's spacing squared.
        """
        samples, owner = self._samples
        _, near = samples.query(points, k=min(CANDIDATES, samples.n))
        owners = owner[near.reshape(len(points), -1)]
        corners = self.vertices[self.faces[owners]].reshape(-1, 3, 3)
        repeated = np.repeat(points, owners.shape[1], axis=0)
        places = closest_point(corners, repeated).reshape(len(points), -1, 3)
        distances = np.linalg.norm(places - points[:, None, :], axis=2)
        best = np.argmin(distances, axis=1)
        rows = np.arange(len(points))
        return distances[rows, best], places[rows, best]

    @cached_property
    def _samples(self) -> tuple[Any, Indices]:
        """Places spread evenly over the triangles, as a tree, and the triangle of each."""
        corners = self.vertices[self.faces]
        sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
        spacing = SAMPLE_SPACING_M
        while (steps := np.maximum(1, np.ceil(sides / spacing)).astype(int)) @ steps > 2 * MAX_SAMPLES:
            spacing *= 2.0
        places, owners = [], []
        for n in np.unique(steps):
            own = np.flatnonzero(steps == n)
            i, j = np.divmod(np.arange((n + 1) ** 2), n + 1)
            inside = i + j <= n
            weights = np.stack([n - i - j, i, j], axis=1)[inside] / n
            places.append(np.einsum("wc,fcx->fwx", weights, corners[own]).reshape(-1, 3))
            owners.append(np.repeat(own, len(weights)))
        return cKDTree(np.concatenate(places)), np.concatenate(owners)


def grid_faces(rows: int, columns: int, closed: bool = False) -> Indices:
    """Triangles of a grid of vertices, row by row; `closed` joins its last column to its first."""
    steps = columns if closed else columns - 1
    row, column = np.divmod(np.arange((rows - 1) * steps), steps)
    right = (column + 1) % columns
    a, b = row * columns + column, row * columns + right
    c, d = a + columns, b + columns
    return np.concatenate([np.stack([a, b, c], axis=1), np.stack([b, d, c], axis=1)]).astype(np.int64)


def joined(parts: list[tuple[Floats, Indices]]) -> tuple[Floats, Indices]:
    """Several surfaces as one."""
    offsets = np.cumsum([0, *(len(vertices) for vertices, _ in parts[:-1])])
    vertices = np.concatenate([vertices for vertices, _ in parts])
    return vertices, np.concatenate([faces + offset for (_, faces), offset in zip(parts, offsets, strict=True)])
