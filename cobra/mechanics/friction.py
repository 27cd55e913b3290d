"""Coulomb friction of the cables in the guiders' holes (S-36, S-37 with the errata): it never adds force.

The compiled law in `kernels/cables.py` says the same; this is its plain form.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


def transmission(bend_angles: ArrayLike, friction: float) -> Floats:
    """g (...,) = Π_j (1 − η sin(|θ_j|/2))² / (1 − η sin(|θ_n|/2)) from the chambers' angles (..., n) [rad] (S-37).

    The share of a pulled cable's force that arrives at the top guider: two hole edges a chamber, one at the last. It
    takes |θ|: printed with signed angles, friction would amplify for negative ones.
    """
    edges = 1.0 - friction * np.sin(0.5 * np.abs(np.asarray(bend_angles, dtype=np.float64)))
    return np.prod(edges**2, axis=-1) / edges[..., -1]


def tension_band(motor_N: ArrayLike, g: ArrayLike) -> tuple[Floats, Floats]:
    """Least and greatest tension at the top guider [N] that a motor's force can hold: F g while it pulls, F / g while it
    lets the cable out."""
    motor, share = np.asarray(motor_N, dtype=np.float64), np.asarray(g, dtype=np.float64)
    return motor * share, motor / share


def top_tension(
    before_N: ArrayLike, lengthened_m: ArrayLike, motor_N: ArrayLike, g: ArrayLike, stiffness_N_m: float
) -> Floats:
    """Tension at the top guider [N] after its end of the cable has moved out by `lengthened_m`.

    Standing still it keeps its value inside the band. A cable that begins to move first takes up its own elastic
    stretch (a Prandtl element), so that the force is continuous and nothing chatters at standstill.
    """
    low, high = tension_band(motor_N, g)
    return np.clip(np.asarray(before_N) + stiffness_N_m * np.asarray(lengthened_m), low, high)


def motor_band(top_N: ArrayLike, g: ArrayLike) -> tuple[Floats, Floats]:
    """Least and greatest motor force [N] that holds a tension at the top guider: F g, and F / g to pull it further in."""
    return tension_band(top_N, g)
