"""One section of constant curvature in its bend vector b = θ [cos φ, sin φ] (C-1 … C-3).

The polar pair (φ, θ) is singular when straight; b is not. Everything is a function of θ² = b·b that is smooth through
straight and beyond π. All functions broadcast over leading dimensions and accept complex numbers (for complex steps).
"""

from math import factorial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

Numbers = NDArray[Any]

SERIES_BELOW = 0.1
"""θ² under which the series is used: θ about 0.3 rad."""
_TERMS = 8
"""Terms of the series: the first one left out is under 1e-17 at `SERIES_BELOW`."""
_POWERS = np.arange(_TERMS)
_SERIES = np.array([[(-1.0) ** k / factorial(2 * k + odd) for odd in (1, 2, 3)] for k in range(_TERMS)])
_SLOPES = np.vstack([_SERIES[1:, :2] * _POWERS[1:, None], np.zeros((1, 2))])
_TABLE = np.hstack([_SERIES, _SLOPES])
"""(terms, 5): the power series in θ² of S1, S2, S3, D1, D2."""


class Coefficients(NamedTuple):
    """S1 = sin θ/θ, S2 = 2 sin²(θ/2)/θ², S3 = (1 − S1)/θ², and D1, D2 the derivatives of S1 and S2 by θ²."""

    S1: Numbers
    S2: Numbers
    S3: Numbers
    D1: Numbers
    D2: Numbers


class SectionJacobian(NamedTuple):
    """Derivatives of a section's end in the frame of its base."""

    translation: Numbers
    """(..., 3, 3): ∂t/∂(b_x, b_y, ℓ) [m/rad, m/rad, 1]."""
    rotation: Numbers
    """(..., 3, 2): ω/∂(b_x, b_y), the angular velocity per rate of b; the length does not turn the end."""


def coefficients(theta2: ArrayLike) -> Coefficients:
    """The functions of θ² from which a section is made, to rounding error from straight to beyond π."""
    t2 = np.asarray(theta2)
    small = t2.real < SERIES_BELOW
    out = np.empty((*t2.shape, 5), dtype=np.result_type(t2, np.float64))
    out[small] = t2[small][:, None] ** _POWERS @ _TABLE
    out[~small] = _closed(t2[~small])
    return Coefficients(*np.moveaxis(out, -1, 0))


def translation(bend: ArrayLike, length_m: ArrayLike) -> Numbers:
    """End of a section in the frame of its base, t = ℓ [S2 b_x, S2 b_y, S1] (C-3): (..., 3) [m] from b (..., 2)."""
    b = np.asarray(bend)
    c = coefficients(_square(b))
    unit = np.stack([c.S2 * b[..., 0], c.S2 * b[..., 1], c.S1], axis=-1)
    return np.asarray(length_m)[..., None] * unit


def rotation(bend: ArrayLike) -> Numbers:
    """Rz(φ) Ry(θ) Rz(−φ) (C-2), which leaves no twist behind: (..., 3, 3) from b (..., 2) [rad]."""
    b = np.asarray(bend)
    x, y = b[..., 0], b[..., 1]
    t2 = _square(b)
    c = coefficients(t2)
    return _matrix(
        (1.0 - c.S2 * x * x, -c.S2 * x * y, c.S1 * x),
        (-c.S2 * x * y, 1.0 - c.S2 * y * y, c.S1 * y),
        (-c.S1 * x, -c.S1 * y, 1.0 - c.S2 * t2),
    )


def transform(bend: ArrayLike, length_m: ArrayLike) -> Numbers:
    """The section's end as a homogeneous transform (C-1): (..., 4, 4)."""
    t = translation(bend, length_m)
    out = np.zeros((*t.shape[:-1], 4, 4), dtype=t.dtype)
    out[..., :3, :3] = rotation(bend)
    out[..., :3, 3] = t
    out[..., 3, 3] = 1.0
    return out


def jacobian(bend: ArrayLike, length_m: ArrayLike) -> SectionJacobian:
    """Exact derivatives of C-2 and C-3 by b and ℓ.

    ∂t/∂b_x = ℓ [S2 + 2 D2 b_x², 2 D2 b_x b_y, 2 D1 b_x], ∂t/∂ℓ = [S2 b, S1]; ω = J_l(b) [−ḃ_y, ḃ_x, 0] with the left
    Jacobian of SO(3), J_l = I + S2 [w]× + S3 [w]×², w = (−b_y, b_x, 0).
    """
    b = np.asarray(bend)
    length = np.asarray(length_m)
    x, y = b[..., 0], b[..., 1]
    c = coefficients(_square(b))
    cross = 2.0 * c.D2 * x * y
    moved = _matrix(
        (length * (c.S2 + 2.0 * c.D2 * x * x), length * cross, c.S2 * x),
        (length * cross, length * (c.S2 + 2.0 * c.D2 * y * y), c.S2 * y),
        (length * 2.0 * c.D1 * x, length * 2.0 * c.D1 * y, c.S1),
    )
    turned = _matrix(
        (-c.S3 * x * y, c.S3 * x * x - 1.0),
        (1.0 - c.S3 * y * y, c.S3 * x * y),
        (-c.S2 * y, c.S2 * x),
    )
    return SectionJacobian(moved, turned)


def printed_rotation_src_bot(direction_rad: float, angle_rad: float) -> NDArray[np.float64]:
    """Rz(φ) Ry(θ) as SRC-Bot's S-2 prints it (3, 3), for comparison only.

    Without Rz(−φ) the direction of bending turns everything that follows about the backbone, so that a bend in one
    plane needs φ in its first segment and 0 in all others.
    """
    cp, sp = np.cos(direction_rad), np.sin(direction_rad)
    ct, st = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[cp * ct, -sp, cp * st], [sp * ct, cp, sp * st], [-st, 0.0, ct]])


def _square(b: Numbers) -> Numbers:
    return b[..., 0] * b[..., 0] + b[..., 1] * b[..., 1]


def _closed(t2: Numbers) -> Numbers:
    theta = np.sqrt(t2)
    s1 = np.sin(theta) / theta
    s2 = 2.0 * (np.sin(0.5 * theta) / theta) ** 2  # not (1 − cos θ)/θ², which loses digits
    s3 = (1.0 - s1) / t2
    d1 = (np.cos(theta) - s1) / (2.0 * t2)
    d2 = (s1 - 2.0 * s2) / (2.0 * t2)
    return np.stack([s1, s2, s3, d1, d2], axis=-1)


def _matrix(*rows: tuple[Numbers, ...]) -> Numbers:
    return np.stack([np.stack(np.broadcast_arrays(*row), axis=-1) for row in rows], axis=-2)
