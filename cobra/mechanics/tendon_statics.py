"""Equilibrium of sections in series under elastic tendons that can only pull, sample after sample.

Each section has a bend vector b_k and stores ½ K_k |b_k − b0_k|². Tendon t, wound in by w_t, is stretched by

    e_t = z_t + g_t w_t − c ln(1 + age/60 s) − Σ_{k ≤ end} l_tk(b_k),     T_t = k_t e_t (1 + h e_t) for e_t > 0, else 0
    l_tk = (1 − κ_k θ²) r e_tk·b_k + L_k κ_k θ² + δ_k(θ),    κ_k = 1/(24 m²),    δ_k = δ (√(θ² + ε²) − ε)

The first term of l is C-4; the others are the chords between m vertebrae and the tendons' play δ in their holes. So
slack, stretch against bending stiffness, and the load that distal tendons pass through proximal sections are one
minimum of energy. What depends on the past enters as elements that slip when overloaded (elastic-perfectly-plastic):
one in each section, and one for each tendon in each section it passes, which slips at the friction μ T of that tendon.
Each sample is the minimum of energy plus what the elements store, found by Newton's method (semi-smooth, with line
search) from the sample before. Sensitivities go along: implicit differentiation of each minimum, and the past through
the elements' states.

Between samples the tendons are taken to move evenly, in steps of at most `_STEP` radii. Lengths inside are in units of the
routing radius, moments in units of the first section's stiffness, so that tolerances mean the same for every robot.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cobra.mechanics.kernels.compiling import compiled

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

CREEP_TIME_S = 60.0
"""Tendons creep with the logarithm of time, counted in units of this."""
_STEP = 0.055
"""Longest move of a tendon [radii] between two minima."""
_MAX_STEPS = 12
_PRESLIDING = 3.0
"""Stiffness of a friction element before it slips, in K₁/r²: stiff beside the tendons, soft enough for Newton."""
_ROUNDING = 0.1
"""ε [rad]: where the tendons' play begins to act."""
_TOLERANCE = 1e-20
"""Newton decrement at which a minimum is reached [K₁]."""
_MAX_ITERATIONS = 30
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
    """(m, n, 2) r [cos α, sin α] of each tendon in each section it passes; 0 where it does not"""
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
    """(1,) the tip's clock is behind the tendons' by this [s]"""


class Drive(NamedTuple):
    """What moved the tendons, one row a sample."""

    wound: Floats
    """(N, m) wound in, in radii"""
    rate: Floats
    """(N, m) its rate [radii/s]; 0 where samples are too far apart to tell"""
    age: Floats
    """(N,) ln(1 + age/60 s)"""


def log_age(age_s: Floats) -> Floats:
    """ln(1 + age/60 s), 0 before the beginning."""
    return np.log1p(np.maximum(age_s, 0.0) / CREEP_TIME_S)


def solve(springs: Springs, drive: Drive, ends: Indices, *, slack: bool = True) -> Floats:
    """Bend vectors (N, 2n) [rad] of each sample. `ends` (m,) is the section in which each tendon ends.

    With `slack` False tendons push as well as they pull: the plain constant-curvature robot.
    """
    none = Springs(*(np.empty((0, *part.shape)) for part in springs))
    bends, _ = _march(springs, none, np.empty(0), drive, ends, slack)
    return bends


def solve_with_tangents(
    springs: Springs, changed: list[Springs], drive: Drive, ends: Indices, *, slack: bool = True
) -> tuple[Floats, Floats]:
    """Bends (N, 2n) and their derivatives (N, P, 2n) by P parameters.

    `changed[p]` are the springs with parameter p raised by `TANGENT_STEP`.
    """
    if not changed:
        bends = solve(springs, drive, ends, slack=slack)
        return bends, np.zeros((len(bends), 0, bends.shape[1]))
    stacked = Springs(*(np.ascontiguousarray(np.stack(parts)) for parts in zip(*changed, strict=True)))
    steps = np.full(len(changed), TANGENT_STEP)
    return _march(springs, stacked, steps, drive, ends, slack)


