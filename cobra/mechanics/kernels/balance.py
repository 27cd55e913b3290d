"""The other way round: the generalised forces that a posture or motion takes, and how they change with the posture."""

from typing import Any

import numpy as np

from cobra.mechanics.kernels.compiling import compiled
from cobra.mechanics.kernels.layout import ARM, BIAS, MIDDLE, OMEGA, PUSH, RATE, S
from cobra.mechanics.kernels.segment import _elastic, _sweep


@compiled
def generalised_forces(c: Any, q: Any, v: Any, a: Any, load: Any) -> Any:
    """M q̈ + c + D q̇ + ∂U/∂q − Σ Jᵀ F (n, 4) [N·m, N]: what the cables must do (recursive Newton-Euler)."""
    n = q.shape[0]
    w, out = np.zeros((n, PUSH)), np.zeros((n, 4))
    _balance(c, q, v, a, load, w, np.zeros((3, 3)), np.zeros((n, 6)), out)
    return out


@compiled
def stiffness(c: Any, q: Any, load: Any, difference: float) -> Any:
    """∂²/∂q² of elastic energy, weight and dead loads (4 n, 4 n), by central differences of the generalised forces."""
    n = q.shape[0]
    w, frame, f = np.zeros((n, PUSH)), np.zeros((3, 3)), np.zeros((n, 6))
    still, at = np.zeros((n, 4)), q.copy()
    above, below, out = np.zeros((n, 4)), np.zeros((n, 4)), np.zeros((4 * n, 4 * n))
    for i in range(n):
        for j in range(4):
            at[i, j] = q[i, j] + difference
            _balance(c, at, still, still, load, w, frame, f, above)
            at[i, j] = q[i, j] - difference
            _balance(c, at, still, still, load, w, frame, f, below)
            at[i, j] = q[i, j]
            for k in range(n):
                for m in range(4):
                    out[4 * k + m, 4 * i + j] = (above[k, m] - below[k, m]) / (2.0 * difference)
    return out


@compiled
def _balance(c: Any, q: Any, v: Any, a: Any, load: Any, w: Any, frame: Any, f: Any, out: Any) -> None:
    n = q.shape[0]
    for i in range(n):
        for j in range(4):
            w[i, MIDDLE + j] = q[i, j]
            w[i, RATE + j] = v[i, j]
    _sweep(w, frame)
    spin = c.inertia_twist - c.inertia_bend
    a0 = a1 = a2 = a3 = a4 = a5 = 0.0
    for i in range(n):
        rx, ry, rz = w[i, ARM], w[i, ARM + 1], w[i, ARM + 2]
        a3 += a1 * rz - a2 * ry + w[i, BIAS + 3]
        a4 += a2 * rx - a0 * rz + w[i, BIAS + 4]
        a5 += a0 * ry - a1 * rx + w[i, BIAS + 5]
        a0 += w[i, BIAS]
        a1 += w[i, BIAS + 1]
        a2 += w[i, BIAS + 2]
        for j in range(4):
            s = S + 6 * j
            a0 += w[i, s] * a[i, j]
            a1 += w[i, s + 1] * a[i, j]
            a2 += w[i, s + 2] * a[i, j]
            a3 += w[i, s + 3] * a[i, j]
            a4 += w[i, s + 4] * a[i, j]
            a5 += w[i, s + 5] * a[i, j]
        zx, zy, zz = w[i, S + 12], w[i, S + 13], w[i, S + 14]
        ox, oy, oz = w[i, OMEGA], w[i, OMEGA + 1], w[i, OMEGA + 2]
        lean, tilt = spin * (zx * ox + zy * oy + zz * oz), spin * (zx * a0 + zy * a1 + zz * a2)
        f[i, 0] = c.inertia_bend * a0 + tilt * zx + lean * (oy * zz - oz * zy)
        f[i, 1] = c.inertia_bend * a1 + tilt * zy + lean * (oz * zx - ox * zz)
        f[i, 2] = c.inertia_bend * a2 + tilt * zz + lean * (ox * zy - oy * zx)
        f[i, 3] = c.mass * (a3 - c.gravity_x) - load[i, 0]
        f[i, 4] = c.mass * (a4 - c.gravity_y) - load[i, 1]
        f[i, 5] = c.mass * (a5 - c.gravity_z) - load[i, 2]
    for back in range(n):
        i = n - 1 - back
        spring_x, spring_y, spring_psi, spring_L = _elastic(c, q[i, 0], q[i, 1], q[i, 2], q[i, 3])
        out[i, 0] = spring_x + c.damping_bend * v[i, 0]
        out[i, 1] = spring_y + c.damping_bend * v[i, 1]
        out[i, 2] = spring_psi + c.damping_twist * v[i, 2]
        out[i, 3] = spring_L + c.damping_axial * v[i, 3]
        for j in range(4):
            for r in range(6):
                out[i, j] += w[i, S + 6 * j + r] * f[i, r]
        if i > 0:
            rx, ry, rz = w[i, ARM], w[i, ARM + 1], w[i, ARM + 2]
            f[i - 1, 0] += f[i, 0] + ry * f[i, 5] - rz * f[i, 4]
            f[i - 1, 1] += f[i, 1] + rz * f[i, 3] - rx * f[i, 5]
            f[i - 1, 2] += f[i, 2] + rx * f[i, 4] - ry * f[i, 3]
            f[i - 1, 3] += f[i, 3]
            f[i - 1, 4] += f[i, 4]
            f[i - 1, 5] += f[i, 5]
