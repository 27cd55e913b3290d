# ruff: noqa: PLR0917 (kernels pass arrays, not objects)
"""Kinematics compiled for the control loop: one configuration a call, a few microseconds.

Same results as the NumPy reference (`section.py`, `backbone.py`, `tendons.py`), which stays as the tests' oracle.
All kernels stand in one file, because numba's cache on disk sees a change only in the file of the function it caches.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numba
import numpy as np

from cobra.description import RobotDescription
from cobra.kinematics.backbone import EXPOSURE_TOLERANCE_M
from cobra.kinematics.configuration import Configuration, Floats
from cobra.kinematics.tendons import TendonMap

SERIES_BELOW = 0.1


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile at the first call; kept on disk where there is a writable place for it."""
    try:
        return numba.njit(cache=True, fastmath=False)(function)
    except RuntimeError:  # numba: "no locator available", a read-only installation without a cache folder
        return numba.njit(fastmath=False)(function)


class Tick(NamedTuple):
    """What a control tick needs of the kinematics, in the port frame."""

    positions: Floats
    """(count, 3) evenly by arc length from the base of the active segment to the tip [m]."""
    rotations: Floats
    """(count, 3, 3)"""
    tip: Floats
    """(4, 4)"""
    jacobian: Floats
    """(6, size) as `Backbone.tip_jacobian`."""
    tendons: Floats
    """(tendons,) Δl [m] as `TendonMap.lengths`."""


class CompiledKinematics:
    """Backbone, tip Jacobian and tendon map of one robot in one call. Call `warm_up` at start, not while driving."""

    def __init__(self, description: RobotDescription, count: int = 61) -> None:
        configuration = Configuration(description)
        self.count = count
        self.rest = configuration.rest()
        self.layout = np.array(
            [
                (bend.start, -1 if at is None else at)
                for bend, at in zip(configuration.bends, configuration.lengths, strict=True)
            ],
            dtype=np.int64,
        )
        self.lengths_m = np.array([section.length_m for section in description.sections])
        self.active_length_m = description.active_length_m
        self.tendon_matrix = TendonMap(description).matrix.copy()

    def warm_up(self) -> None:
        """Compile (seconds the first time on a machine, then from the cache)."""
        self(self.rest)

    def __call__(self, q: Floats) -> Tick:
        """All of `Tick` at q (size,)."""
        # A copy: numba would compile anew, for seconds, for an array that is read-only or not contiguous.
        own = np.array(q, dtype=np.float64)
        return Tick(
            *_tick(own, self.rest, self.layout, self.lengths_m, self.active_length_m, self.tendon_matrix, self.count)
        )


@compiled
def coefficients(t2: float) -> tuple[float, float, float, float, float]:
    """S1, S2, S3, D1, D2 of `section.Coefficients`."""
    if t2 < SERIES_BELOW:
        # Horner's scheme of Σ (−t2)^k / (2k + 1)!, (2k + 2)!, (2k + 3)! and of the first two's derivatives.
        s1 = 1 - t2 / 6 * (1 - t2 / 20 * (1 - t2 / 42 * (1 - t2 / 72 * (1 - t2 / 110 * (1 - t2 / 156)))))
        s2 = 0.5 * (1 - t2 / 12 * (1 - t2 / 30 * (1 - t2 / 56 * (1 - t2 / 90 * (1 - t2 / 132 * (1 - t2 / 182))))))
        s3 = (1 - t2 / 20 * (1 - t2 / 42 * (1 - t2 / 72 * (1 - t2 / 110 * (1 - t2 / 156 * (1 - t2 / 210)))))) / 6
        d1 = -(1 - t2 / 10 * (1 - t2 / 28 * (1 - t2 / 54 * (1 - t2 / 88 * (1 - t2 / 130 * (1 - t2 / 180)))))) / 6
        d2 = -(1 - t2 / 15 * (1 - t2 * 3 / 112 * (1 - t2 * 2 / 135 * (1 - t2 * 5 / 528 * (1 - t2 * 3 / 455))))) / 24
        return s1, s2, s3, d1, d2
    theta = np.sqrt(t2)
    half = np.sin(0.5 * theta)
    cos = np.cos(theta)
    s1 = np.sin(theta) / theta
    s2 = 2.0 * half * half / t2
    return s1, s2, (1.0 - s1) / t2, 0.5 * (cos - s1) / t2, 0.5 * (s1 - 2.0 * s2) / t2


@compiled
def _place(q: Any, layout: Any, lengths_m: Any, active_length_m: float) -> Any:
    """Lengths, exposed lengths, bends (none inside the introducer), and the frames at base and section ends."""
    n = layout.shape[0]
    lengths, exposed, bends = np.empty(n), np.empty(n), np.empty((n, 2))
    R, p = np.zeros((n + 1, 3, 3)), np.zeros((n + 1, 3))
    c, s = np.cos(q[0]), np.sin(q[0])
    R[0, 0, 0], R[0, 0, 1], R[0, 1, 0], R[0, 1, 1], R[0, 2, 2] = c, -s, s, c, 1.0
    p[0, 2] = q[1] - active_length_m
    start = 0.0
    for i in range(n):
        at, at_length = layout[i]
        lengths[i] = lengths_m[i] if at_length < 0 else q[at_length]
        inside = max(active_length_m - q[1] - start, 0.0)
        if inside < EXPOSURE_TOLERANCE_M:
            inside = 0.0
        exposed[i] = lengths[i] - inside
        if exposed[i] < EXPOSURE_TOLERANCE_M:
            exposed[i] = 0.0
        outside = 1.0 if exposed[i] > 0.0 else 0.0
        bends[i, 0], bends[i, 1] = outside * q[at], outside * q[at + 1]
        start += lengths[i]
        _advance(R[i], p[i], bends[i, 0], bends[i, 1], lengths[i] - exposed[i], exposed[i], R[i + 1], p[i + 1])
    return lengths, exposed, bends, R, p