@compiled
def _tendon(s: Any, t: int, end: int, b: Any, l: Any, a: Any) -> None:
    """Lengths l (n,) of tendon t in the sections it passes and their gradients a (n, 2)."""
    for k in range(end + 1):
        x, y = b[2 * k], b[2 * k + 1]
        ex, ey = s.direction[t, k, 0], s.direction[t, k, 1]
        along = ex * x + ey * y
        theta2 = x * x + y * y
        root = np.sqrt(theta2 + _ROUNDING * _ROUNDING)
        straight = 1.0 - s.chord[k] * theta2
        l[k] = straight * along + s.length[k] * s.chord[k] * theta2 + s.play[0] * (root - _ROUNDING)
        common = 2.0 * s.chord[k] * (s.length[k] - along) + s.play[0] / root
        a[k, 0] = straight * ex + common * x
        a[k, 1] = straight * ey + common * y


@compiled
def _curvature(s: Any, t: int, k: int, b: Any, weight: float, H: Any) -> None:
    """Add weight · ∇² l_tk to the Hessian."""
    x, y = b[2 * k], b[2 * k + 1]
    ex, ey = s.direction[t, k, 0], s.direction[t, k, 1]
    root = np.sqrt(x * x + y * y + _ROUNDING * _ROUNDING)
    common = 2.0 * s.chord[k] * (s.length[k] - ex * x - ey * y) + s.play[0] / root
    bent = s.play[0] / root**3
    H[2 * k, 2 * k] += weight * (common - 4.0 * s.chord[k] * ex * x - bent * x * x)
    H[2 * k + 1, 2 * k + 1] += weight * (common - 4.0 * s.chord[k] * ey * y - bent * y * y)
    mixed = weight * (-2.0 * s.chord[k] * (ex * y + ey * x) - bent * x * y)
    H[2 * k, 2 * k + 1] += mixed
    H[2 * k + 1, 2 * k] += mixed


@compiled
def _stretch(s: Any, t: int, end: int, wound: Any, rate: Any, age: float, l: Any) -> float:
    e = s.zero[t] + s.gain[t] * (wound[t] - s.clock[0] * rate[t]) - s.creep[0] * age
    for k in range(end + 1):
        e -= l[k]
    return e


