"""The articulated-body solve: accelerations of the whole chain in work that grows with the number of segments."""

from typing import Any

import numpy as np

from cobra.mechanics.kernels.compiling import compiled
from cobra.mechanics.kernels.layout import (
    ARM,
    BIAS,
    HELD,
    INVERSE,
    LOAD,
    MIDDLE,
    OMEGA,
    PUSH,
    RATE,
    STATE_COLUMNS,
    S,
    U,
    V,
)
from cobra.mechanics.kernels.segment import _elastic, _sweep


@compiled
def _articulate(c: Any, cables: Any, state: Any, h: float, w: Any, M: Any, p: Any) -> None:
    """Accelerations without cables, then per newton of each cable, after `_sweep`; into w from PUSH on.

    Springs and dampers of the chambers act at the middle of the step, implicitly (h = 0: plain accelerations):
    (M + h/2 D + h²/4 K) q̈ = Q − c − D q̇ − ∂U/∂q(q_mid) with K the chambers' stiffness at rest. Held coordinates lose
    their rate within the step. Scratch: M (6, 6), the articulated inertia (upper triangle), and p (1 + cables, 6), the
    forces that go with it.
    """
    columns = p.shape[0]
    for r in range(6):
        for k in range(6):
            M[r, k] = 0.0
        for m in range(columns):
            p[m, r] = 0.0
    for back in range(w.shape[0]):
        i = w.shape[0] - 1 - back
        _add_guider(c, w, i, M, p)
        spring_x, spring_y, spring_psi, spring_L = _elastic(
            c, w[i, MIDDLE], w[i, MIDDLE + 1], w[i, MIDDLE + 2], w[i, MIDDLE + 3]
        )
        # The joint's four freedoms one after the other, the most distal first.
        for j in range(4):
            damping, stiffness, spring = c.damping_bend, c.bending, spring_x
            if j == 1:
                spring = spring_y
            elif j == 2:
                damping, stiffness, spring = c.damping_twist, c.torsion, spring_psi
            elif j == 3:
                damping, stiffness, spring = c.damping_axial, c.axial, spring_L
            s = S + 6 * j
            s0, s1, s2, s3, s4, s5 = w[i, s], w[i, s + 1], w[i, s + 2], w[i, s + 3], w[i, s + 4], w[i, s + 5]
            u0 = M[0, 0] * s0 + M[0, 1] * s1 + M[0, 2] * s2 + M[0, 3] * s3 + M[0, 4] * s4 + M[0, 5] * s5
            u1 = M[0, 1] * s0 + M[1, 1] * s1 + M[1, 2] * s2 + M[1, 3] * s3 + M[1, 4] * s4 + M[1, 5] * s5
            u2 = M[0, 2] * s0 + M[1, 2] * s1 + M[2, 2] * s2 + M[2, 3] * s3 + M[2, 4] * s4 + M[2, 5] * s5
            u3 = M[0, 3] * s0 + M[1, 3] * s1 + M[2, 3] * s2 + M[3, 3] * s3 + M[3, 4] * s4 + M[3, 5] * s5
            u4 = M[0, 4] * s0 + M[1, 4] * s1 + M[2, 4] * s2 + M[3, 4] * s3 + M[4, 4] * s4 + M[4, 5] * s5
            u5 = M[0, 5] * s0 + M[1, 5] * s1 + M[2, 5] * s2 + M[3, 5] * s3 + M[4, 5] * s4 + M[5, 5] * s5
            u = U + 6 * j
            w[i, u], w[i, u + 1], w[i, u + 2], w[i, u + 3], w[i, u + 4], w[i, u + 5] = u0, u1, u2, u3, u4, u5
            d = s0 * u0 + s1 * u1 + s2 * u2 + s3 * u3 + s4 * u4 + s5 * u5 + 0.5 * h * (damping + 0.5 * h * stiffness)
            inverse = 1.0 / d
            w[i, INVERSE + j] = inverse
            held = w[i, HELD + j] > 0.0
            rate = state[i, V + j]
            for m in range(columns):
                push = -spring - damping * rate if m == 0 else -cables[m - 1, j]
                push -= s0 * p[m, 0] + s1 * p[m, 1] + s2 * p[m, 2] + s3 * p[m, 3] + s4 * p[m, 4] + s5 * p[m, 5]
                w[i, PUSH + 4 * m + j] = push
                push *= inverse
                if held:
                    push = -rate / h if m == 0 and h > 0.0 else 0.0
                p[m, 0] += push * u0
                p[m, 1] += push * u1
                p[m, 2] += push * u2
                p[m, 3] += push * u3
                p[m, 4] += push * u4
                p[m, 5] += push * u5
            if not held:
                _lighten(M, inverse, u0, u1, u2, u3, u4, u5)
        if i > 0:
            _shift(M, p, w[i, ARM], w[i, ARM + 1], w[i, ARM + 2])
    _accelerate(state, h, w, columns)