@compiled
def _advance(R: Any, p: Any, x: float, y: float, straight: float, arc: float, R_out: Any, p_out: Any) -> None:
    """Go along a straight piece and an arc of bend (x, y) from the frame (R, p) (C-1 … C-3)."""
    t2 = x * x + y * y
    s1, s2, _, _, _ = coefficients(t2)
    tx, ty, tz = arc * s2 * x, arc * s2 * y, straight + arc * s1
    xx, xy, yy, zz = 1.0 - s2 * x * x, -s2 * x * y, 1.0 - s2 * y * y, 1.0 - s2 * t2
    zx, zy = s1 * x, s1 * y
    for r in range(3):
        a, b, c = R[r, 0], R[r, 1], R[r, 2]
        p_out[r] = p[r] + a * tx + b * ty + c * tz
        R_out[r, 0] = a * xx + b * xy - c * zx
        R_out[r, 1] = a * xy + b * yy - c * zy
        R_out[r, 2] = a * zx + b * zy + c * zz


@compiled
def _turn(R: Any, v0: float, v1: float, v2: float) -> tuple[float, float, float]:
    return (
        R[0, 0] * v0 + R[0, 1] * v1 + R[0, 2] * v2,
        R[1, 0] * v0 + R[1, 1] * v1 + R[1, 2] * v2,
        R[2, 0] * v0 + R[2, 1] * v1 + R[2, 2] * v2,
    )


@compiled
def _jacobian(layout: Any, size: int, lengths: Any, exposed: Any, bends: Any, R: Any, p: Any) -> Any:
    """`Backbone.tip_jacobian`."""
    n = layout.shape[0]
    out = np.zeros((6, size))
    tip = p[n]
    out[0, 0], out[1, 0], out[5, 0], out[2, 1] = -tip[1], tip[0], 1.0, 1.0
    entering = -1
    for i in range(n):
        at, at_length = layout[i]
        x, y, length = bends[i, 0], bends[i, 1], exposed[i]
        s1, s2, s3, d1, d2 = coefficients(x * x + y * y)
        if length > 0.0:
            arm = tip - p[i + 1]
            w = (_turn(R[i], -s3 * x * y, 1.0 - s3 * y * y, -s2 * y), _turn(R[i], s3 * x * x - 1.0, s3 * x * y, s2 * x))
            cross = 2.0 * d2 * x * y
            v = (
                _turn(R[i], length * (s2 + 2.0 * d2 * x * x), length * cross, length * 2.0 * d1 * x),
                _turn(R[i], length * cross, length * (s2 + 2.0 * d2 * y * y), length * 2.0 * d1 * y),
            )
            for k in range(2):
                wx, wy, wz = w[k]
                out[0, at + k] = v[k][0] + wy * arm[2] - wz * arm[1]
                out[1, at + k] = v[k][1] + wz * arm[0] - wx * arm[2]
                out[2, at + k] = v[k][2] + wx * arm[1] - wy * arm[0]
                out[3, at + k], out[4, at + k], out[5, at + k] = wx, wy, wz
        along = _turn(R[i], s2 * x, s2 * y, s1)
        if 0.0 < length < lengths[i]:
            entering = i
            out[0, 1], out[1, 1], out[2, 1] = along
        if at_length >= 0:
            out[0, at_length], out[1, at_length], out[2, at_length] = along
    for i in range(entering):
        if layout[i, 1] >= 0:
            out[:3, layout[i, 1]] = out[:3, 1]
    return out


@compiled
def _points(lengths: Any, exposed: Any, bends: Any, R: Any, p: Any, count: int) -> Any:
    """`Backbone.points`."""
    n = lengths.shape[0]
    positions, rotations = np.empty((count, 3)), np.empty((count, 3, 3))
    spacing = lengths.sum() / (count - 1)
    i, start = 0, 0.0
    for k in range(count):
        s = k * spacing
        while i < n - 1 and s >= start + lengths[i]:
            start += lengths[i]
            i += 1
        inside = lengths[i] - exposed[i]
        along = min(s - start, lengths[i])
        arc = max(along - inside, 0.0)
        share = arc / exposed[i] if exposed[i] > 0.0 else 0.0
        _advance(
            R[i], p[i], share * bends[i, 0], share * bends[i, 1], min(along, inside), arc, rotations[k], positions[k]
        )
    return positions, rotations


@compiled
def _tick(q: Any, rest: Any, layout: Any, lengths_m: Any, active_length_m: float, matrix: Any, count: int) -> Any:
    lengths, exposed, bends, R, p = _place(q, layout, lengths_m, active_length_m)
    n = lengths.shape[0]
    positions, rotations = _points(lengths, exposed, bends, R, p, count)
    tip = np.eye(4)
    tip[:3, :3] = R[n]
    tip[:3, 3] = p[n]
    jacobian = _jacobian(layout, q.shape[0], lengths, exposed, bends, R, p)
    tendons = np.zeros(matrix.shape[0])
    for j in range(matrix.shape[0]):
        for k in range(q.shape[0]):
            tendons[j] += matrix[j, k] * (q[k] - rest[k])
    return positions, rotations, tip, jacobian, tendons