@compiled
def _energy(
    s: Any, ends: Any, slack: bool, b: Any, past: Any, wound: Any, rate: Any, age: float, g: Any, H: Any, curved: bool
) -> float:
    """Energy of a shape given the past; fills the gradient g (2n,) and, if `curved`, the Hessian H (2n, 2n)."""
    n = s.bending.shape[0]
    m = ends.shape[0]
    energy = 0.0
    g[:] = 0.0
    if curved:
        H[:] = 0.0
    for k in range(n):
        i, j = 2 * k, 2 * k + 1
        x, y = b[i] - s.rest[i], b[j] - s.rest[j]
        energy += 0.5 * s.bending[k] * (x * x + y * y)
        g[i] += s.bending[k] * x
        g[j] += s.bending[k] * y
        if curved:
            H[i, i] += s.bending[k]
            H[j, j] += s.bending[k]
        if s.slip_stiffness[k] <= 0.0:
            continue
        x, y = b[i] - past[i], b[j] - past[j]
        away = np.sqrt(x * x + y * y)
        reach = s.slip_moment[k] / s.slip_stiffness[k]
        if away <= reach:
            force = s.slip_stiffness[k]
            energy += 0.5 * force * away * away
            ux, uy = 0.0, 0.0
        else:
            force = s.slip_moment[k] / away
            energy += s.slip_moment[k] * (away - 0.5 * reach)
            ux, uy = x / away, y / away
        g[i] += force * x
        g[j] += force * y
        if curved:
            H[i, i] += force * (1.0 - ux * ux)
            H[j, j] += force * (1.0 - uy * uy)
            H[i, j] -= force * ux * uy
            H[j, i] -= force * ux * uy
    l, a = np.empty(n), np.empty((n, 2))
    pull, spring = np.empty(n), np.empty(n)
    for t in range(m):
        end = ends[t]
        _tendon(s, t, end, b, l, a)
        e = _stretch(s, t, end, wound, rate, age, l)
        tension, stiffness = 0.0, 0.0
        if e > 0.0 or not slack:
            h = s.hardening[t] if e > 0.0 else 0.0
            tension = s.stiffness[t] * e * (1.0 + h * e)
            stiffness = s.stiffness[t] * (1.0 + 2.0 * h * e)
            energy += s.stiffness[t] * e * e * (0.5 + h * e / 3.0)
        # The friction of section k acts on what slides through it: the tendon's length from there to its end.
        limit = s.friction[0] * past[2 * n + m * n + t]
        slide = 0.0
        for k in range(end, -1, -1):
            slide += l[k]
            pull[k], spring[k] = 0.0, 0.0
            if limit > 0.0:
                off = slide - past[2 * n + t * n + k]
                if abs(off) <= limit / _PRESLIDING:
                    pull[k], spring[k] = _PRESLIDING * off, _PRESLIDING
                    energy += 0.5 * _PRESLIDING * off * off
                else:
                    pull[k] = limit * np.sign(off)
                    energy += limit * (abs(off) - 0.5 * limit / _PRESLIDING)
        pull[0] -= tension
        spring[0] += stiffness
        for k in range(1, end + 1):
            pull[k] += pull[k - 1]
            spring[k] += spring[k - 1]
        for k in range(end + 1):
            g[2 * k] += pull[k] * a[k, 0]
            g[2 * k + 1] += pull[k] * a[k, 1]
            if curved:
                for other in range(end + 1):
                    shared = spring[min(k, other)]
                    for i in range(2):
                        for j in range(2):
                            H[2 * k + i, 2 * other + j] += shared * a[k, i] * a[other, j]
                _curvature(s, t, k, b, pull[k], H)
    return energy


@compiled
def _slip(s: Any, ends: Any, slack: bool, b: Any, past: Any, wound: Any, rate: Any, age: float, after: Any) -> None:
    """The elements' states after a minimum: those that were overloaded have slipped."""
    n = s.bending.shape[0]
    m = ends.shape[0]
    after[:] = past
    for k in range(n):
        if s.slip_stiffness[k] <= 0.0:
            continue
        i, j = 2 * k, 2 * k + 1
        x, y = b[i] - past[i], b[j] - past[j]
        away = np.sqrt(x * x + y * y)
        reach = s.slip_moment[k] / s.slip_stiffness[k]
        if away > reach:
            after[i] = b[i] - x / away * reach
            after[j] = b[j] - y / away * reach
    if s.friction[0] <= 0.0:
        return
    l, a = np.empty(n), np.empty((n, 2))
    for t in range(m):
        _tendon(s, t, ends[t], b, l, a)
        e = _stretch(s, t, ends[t], wound, rate, age, l)
        place = 2 * n + m * n + t
        reach = s.friction[0] * past[place] / _PRESLIDING
        slide = 0.0
        for k in range(ends[t], -1, -1):
            slide += l[k]
            off = slide - past[2 * n + t * n + k]
            if abs(off) > reach:
                after[2 * n + t * n + k] = slide - np.sign(off) * reach
        after[place] = s.stiffness[t] * e * (1.0 + s.hardening[t] * e) if e > 0.0 else 0.0


@compiled
def _factor(H: Any, L: Any) -> None:
    """Cholesky factor of H, its pivots held positive: play and chords make the energy slightly non-convex."""
    for i in range(H.shape[0]):
        for j in range(i + 1):
            value = H[i, j]
            for k in range(j):
                value -= L[i, k] * L[j, k]
            if i == j:
                L[i, i] = np.sqrt(max(value, 1e-9))
            else:
                L[i, j] = value / L[j, j]


