"""The compiled half of `tendon_statics.py`: energy of a shape, its minimum, and the march through the samples.

The kernels know one flat vector of numbers `c` (`Springs.flat`) and where each part begins in it (`Layout`): arrays inside
tuples would cost numba a reference count at every use. All kernels stand in this file, because numba's cache on disk sees
a change only in the file of the function it caches.

Shapes: n sections; m tendons; b (2n,) bend vectors. `past` (2n + m n + m,) is what the elements remember: the anchor of
each section's slip element, the anchor of each tendon's in each section, and each tendon's last tension.
"""

from typing import Any, NamedTuple

import numba
import numpy as np

from cobra.kinematics.kernels import compiled

STEP = 0.055
"""Longest move of a tendon [radii] between two minima."""
MAX_STEPS = 12
PRESLIDING = 3.0
"""Stiffness of a tendon's slip element, in K₁/r²: stiff beside the tendons, soft enough for Newton."""
ROUNDING = 0.3
"""ε [rad]: where the tendons' play begins to act."""
TOLERANCE = 1e-20
"""Newton decrement at which a minimum is reached [K₁]."""
MAX_ITERATIONS = 30
HALVINGS = 12
EDGE = 1.0 + 1e-9
"""An element that has just slipped stands at its limit to rounding error, and holds there: it is elastic."""
LEAST_PIVOT = 0.02
"""Play and chords make the energy slightly non-convex where tendons push a straight robot."""


LENGTH, PULL, SPRING, GRADIENT_X, GRADIENT_Y = range(5)
"""Rows of `room` (5, n), the scratch of one tendon in each section."""


_OPTIONS: dict[str, Any] = {"error_model": "numpy", "no_cpython_wrapper": True, "no_cfunc_wrapper": True}
_inlined = numba.njit(forceinline=True, **_OPTIONS)
"""Small kernels with many arguments, whose calls would cost more than their arithmetic."""
_inner = numba.njit(**_OPTIONS)


class Layout(NamedTuple):
    """Numbers of sections and tendons, and where each part of `Springs` begins in its flat vector."""

    sections: int
    tendons: int
    rest: int
    bending: int
    slip_stiffness: int
    slip_moment: int
    length: int
    chord: int
    direction: int
    zero: int
    gain: int
    stiffness: int
    hardening: int
    play: int
    friction: int
    creep: int
    clock: int


@_inlined
def _tendon(c: Any, at: Any, t: int, end: int, b: Any, room: Any) -> None:
    """Length of tendon t in each section that it passes, and its gradient."""
    for k in range(end + 1):
        x, y = b[2 * k], b[2 * k + 1]
        e = at.direction + 2 * (t * at.sections + k)
        chord = c[at.chord + k]
        along = c[e] * x + c[e + 1] * y
        theta2 = x * x + y * y
        root = np.sqrt(theta2 + ROUNDING * ROUNDING)
        straight = 1.0 - chord * theta2
        room[LENGTH, k] = straight * along + c[at.length + k] * chord * theta2 + c[at.play] * (root - ROUNDING)
        common = 2.0 * chord * (c[at.length + k] - along) + c[at.play] / root
        room[GRADIENT_X, k] = straight * c[e] + common * x
        room[GRADIENT_Y, k] = straight * c[e + 1] + common * y


@_inlined
def _curvature(c: Any, at: Any, t: int, k: int, b: Any, weight: float, H: Any) -> None:
    """Add weight · ∇² of the tendon's length in section k to the Hessian."""
    x, y = b[2 * k], b[2 * k + 1]
    e = at.direction + 2 * (t * at.sections + k)
    chord = c[at.chord + k]
    root = np.sqrt(x * x + y * y + ROUNDING * ROUNDING)
    common = 2.0 * chord * (c[at.length + k] - c[e] * x - c[e + 1] * y) + c[at.play] / root
    bent = c[at.play] / root**3
    H[2 * k, 2 * k] += weight * (common - 4.0 * chord * c[e] * x - bent * x * x)
    H[2 * k + 1, 2 * k + 1] += weight * (common - 4.0 * chord * c[e + 1] * y - bent * y * y)
    mixed = weight * (-2.0 * chord * (c[e] * y + c[e + 1] * x) - bent * x * y)
    H[2 * k, 2 * k + 1] += mixed
    H[2 * k + 1, 2 * k] += mixed


@_inlined
def _stretch(c: Any, at: Any, t: int, end: int, wound: Any, rate: Any, age: float, room: Any) -> float:
    """e_t: by how much tendon t is longer than when just taut."""
    e = c[at.zero + t] + c[at.gain + t] * (wound[t] - c[at.clock] * rate[t]) - c[at.creep] * age
    for k in range(end + 1):
        e -= room[LENGTH, k]
    return e


