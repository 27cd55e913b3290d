"""What the kernels' arrays hold, by column."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

# State, one row a segment: coordinates (b_x, b_y, ψ, L), their rates, the accelerations of the step before, whether bend
# and twist are caught in the slots, whether the guiders touch.
Q, V, A, LOCKED, STOPPED = 0, 4, 8, 12, 13
STATE_COLUMNS = 14

# State, one column a cable: tension at the top guider and length, both in the middle of the step before [N, m].
TENSION, LENGTH = 0, 1

# Scratch, one row a segment.
MIDDLE, RATE = 0, 4
"""q and q̇ in the middle of the step."""
HELD = 8
"""1 at coordinates that a lock or a stop holds."""
LOAD = 12
"""External force on the guider [N]."""
ARM, OMEGA, BIAS = 15, 18, 21
"""From the guider before; angular velocity; accelerations (ω̇, v̇) from velocity products. World axes."""
S = 27
"""Four six-vectors (ω, v): the guider's velocity per rate of b_x, b_y, ψ, L."""
U, INVERSE = 51, 75
"""Articulated inertia times S; 1 / (Sᵀ U) of each coordinate."""
SINE = 79
"""sin(|θ|/2)"""
PUSH = 80
"""Four coordinates times (1 + cables): forces left for the coordinate; then as many accelerations; then the stop's."""

FORCES, LENGTHS, MOTION = 0, 1, 2
"""What a cable command means: motor forces [N], cable lengths [m], or a motion to be followed (lengths, rates, …)."""

FINE, NOT_FINITE, BENT, TWISTED, STRETCHED, STUCK = 0, 1, 2, 3, 4, 5
"""Verdicts on a step."""
LARGEST_BEND_RAD = np.pi
LARGEST_TWIST_RAD = np.pi
LARGEST_STRETCH = 3.0
"""A chamber beyond these (the last in rest lengths) is no chamber any more: the step has blown up."""
SMALLEST_STEP_S = 1e-9
"""Also the duration of an impact."""


class Constants(NamedTuple):
    """Numbers of one robot as the kernels take them (SI units)."""

    bending: float
    """EI / L₀ [N·m/rad]"""
    torsion: float
    """GA / L₀ [N·m/rad]"""
    axial: float
    """K [N/m]"""
    rest: float
    """L₀ [m]"""
    mass: float
    inertia_bend: float
    inertia_twist: float
    damping_bend: float
    damping_twist: float
    damping_axial: float
    cable_stiffness: float
    friction: float
    locked: float
    unlocked: float
    lock_bend: float
    """A chamber bent more than this does not lock [rad]."""
    follow: float
    """ω of the error dynamics when a motion is followed [rad/s]."""
    gravity_x: float
    gravity_y: float
    gravity_z: float


def scratch_columns(cables: int) -> int:
    return PUSH + 9 * (1 + cables)