@compiled
def _solve(L: Any, right: Any, x: Any) -> None:
    size = right.shape[0]
    for i in range(size):
        value = right[i]
        for k in range(i):
            value -= L[i, k] * x[k]
        x[i] = value / L[i, i]
    for i in range(size - 1, -1, -1):
        value = x[i]
        for k in range(i + 1, size):
            value -= L[k, i] * x[k]
        x[i] = value / L[i, i]


@compiled
def _settle(
    s: Any, ends: Any, slack: bool, b: Any, past: Any, wound: Any, rate: Any, age: float, g: Any, H: Any, L: Any
) -> None:
    """Move b into the minimum of energy; leaves its gradient in g and the factor of its Hessian in L."""
    step, trial, spare = np.empty_like(b), np.empty_like(b), np.empty_like(b)
    for _ in range(_MAX_ITERATIONS):
        energy = _energy(s, ends, slack, b, past, wound, rate, age, g, H, True)
        _factor(H, L)
        _solve(L, g, step)
        decrement = np.dot(g, step)
        if decrement < _TOLERANCE:
            break
        scale = 1.0
        for _halving in range(12):
            trial[:] = b - scale * step
            reached = _energy(s, ends, slack, trial, past, wound, rate, age, spare, H, False)
            if reached <= energy - 1e-4 * scale * decrement + 1e-15:
                break
            scale *= 0.5
        b[:] = trial


@compiled
def _pick(stack: Any, p: int) -> Any:
    return Springs(
        stack.rest[p],
        stack.bending[p],
        stack.slip_stiffness[p],
        stack.slip_moment[p],
        stack.length[p],
        stack.chord[p],
        stack.direction[p],
        stack.zero[p],
        stack.gain[p],
        stack.stiffness[p],
        stack.hardening[p],
        stack.play[p],
        stack.friction[p],
        stack.creep[p],
        stack.clock[p],
    )


@compiled
def _march(s: Any, stack: Any, steps: Any, drive: Any, ends: Any, slack: bool) -> Any:
    """All samples in order; with each the derivatives by the parameters whose raised springs are in `stack`."""
    n2 = s.rest.shape[0]
    n, m, samples, parameters = n2 // 2, ends.shape[0], drive.wound.shape[0], steps.shape[0]
    bends, tangents = np.zeros((samples, n2)), np.zeros((samples, parameters, n2))
    b = s.rest.copy()
    past = np.zeros(n2 + m * n + m)
    past[:n2] = s.rest
    after = past.copy()
    pasts = np.zeros((parameters, past.shape[0]))
    for p in range(parameters):
        pasts[p, :n2] = stack.rest[p]
    g, g_p, move = np.empty(n2), np.empty(n2), np.empty(n2)
    H, L = np.zeros((n2, n2)), np.zeros((n2, n2))
    for i in range(samples):
        before = max(i - 1, 0)
        longest = np.max(np.abs(drive.wound[i] - drive.wound[before]))
        count = min(max(int(np.ceil(longest / _STEP)), 1), _MAX_STEPS)
        for part in range(count):
            w = (part + 1) / count
            wound = (1.0 - w) * drive.wound[before] + w * drive.wound[i]
            rate = (1.0 - w) * drive.rate[before] + w * drive.rate[i]
            age = drive.age[i]
            _settle(s, ends, slack, b, past, wound, rate, age, g, H, L)
            if parameters:
                _energy(s, ends, slack, b, past, wound, rate, age, g, H, True)
                _factor(H, L)
            for p in range(parameters):
                raised = _pick(stack, p)
                _energy(raised, ends, slack, b, pasts[p], wound, rate, age, g_p, H, False)
                _solve(L, g_p - g, move)
                _slip(raised, ends, slack, b - move, pasts[p].copy(), wound, rate, age, pasts[p])
                if part == count - 1:
                    tangents[i, p] = -move / steps[p]
            _slip(s, ends, slack, b, past, wound, rate, age, after)
            past[:] = after
        bends[i] = b
    return bends, tangents