@compiled
def _accelerate(state: Any, h: float, w: Any, columns: int) -> None:
    """Second half of `_articulate`: from the base to the tip, one column of forces after the other."""
    answer, stop = PUSH + 4 * columns, PUSH + 8 * columns
    for m in range(columns):
        a0 = a1 = a2 = a3 = a4 = a5 = 0.0
        for i in range(w.shape[0]):
            rx, ry, rz = w[i, ARM], w[i, ARM + 1], w[i, ARM + 2]
            a3 += a1 * rz - a2 * ry
            a4 += a2 * rx - a0 * rz
            a5 += a0 * ry - a1 * rx
            for back in range(4):
                j = 3 - back
                s, u = S + 6 * j, U + 6 * j
                push = w[i, PUSH + 4 * m + j] - (w[i, u] * a0 + w[i, u + 1] * a1 + w[i, u + 2] * a2)
                push -= w[i, u + 3] * a3 + w[i, u + 4] * a4 + w[i, u + 5] * a5
                out = push * w[i, INVERSE + j]
                if w[i, HELD + j] > 0.0:
                    out = -state[i, V + j] / h if m == 0 and h > 0.0 else 0.0
                    if j == 3:
                        w[i, stop + m] = out / w[i, INVERSE + j] - push
                w[i, answer + 4 * m + j] = out
                a0 += w[i, s] * out
                a1 += w[i, s + 1] * out
                a2 += w[i, s + 2] * out
                a3 += w[i, s + 3] * out
                a4 += w[i, s + 4] * out
                a5 += w[i, s + 5] * out
            if m == 0:
                a0 += w[i, BIAS]
                a1 += w[i, BIAS + 1]
                a2 += w[i, BIAS + 2]
                a3 += w[i, BIAS + 3]
                a4 += w[i, BIAS + 4]
                a5 += w[i, BIAS + 5]


@compiled
def _add_guider(c: Any, w: Any, i: int, M: Any, p: Any) -> None:
    """The guider itself: inertia, gyroscopic moment, weight, external force; then velocity products of all it bears."""
    zx, zy, zz = w[i, S + 12], w[i, S + 13], w[i, S + 14]
    ox, oy, oz = w[i, OMEGA], w[i, OMEGA + 1], w[i, OMEGA + 2]
    b0, b1, b2 = w[i, BIAS], w[i, BIAS + 1], w[i, BIAS + 2]
    b3, b4, b5 = w[i, BIAS + 3], w[i, BIAS + 4], w[i, BIAS + 5]
    spin = c.inertia_twist - c.inertia_bend
    M[0, 0] += c.inertia_bend + spin * zx * zx
    M[0, 1] += spin * zx * zy
    M[0, 2] += spin * zx * zz
    M[1, 1] += c.inertia_bend + spin * zy * zy
    M[1, 2] += spin * zy * zz
    M[2, 2] += c.inertia_bend + spin * zz * zz
    M[3, 3] += c.mass
    M[4, 4] += c.mass
    M[5, 5] += c.mass
    lean = spin * (zx * ox + zy * oy + zz * oz)
    p[0, 0] += lean * (oy * zz - oz * zy)
    p[0, 1] += lean * (oz * zx - ox * zz)
    p[0, 2] += lean * (ox * zy - oy * zx)
    p[0, 3] -= c.mass * c.gravity_x + w[i, LOAD]
    p[0, 4] -= c.mass * c.gravity_y + w[i, LOAD + 1]
    p[0, 5] -= c.mass * c.gravity_z + w[i, LOAD + 2]
    p[0, 0] += M[0, 0] * b0 + M[0, 1] * b1 + M[0, 2] * b2 + M[0, 3] * b3 + M[0, 4] * b4 + M[0, 5] * b5
    p[0, 1] += M[0, 1] * b0 + M[1, 1] * b1 + M[1, 2] * b2 + M[1, 3] * b3 + M[1, 4] * b4 + M[1, 5] * b5
    p[0, 2] += M[0, 2] * b0 + M[1, 2] * b1 + M[2, 2] * b2 + M[2, 3] * b3 + M[2, 4] * b4 + M[2, 5] * b5
    p[0, 3] += M[0, 3] * b0 + M[1, 3] * b1 + M[2, 3] * b2 + M[3, 3] * b3 + M[3, 4] * b4 + M[3, 5] * b5
    p[0, 4] += M[0, 4] * b0 + M[1, 4] * b1 + M[2, 4] * b2 + M[3, 4] * b3 + M[4, 4] * b4 + M[4, 5] * b5
    p[0, 5] += M[0, 5] * b0 + M[1, 5] * b1 + M[2, 5] * b2 + M[3, 5] * b3 + M[4, 5] * b4 + M[5, 5] * b5


