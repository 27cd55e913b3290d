"""The paper's own equations (`formulation="published"`): coordinates θ, φ, L of each segment in the printed frames.

What is kept and what is corrected: MODEL.md 4. Kept are the form S-9 … S-33 and its lever arms, which count every distal
moment once per guider; corrected are gravity as a vector, the guiders' inertia forces, signed moments, d_L, the rows of J_d,
and friction. There are no stops in it, and no conserved energy. Twist φ is a coordinate that bends in another plane, and
it has no meaning while the robot is straight.
"""

import numpy as np
from numpy.typing import ArrayLike

from cobra.mechanics.chain import Floats


def chain_coordinates(polar: ArrayLike) -> Floats:
    """q (..., n, 4) of the chain with the shape of (θ, φ, L) (..., n, 3) in printed frames Rz(φ) Ry(θ): b = θ [cos φ, sin φ]
    and ψ = φ (S-1 … S-7)."""
    polar = np.asarray(polar, dtype=np.float64)
    theta, phi, length = polar[..., 0], polar[..., 1], polar[..., 2]
    return np.stack([theta * np.cos(phi), theta * np.sin(phi), phi, length], axis=-1)


def polar_coordinates(q: ArrayLike) -> Floats:
    """(θ, φ, L) (n, 3) of a chain's configuration q (n, 4): the same guiders, turned about their axes as printed.

    θ is signed so that |φ| ≤ π/2; a straight chamber has φ = 0.
    """
    q = np.asarray(q, dtype=np.float64)
    out = np.zeros((len(q), 3))
    turned = 0.0
    for i, (x, y, psi, length) in enumerate(q):
        theta, phi = np.hypot(x, y), 0.0
        if theta > 0.0:
            phi = (np.arctan2(y, x) - turned + np.pi) % (2.0 * np.pi) - np.pi
        if abs(phi) > 0.5 * np.pi:
            theta, phi = -theta, phi - np.copysign(np.pi, phi)
        out[i] = theta, phi, length
        turned += phi - psi
    return out