@_inlined
def _bend_sections(c: Any, at: Any, b: Any, past: Any, g: Any, H: Any, curved: bool) -> float:
    """Energy of the sections' springs and slip elements; adds to gradient and Hessian."""
    energy = 0.0
    for k in range(at.sections):
        i, j = 2 * k, 2 * k + 1
        bending, stiffness = c[at.bending + k], c[at.slip_stiffness + k]
        x, y = b[i] - c[at.rest + i], b[j] - c[at.rest + j]
        energy += 0.5 * bending * (x * x + y * y)
        g[i] += bending * x
        g[j] += bending * y
        if curved:
            H[i, i] += bending
            H[j, j] += bending
        if stiffness <= 0.0:
            continue
        x, y = b[i] - past[i], b[j] - past[j]
        away = np.sqrt(x * x + y * y)
        reach = c[at.slip_moment + k] / stiffness
        force, ux, uy = stiffness, 0.0, 0.0
        if away <= reach * EDGE:
            energy += 0.5 * stiffness * away * away
        else:
            force, ux, uy = c[at.slip_moment + k] / away, x / away, y / away
            energy += c[at.slip_moment + k] * (away - 0.5 * reach)
        g[i] += force * x
        g[j] += force * y
        if curved:
            H[i, i] += force * (1.0 - ux * ux)
            H[j, j] += force * (1.0 - uy * uy)
            H[i, j] -= force * ux * uy
            H[j, i] -= force * ux * uy
    return energy


@_inlined
def _pull_tendon(c: Any, at: Any, t: int, end: int, e: float, slack: bool, past: Any, room: Any) -> float:
    """Energy of one tendon; PULL becomes −tension in each section, SPRING the stiffness that acts there.

    The friction of section k acts on what slides through it, the tendon's length from there to its end; so tension falls
    from section to section.
    """
    n, m = at.sections, at.tendons
    energy = 0.0
    limit = c[at.friction] * past[2 * n + m * n + t]
    slide = 0.0
    for k in range(end, -1, -1):
        slide += room[LENGTH, k]
        room[PULL, k], room[SPRING, k] = 0.0, 0.0
        if limit > 0.0:
            off = slide - past[2 * n + t * n + k]
            if abs(off) <= limit / PRESLIDING * EDGE:
                room[PULL, k], room[SPRING, k] = PRESLIDING * off, PRESLIDING
                energy += 0.5 * PRESLIDING * off * off
            else:
                room[PULL, k] = limit * np.sign(off)
                energy += limit * (abs(off) - 0.5 * limit / PRESLIDING)
    if e > 0.0 or not slack:
        stiffness = c[at.stiffness + t]
        h = c[at.hardening + t] if e > 0.0 else 0.0
        room[PULL, 0] -= stiffness * e * (1.0 + h * e)
        room[SPRING, 0] += stiffness * (1.0 + 2.0 * h * e)
        energy += stiffness * e * e * (0.5 + h * e / 3.0)
    for k in range(1, end + 1):
        room[PULL, k] += room[PULL, k - 1]
        room[SPRING, k] += room[SPRING, k - 1]
    return energy


@_inner
def _energy(
    c: Any,
    at: Any,
    ends: Any,
    slack: bool,
    b: Any,
    past: Any,
    wound: Any,
    rate: Any,
    age: float,
    g: Any,
    H: Any,
    curved: bool,
    room: Any,
) -> float:
    """Energy of a shape given the past; fills the gradient g (2n,) and, if `curved`, the Hessian H (2n, 2n)."""
    g[:] = 0.0
    if curved:
        H[:] = 0.0
    energy = _bend_sections(c, at, b, past, g, H, curved)
    for t in range(at.tendons):
        end = ends[t]
        _tendon(c, at, t, end, b, room)
        e = _stretch(c, at, t, end, wound, rate, age, room)
        energy += _pull_tendon(c, at, t, end, e, slack, past, room)
        for k in range(end + 1):
            g[2 * k] += room[PULL, k] * room[GRADIENT_X, k]
            g[2 * k + 1] += room[PULL, k] * room[GRADIENT_Y, k]
            if curved and room[SPRING, k] > 0.0:
                for other in range(end + 1):
                    shared = room[SPRING, min(k, other)]
                    H[2 * k, 2 * other] += shared * room[GRADIENT_X, k] * room[GRADIENT_X, other]
                    H[2 * k, 2 * other + 1] += shared * room[GRADIENT_X, k] * room[GRADIENT_Y, other]
                    H[2 * k + 1, 2 * other] += shared * room[GRADIENT_Y, k] * room[GRADIENT_X, other]
                    H[2 * k + 1, 2 * other + 1] += shared * room[GRADIENT_Y, k] * room[GRADIENT_Y, other]
            if curved and room[PULL, k] != 0.0:
                _curvature(c, at, t, k, b, room[PULL, k], H)
    return energy