@compiled
def _lighten(M: Any, inverse: float, u0: float, u1: float, u2: float, u3: float, u4: float, u5: float) -> None:
    """What a free coordinate takes off the articulated inertia: M ← M − U Uᵀ / d."""
    x = u0 * inverse
    M[0, 0] -= x * u0
    M[0, 1] -= x * u1
    M[0, 2] -= x * u2
    M[0, 3] -= x * u3
    M[0, 4] -= x * u4
    M[0, 5] -= x * u5
    x = u1 * inverse
    M[1, 1] -= x * u1
    M[1, 2] -= x * u2
    M[1, 3] -= x * u3
    M[1, 4] -= x * u4
    M[1, 5] -= x * u5
    x = u2 * inverse
    M[2, 2] -= x * u2
    M[2, 3] -= x * u3
    M[2, 4] -= x * u4
    M[2, 5] -= x * u5
    x = u3 * inverse
    M[3, 3] -= x * u3
    M[3, 4] -= x * u4
    M[3, 5] -= x * u5
    x = u4 * inverse
    M[4, 4] -= x * u4
    M[4, 5] -= x * u5
    M[5, 5] -= u5 * inverse * u5


@compiled
def _shift(M: Any, p: Any, rx: float, ry: float, rz: float) -> None:
    """Move articulated inertia and forces from a guider to the one before it, which lies −r away.

    K = I_ωv + [r] I_vv replaces I_ωv; I_ωω + [r] I_ωvᵀ − K [r] replaces I_ωω.
    """
    b00, b01, b02 = M[0, 3], M[0, 4], M[0, 5]
    b10, b11, b12 = M[1, 3], M[1, 4], M[1, 5]
    b20, b21, b22 = M[2, 3], M[2, 4], M[2, 5]
    v00, v01, v02, v11, v12, v22 = M[3, 3], M[3, 4], M[3, 5], M[4, 4], M[4, 5], M[5, 5]
    k00, k01, k02 = b00 + ry * v02 - rz * v01, b01 + ry * v12 - rz * v11, b02 + ry * v22 - rz * v12
    k10, k11, k12 = b10 + rz * v00 - rx * v02, b11 + rz * v01 - rx * v12, b12 + rz * v02 - rx * v22
    k20, k21, k22 = b20 + rx * v01 - ry * v00, b21 + rx * v11 - ry * v01, b22 + rx * v12 - ry * v02
    M[0, 3], M[0, 4], M[0, 5] = k00, k01, k02
    M[1, 3], M[1, 4], M[1, 5] = k10, k11, k12
    M[2, 3], M[2, 4], M[2, 5] = k20, k21, k22
    M[0, 0] += ry * b02 - rz * b01 - k01 * rz + k02 * ry
    M[0, 1] += ry * b12 - rz * b11 - k02 * rx + k00 * rz
    M[0, 2] += ry * b22 - rz * b21 - k00 * ry + k01 * rx
    M[1, 1] += rz * b10 - rx * b12 - k12 * rx + k10 * rz
    M[1, 2] += rz * b20 - rx * b22 - k10 * ry + k11 * rx
    M[2, 2] += rx * b21 - ry * b20 - k20 * ry + k21 * rx
    for m in range(p.shape[0]):
        fx, fy, fz = p[m, 3], p[m, 4], p[m, 5]
        p[m, 0] += ry * fz - rz * fy
        p[m, 1] += rz * fx - rx * fz
        p[m, 2] += rx * fy - ry * fx


@compiled
def accelerations(c: Any, cables: Any, q: Any, v: Any, tension: Any, load: Any) -> Any:
    """q̈ (n, 4) of the chain at q, q̇ (n, 4) under cable tensions (cables,) and forces on the guiders (n, 3)."""
    n, k = q.shape[0], cables.shape[0]
    state, w = np.zeros((n, STATE_COLUMNS)), np.zeros((n, PUSH + 9 * (1 + k)))
    for i in range(n):
        for j in range(4):
            state[i, V + j] = w[i, RATE + j] = v[i, j]
            w[i, MIDDLE + j] = q[i, j]
        for r in range(3):
            w[i, LOAD + r] = load[i, r]
    _sweep(w, np.zeros((3, 3)))
    _articulate(c, cables, state, 0.0, w, np.zeros((6, 6)), np.zeros((1 + k, 6)))
    answer = PUSH + 4 * (1 + k)
    out = np.zeros((n, 4))
    for i in range(n):
        for j in range(4):
            out[i, j] = w[i, answer + j]
            for m in range(k):
                out[i, j] += w[i, answer + 4 * (1 + m) + j] * tension[m]
    return out
