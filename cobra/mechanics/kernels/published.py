"""The paper's own equations S-9 … S-33, marched through time, for comparison with the chain (MODEL.md 4).

One row a segment: θ, φ, L, then their rates, then the accelerations of the step before. The printed frames
R = Rz(φ) Ry(θ) are those of the chain with b = θ [cos φ, sin φ] and ψ = φ, so `_sweep` gives their geometry.
"""

from typing import Any

import numpy as np

from cobra.mechanics.kernels.cables import _law
from cobra.mechanics.kernels.compiling import compiled
from cobra.mechanics.kernels.layout import (
    ARM,
    BENT,
    BIAS,
    FINE,
    LARGEST_BEND_RAD,
    LARGEST_STRETCH,
    LARGEST_TWIST_RAD,
    LENGTH,
    LOAD,
    MIDDLE,
    NOT_FINITE,
    PUSH,
    RATE,
    SINE,
    STRETCHED,
    TENSION,
    TWISTED,
    S,
)
from cobra.mechanics.kernels.segment import _stumpff, _sweep

COLUMNS = 9


@compiled
def _place(q: Any, v: Any, w: Any, frame: Any, joint: Any, accel: Any, place: Any) -> None:
    """Positions `place` (n, 3), velocity columns `joint` (n, 3, 6) and accelerations without q̈ `accel` (n, 3)."""
    n = q.shape[0]
    for i in range(n):
        theta, phi, dtheta, dphi = q[i, 0], q[i, 1], v[i, 0], v[i, 1]
        cos, sin = np.cos(phi), np.sin(phi)
        w[i, MIDDLE], w[i, MIDDLE + 1], w[i, MIDDLE + 2], w[i, MIDDLE + 3] = theta * cos, theta * sin, phi, q[i, 2]
        w[i, RATE], w[i, RATE + 1] = dtheta * cos - theta * dphi * sin, dtheta * sin + theta * dphi * cos
        w[i, RATE + 2], w[i, RATE + 3] = dphi, v[i, 2]
    _sweep(w, frame)
    a0 = a1 = a2 = a3 = a4 = a5 = px = py = pz = 0.0
    for i in range(n):
        theta, phi, dtheta, dphi = q[i, 0], q[i, 1], v[i, 0], v[i, 1]
        cos, sin = np.cos(phi), np.sin(phi)
        # b̈ where θ̈ = φ̈ = 0.
        bx = -2.0 * dtheta * dphi * sin - theta * dphi * dphi * cos
        by = 2.0 * dtheta * dphi * cos - theta * dphi * dphi * sin
        for r in range(6):
            x, y = w[i, S + r], w[i, S + 6 + r]
            joint[i, 0, r] = cos * x + sin * y
            joint[i, 1, r] = theta * (cos * y - sin * x) + w[i, S + 12 + r]
            joint[i, 2, r] = w[i, S + 18 + r]
            w[i, BIAS + r] += bx * x + by * y
        rx, ry, rz = w[i, ARM], w[i, ARM + 1], w[i, ARM + 2]
        a3 += a1 * rz - a2 * ry + w[i, BIAS + 3]
        a4 += a2 * rx - a0 * rz + w[i, BIAS + 4]
        a5 += a0 * ry - a1 * rx + w[i, BIAS + 5]
        a0 += w[i, BIAS]
        a1 += w[i, BIAS + 1]
        a2 += w[i, BIAS + 2]
        px, py, pz = px + rx, py + ry, pz + rz
        accel[i, 0], accel[i, 1], accel[i, 2] = a3, a4, a5
        place[i, 0], place[i, 1], place[i, 2] = px, py, pz


@compiled
def _moments(f: Any, place: Any, joint: Any, w: Any, out: Any) -> None:
    """What forces f (n, 3) on the guiders mean in the rows of θ, φ and L (n, 3): S-11 … S-18, S-25, S-26, S-31.

    Moments about guider i of all forces beyond it, on its y and z axes, with the printed lever arms; the guider's own
    force along its chamber's chord.
    """
    fx = fy = fz = mx = my = mz = 0.0
    for back in range(f.shape[0]):
        i = f.shape[0] - 1 - back
        if back > 0:
            # Moments of the forces beyond guider i + 1, moved from there to here.
            rx, ry, rz = w[i + 1, ARM], w[i + 1, ARM + 1], w[i + 1, ARM + 2]
            mx += ry * fz - rz * fy
            my += rz * fx - rx * fz
            mz += rx * fy - ry * fx
        out[i, 0] = joint[i, 0, 0] * mx + joint[i, 0, 1] * my + joint[i, 0, 2] * mz
        out[i, 1] = w[i, S + 12] * mx + w[i, S + 13] * my + w[i, S + 14] * mz
        rx, ry, rz = w[i, ARM], w[i, ARM + 1], w[i, ARM + 2]
        chord = np.sqrt(rx * rx + ry * ry + rz * rz)
        out[i, 2] = (rx * f[i, 0] + ry * f[i, 1] + rz * f[i, 2]) / chord
        fx, fy, fz = fx + f[i, 0], fy + f[i, 1], fz + f[i, 2]