@_inlined
def _slip(c: Any, at: Any, ends: Any, b: Any, past: Any, wound: Any, rate: Any, age: float, room: Any) -> None:
    """Let the elements that are overloaded at a minimum slip, in place."""
    n, m = at.sections, at.tendons
    for k in range(n):
        stiffness = c[at.slip_stiffness + k]
        if stiffness <= 0.0:
            continue
        i, j = 2 * k, 2 * k + 1
        x, y = b[i] - past[i], b[j] - past[j]
        away = np.sqrt(x * x + y * y)
        reach = c[at.slip_moment + k] / stiffness
        if away > reach:
            past[i] = b[i] - x / away * reach
            past[j] = b[j] - y / away * reach
    if c[at.friction] <= 0.0:
        return
    for t in range(m):
        _tendon(c, at, t, ends[t], b, room)
        e = _stretch(c, at, t, ends[t], wound, rate, age, room)
        last = 2 * n + m * n + t
        reach = c[at.friction] * past[last] / PRESLIDING
        slide = 0.0
        for k in range(ends[t], -1, -1):
            slide += room[LENGTH, k]
            anchor = 2 * n + t * n + k
            off = slide - past[anchor]
            if abs(off) > reach:
                past[anchor] = slide - np.sign(off) * reach
        past[last] = c[at.stiffness + t] * e * (1.0 + c[at.hardening + t] * e) if e > 0.0 else 0.0


@_inlined
def _factor(H: Any, L: Any) -> None:
    """Cholesky factor of H, its pivots held positive."""
    for i in range(H.shape[0]):
        for j in range(i + 1):
            value = H[i, j]
            for k in range(j):
                value -= L[i, k] * L[j, k]
            if i == j:
                L[i, i] = np.sqrt(max(value, LEAST_PIVOT))
            else:
                L[i, j] = value / L[j, j]


@_inlined
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


@_inner
def _settle(
    c: Any,
    at: Any,
    ends: Any,
    slack: bool,
    b: Any,
    past: Any,
    wound: Any,
    rate: Any,
    age: float,
    g: Any,
    H: Any,
    L: Any,
    room: Any,
) -> None:
    """Move b into the minimum of energy."""
    step, trial, spare = np.empty_like(b), np.empty_like(b), np.empty_like(b)
    for _ in range(MAX_ITERATIONS):
        energy = _energy(c, at, ends, slack, b, past, wound, rate, age, g, H, True, room)
        _factor(H, L)
        _solve(L, g, step)
        decrement = 0.0
        for i in range(b.shape[0]):
            decrement += g[i] * step[i]
        if decrement < TOLERANCE:
            break
        scale = 1.0
        for _halving in range(HALVINGS):
            trial[:] = b - scale * step
            reached = _energy(c, at, ends, slack, trial, past, wound, rate, age, spare, H, False, room)
            if reached <= energy - 1e-4 * scale * decrement + 1e-15:
                break
            scale *= 0.5
        else:
            break
        b[:] = trial


@compiled
def march(
    c: Any, raised: Any, steps: Any, at: Any, ends: Any, slack: bool, wound: Any, rate: Any, age: Any
) -> tuple[Any, Any]:
    """Bends (N, 2n) of all samples in order, and their derivatives (N, P, 2n).

    `raised` (P, size of c) has parameter p raised by steps[p]. Each minimum g(b, past, c) = 0 is differentiated
    implicitly, db = −H⁻¹ (∂g/∂past · dpast + ∂g/∂c · dc), with the bracket as a finite difference; the raised past goes along.
    """
    n2 = 2 * at.sections
    samples, parameters = wound.shape[0], steps.shape[0]
    bends, tangents = np.zeros((samples, n2)), np.zeros((samples, parameters, n2))
    room = np.empty((5, at.sections))
    b = c[at.rest : at.rest + n2].copy()
    past = np.zeros(n2 + at.tendons * at.sections + at.tendons)
    past[:n2] = b
    pasts = np.zeros((parameters, past.shape[0]))
    for p in range(parameters):
        pasts[p, :n2] = raised[p, at.rest : at.rest + n2]
    g, g_p, move = np.empty(n2), np.empty(n2), np.empty(n2)
    H, L = np.zeros((n2, n2)), np.zeros((n2, n2))
    remembers = c[at.friction] > 0.0
    for k in range(at.sections):
        remembers |= c[at.slip_stiffness + k] > 0.0
    now, speed = np.empty(at.tendons), np.empty(at.tendons)
    for i in range(samples):
        before = max(i - 1, 0)
        longest = np.max(np.abs(wound[i] - wound[before]))
        count = min(max(int(np.ceil(longest / STEP)), 1), MAX_STEPS) if remembers else 1
        for part in range(count):
            w = (part + 1) / count
            now[:] = (1.0 - w) * wound[before] + w * wound[i]
            speed[:] = (1.0 - w) * rate[before] + w * rate[i]
            _settle(c, at, ends, slack, b, past, now, speed, age[i], g, H, L, room)
            if parameters > 0:
                _energy(c, at, ends, slack, b, past, now, speed, age[i], g, H, True, room)
                _factor(H, L)
            for p in range(parameters):
                _energy(raised[p], at, ends, slack, b, pasts[p], now, speed, age[i], g_p, H, False, room)
                for k in range(n2):
                    g_p[k] -= g[k]
                _solve(L, g_p, move)
                if part == count - 1:
                    tangents[i, p] = -move / steps[p]
                for k in range(n2):
                    g_p[k] = b[k] - move[k]
                _slip(raised[p], at, ends, g_p, pasts[p], now, speed, age[i], room)
            _slip(c, at, ends, b, past, now, speed, age[i], room)
        bends[i] = b
    return bends, tangents
