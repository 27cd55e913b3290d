"""Equilibrium of sections in series under elastic tendons that can only pull, sample after sample.

Each section has a bend vector b_k and stores ½ K_k |b_k − b0_k|². Tendon t, wound in by w_t, is stretched by

    e_t = z_t + g_t (w_t − τ ẇ_t) − c ln(1 + age/60 s) − Σ_{k ≤ end} l_tk(b_k)
    T_t = k_t e_t (1 + h e_t) for e_t > 0, else 0
    l_tk = (1 − κ_k θ²) r e_tk·b_k + L_k κ_k θ² + δ (√(θ² + ε²) − ε),    κ_k = 1/(24 v²)

The first term of l is C-4; the others are the chords between v vertebrae and the tendons' play δ in their holes. So slack,
stretch against bending stiffness, and the load that distal tendons pass on through proximal sections are one minimum of
energy. What depends on the past are elements that slip when overloaded (elastic, perfectly plastic): one in each section,
and one for each tendon in each section that it passes, which slips at the friction μ T_t. Each sample is the minimum of
energy plus what the elements store, found by a semi-smooth Newton method from the sample before. Sensitivities go along:
each minimum is differentiated implicitly, the past through the elements' states.

Between samples the tendons are taken to move evenly. Lengths are in units of the routing radius and moments in units of
the first section's stiffness, so that tolerances mean the same for every robot.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cobra.mechanics.tendon_kernels import Layout, march

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

CREEP_TIME_S = 60.0
"""Tendons creep with the logarithm of time, counted in units of this."""
TANGENT_STEP = 1e-6
"""By how much a parameter is raised to see what it changes."""


class Springs(NamedTuple):
    """A robot of n sections and m tendons, in units of the routing radius r and the first section's K₁ [N·m/rad]."""

    rest: Floats
    """(2n,) b0 [rad]"""
    bending: Floats
    """(n,) K"""
    slip_stiffness: Floats
    """(n,) of the sections' slip elements; 0 for none"""
    slip_moment: Floats
    """(n,) at which they slip"""
    length: Floats
    """(n,) L"""
    chord: Floats
    """(n,) κ"""
    direction: Floats
    """(m, n, 2) r [cos α, sin α] of each tendon in each section that it passes; 0 where it does not"""
    zero: Floats
    """(m,) z, wound in beyond just taut on the straight robot"""
    gain: Floats
    """(m,) g"""
    stiffness: Floats
    """(m,) k"""
    hardening: Floats
    """(m,) h"""
    play: Floats
    """(1,) δ"""
    friction: Floats
    """(1,) μ"""
    creep: Floats
    """(1,) c"""
    clock: Floats
    """(1,) τ [s]: the tip was measured this long before the tendons"""

    def flat(self) -> Floats:
        """All numbers in one vector."""
        return np.concatenate([np.ravel(part) for part in self])

    def layout(self) -> Layout:
        """Where each part begins in `flat`."""
        starts = np.cumsum([0, *(np.size(part) for part in self)])
        return Layout(len(self.bending), len(self.zero), *(int(start) for start in starts[:-1]))


class Drive(NamedTuple):
    """What moved the tendons, one row a sample."""

    wound: Floats
    """(N, m) wound in [radii]"""
    rate: Floats
    """(N, m) its rate [radii/s]; 0 where samples are too far apart to tell"""
    age: Floats
    """(N,) ln(1 + age/60 s)"""


def log_age(age_s: Floats) -> Floats:
    """ln(1 + age/60 s); 0 before the beginning."""
    return np.log1p(np.maximum(age_s, 0.0) / CREEP_TIME_S)


def solve(springs: Springs, drive: Drive, ends: Indices, *, slack: bool = True) -> Floats:
    """Bend vectors (N, 2n) [rad] of each sample. `ends` (m,) is the section in which each tendon ends.

    With `slack` False tendons push as well as they pull.
    """
    return solve_with_tangents(springs, [], drive, ends, slack=slack)[0]


def solve_with_tangents(
    springs: Springs, raised: list[Springs], drive: Drive, ends: Indices, *, slack: bool = True
) -> tuple[Floats, Floats]:
    """Bends (N, 2n) and their derivatives (N, P, 2n) by P parameters.

    `raised[p]` are the springs with parameter p raised by `TANGENT_STEP`.
    """
    flat = springs.flat()
    stack = np.array([other.flat() for other in raised]).reshape(len(raised), flat.size)
    steps = np.full(len(raised), TANGENT_STEP)
    wound, rate, age = (np.ascontiguousarray(part, dtype=np.float64) for part in drive)
    bends, tangents = march(flat, stack, steps, springs.layout(), ends, slack, wound, rate, age)
    return bends, tangents