@compiled
def _chord(theta: float, L: float, dtheta: float, dL: float) -> Any:
    """C = L sin(θ/2)/(θ/2) (S-24), Ċ, and ∂C/∂L."""
    s = 0.25 * theta * theta
    c4, c5, _ = _stumpff(s)
    c3 = 1 / 6 - s * c5
    c1 = 1.0 - s * c3
    d1 = 0.5 * (c3 - (0.5 - s * c4))
    return L * c1, c1 * dL + L * d1 * 0.5 * theta * dtheta, c1


@compiled
def _solve(a: Any, b: Any) -> None:
    """b ← a⁻¹ b, Gaussian elimination with partial pivoting; a is lost."""
    n = b.shape[0]
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(a[i, k]) > abs(a[best, k]):
                best = i
        for j in range(k, n):
            a[k, j], a[best, j] = a[best, j], a[k, j]
        b[k], b[best] = b[best], b[k]
        for i in range(k + 1, n):
            factor = a[i, k] / a[k, k]
            for j in range(k + 1, n):
                a[i, j] -= factor * a[k, j]
            b[i] -= factor * b[k]
    for back in range(n):
        i = n - 1 - back
        for j in range(i + 1, n):
            b[i] -= a[i, j] * b[j]
        b[i] /= a[i, i]


@compiled
def march_published(
    c: Any, azimuths: Any, radius: float, kind: int, size: float, times: Any, commands: Any, loads: Any, state: Any,
    rope: Any, states: Any, tensions: Any,
) -> Any:  # fmt: skip
    """From mark to mark, in place, as `marching.march` with a fixed step: (verdict, segment, time, steps).

    Chambers and guiders: linearly implicit midpoint rule; cables explicitly, at the middle of the step. No stops.
    """
    n, k = state.shape[0], azimuths.shape[0]
    w, frame = np.zeros((n, PUSH)), np.zeros((3, 3))
    q, v, joint = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3, 6))
    place, accel, force, row = np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3)), np.zeros((n, 3))
    matrix, right = np.zeros((3 * n, 3 * n)), np.zeros(3 * n)
    steps = 0
    for mark in range(times.shape[0] - 1):
        span = times[mark + 1] - times[mark]
        count = int(max(np.ceil(span / size - 1e-9), 1.0))
        h = span / count
        for part in range(count):
            at = (part + 0.5) / count
            for i in range(n):
                for r in range(3):
                    q[i, r] = state[i, r] + 0.5 * h * state[i, 3 + r]
                    v[i, r] = state[i, 3 + r] + 0.5 * h * state[i, 6 + r]
                    w[i, LOAD + r] = loads[mark, 0, i, r] + at * (loads[mark, 1, i, r] - loads[mark, 0, i, r])
            _place(q, v, w, frame, joint, accel, place)
            for i in range(n):
                force[i, 0] = c.mass * (c.gravity_x - accel[i, 0]) + w[i, LOAD]
                force[i, 1] = c.mass * (c.gravity_y - accel[i, 1]) + w[i, LOAD + 1]
                force[i, 2] = c.mass * (c.gravity_z - accel[i, 2]) + w[i, LOAD + 2]
            _moments(force, place, joint, w, row)
            _assemble(c, state, q, h, w, joint, place, force, row, matrix, right)
            _actuate(c, azimuths, radius, kind, commands[mark], at, q, rope, w, right)
            _solve(matrix, right)
            for i in range(n):
                for r in range(3):
                    a = right[3 * i + r]
                    state[i, 6 + r] = a
                    state[i, r] += h * (state[i, 3 + r] + 0.5 * h * a)
                    state[i, 3 + r] += h * a
            steps += 1
            for i in range(n):
                theta, L = state[i, 0], state[i, 2]
                time = times[mark] + (part + 1) * h
                total = theta + state[i, 1] + L + state[i, 3] + state[i, 4] + state[i, 5]
                if not np.isfinite(total):
                    return NOT_FINITE, i, time, steps
                if abs(theta) > LARGEST_BEND_RAD:
                    return BENT, i, time, steps
                if abs(state[i, 1]) > LARGEST_TWIST_RAD:
                    return TWISTED, i, time, steps
                if not 0.0 < L < LARGEST_STRETCH * c.rest:
                    return STRETCHED, i, time, steps
        for i in range(n):
            for j in range(COLUMNS):
                states[mark + 1, i, j] = state[i, j]
        for m in range(k):
            tensions[mark + 1, m] = rope[TENSION, m]
    return FINE, 0, times[-1], steps


@compiled
def _assemble(
    c: Any, state: Any, q: Any, h: float, w: Any, joint: Any, place: Any, force: Any, row: Any, matrix: Any, right: Any
) -> None:
    """S-22, S-28, S-33 without actuation: global inertia and the guiders' inertia forces on the left, springs and dampers
    between neighbouring chambers on the right; both implicit in the middle of the step."""
    n = q.shape[0]
    for i in range(n):
        for r in range(3):
            right[3 * i + r] = row[i, r]
    # Columns: what a unit of each q̈ does to the guiders beyond it, through the same moments as every other force.
    for k in range(n):
        for m in range(3):
            for i in range(n):
                for r in range(3):
                    force[i, r] = 0.0
                if i >= k:
                    x, y, z = place[i, 0] - place[k, 0], place[i, 1] - place[k, 1], place[i, 2] - place[k, 2]
                    s0, s1, s2 = joint[k, m, 0], joint[k, m, 1], joint[k, m, 2]
                    force[i, 0] = -c.mass * (joint[k, m, 3] + s1 * z - s2 * y)
                    force[i, 1] = -c.mass * (joint[k, m, 4] + s2 * x - s0 * z)
                    force[i, 2] = -c.mass * (joint[k, m, 5] + s0 * y - s1 * x)
            _moments(force, place, joint, w, row)
            for i in range(n):
                for r in range(3):
                    matrix[3 * i + r, 3 * k + m] = -row[i, r]
                if m == 0 and i >= k:
                    matrix[3 * i, 3 * k] += c.inertia_bend
                if m == 1 and i >= k:
                    matrix[3 * i + 1, 3 * k + 1] += c.inertia_twist
    for i in range(n):
        L = q[i, 2]
        for r in range(2):
            stiffness = c.bending * c.rest / L if r == 0 else c.torsion * c.rest / L
            damping = c.damping_bend if r == 0 else c.damping_twist
            implicit = 0.5 * h * (damping + 0.5 * h * stiffness)
            right[3 * i + r] -= stiffness * q[i, r] + damping * state[i, 3 + r]
            matrix[3 * i + r, 3 * i + r] += implicit
            if i + 1 < n:
                right[3 * i + r] += stiffness * q[i + 1, r] + damping * state[i + 1, 3 + r]
                matrix[3 * i + r, 3 * (i + 1) + r] -= implicit
        chord, rate, slope = _chord(q[i, 0], L, state[i, 3], state[i, 5])
        implicit = 0.5 * h * slope * (c.damping_axial + 0.5 * h * c.axial)
        matrix[3 * i + 2, 3 * i + 2] += implicit
        if i + 1 < n:
            beyond, beyond_rate, beyond_slope = _chord(q[i + 1, 0], q[i + 1, 2], state[i + 1, 3], state[i + 1, 5])
            right[3 * i + 2] += c.axial * (beyond - chord) + c.damping_axial * (beyond_rate - rate)
            matrix[3 * i + 2, 3 * (i + 1) + 2] -= 0.5 * h * beyond_slope * (c.damping_axial + 0.5 * h * c.axial)
        else:
            right[3 * i + 2] -= c.axial * (chord - slope * c.rest) + c.damping_axial * rate


@compiled
def _actuate(
    c: Any, azimuths: Any, radius: float, kind: int, commands: Any, at: float, q: Any, rope: Any, w: Any, right: Any
) -> None:
    """τ_θ, τ_φ and f_L of S-34 on the top guider, from tensions with friction (S-36, S-37)."""
    n = q.shape[0]
    theta = phi = L = 0.0
    g, last = 1.0, 1.0
    for i in range(n):
        theta, phi, L = theta + q[i, 0], phi + q[i, 1], L + q[i, 2]
        last = 1.0 - c.friction * w[i, SINE]
        g *= last * last
    g /= last
    for m in range(azimuths.shape[0]):
        cos, sin = np.cos(phi - azimuths[m]), np.sin(phi - azimuths[m])
        length = L - radius * theta * cos
        command = commands[0, m] + at * (commands[1, m] - commands[0, m])
        force, _ = _law(c, kind, command, g, length, rope[LENGTH, m], rope[TENSION, m])
        rope[TENSION, m], rope[LENGTH, m] = force, length
        right[3 * n - 3] += force * radius * cos
        right[3 * n - 2] -= force * radius * theta * sin
        right[3 * n - 1] -= force
