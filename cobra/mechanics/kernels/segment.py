"""One segment: the functions of θ² it is made of, its velocities and velocity products, its elastic forces."""

from typing import Any

import numpy as np

from cobra.mechanics.kernels.compiling import compiled
from cobra.mechanics.kernels.layout import ARM, BIAS, MIDDLE, OMEGA, RATE, SINE, S


@compiled
def _stumpff(s: float) -> Any:
    """c₄, c₅, c₆ of c_k(s) = Σ (−s)^j / (k + 2j)!, to rounding error for s = θ² up to 16."""
    c6 = 1 - s / 306 * (1 - s / 380 * (1 - s / 462 * (1 - s / 552)))
    c6 = 1 - s / 132 * (1 - s / 182 * (1 - s / 240 * c6))
    c6 = (1 - s / 56 * (1 - s / 90 * c6)) / 720
    c5 = 1 - s / 272 * (1 - s / 342 * (1 - s / 420 * (1 - s / 506)))
    c5 = 1 - s / 110 * (1 - s / 156 * (1 - s / 210 * c5))
    c5 = (1 - s / 42 * (1 - s / 72 * c5)) / 120
    return 1 / 24 - s * c6, c5, c6


@compiled
def _elastic(c: Any, x: float, y: float, psi: float, L: float) -> Any:
    """∂U/∂(b_x, b_y, ψ, L) of one chamber [N·m, N]; the chord's energy is K e² c₂ with e = L − L₀ (S-24)."""
    s = x * x + y * y
    c4, c5, _ = _stumpff(s)
    c3 = 1 / 6 - s * c5
    e = L - c.rest
    bend = c.bending + 2.0 * c.axial * e * e * (c4 - 0.5 * c3)
    return bend * x, bend * y, c.torsion * psi, 2.0 * c.axial * e * (0.5 - s * c4)


@compiled
def _turn(A: Any, x: float, y: float, z: float, w: Any, i: int, at: int) -> None:
    w[i, at] = A[0, 0] * x + A[0, 1] * y + A[0, 2] * z
    w[i, at + 1] = A[1, 0] * x + A[1, 1] * y + A[1, 2] * z
    w[i, at + 2] = A[2, 0] * x + A[2, 1] * y + A[2, 2] * z


@compiled
def _sweep(w: Any, A: Any) -> None:  # noqa: PLR0915  (one formula after the other)
    """Geometry and velocities from the base to the tip at MIDDLE and RATE: S, BIAS, ARM, OMEGA, SINE (MODEL.md 1, 3, 4).

    With s = θ² and dc_k/ds = (k c_{k+2} − c_{k+1}) / 2: t = L [c₂ b, c₁], R e_z = [c₁ b, c₀], and the angular velocity
    of R is [−ḃ_y + c₃ τ b_x, ḃ_x + c₃ τ b_y, c₂ τ] with τ = b_x ḃ_y − b_y ḃ_x. A (3, 3) is the frame of the guider.
    """
    for r in range(3):
        A[r, 0] = A[r, 1] = A[r, 2] = 0.0
        A[r, r] = 1.0
    ox = oy = oz = 0.0
    for i in range(w.shape[0]):
        x, y, psi, L = w[i, MIDDLE], w[i, MIDDLE + 1], w[i, MIDDLE + 2], w[i, MIDDLE + 3]
        dx, dy, dpsi, dL = w[i, RATE], w[i, RATE + 1], w[i, RATE + 2], w[i, RATE + 3]
        s = x * x + y * y
        c4, c5, c6 = _stumpff(s)
        c3 = 1 / 6 - s * c5
        c2 = 0.5 - s * c4
        c1 = 1.0 - s * c3
        c0 = 1.0 - s * c2
        w[i, SINE] = np.sqrt(0.5 * s * c2)
        # First derivatives by s, second derivatives of c₁ and c₂, and from them the rates and their products.
        d1, d2, d3 = 0.5 * (c3 - c2), c4 - 0.5 * c3, 1.5 * c5 - 0.5 * c4
        e1, e2 = 0.25 * (3.0 * (c5 - c4) + c3), 2.0 * c6 - 1.25 * c5 + 0.25 * c4
        ds = 2.0 * (x * dx + y * dy)
        dds = 2.0 * (dx * dx + dy * dy)
        r1, r2, r3 = d1 * ds, d2 * ds, d3 * ds
        k1, k2 = e1 * ds * ds + d1 * dds, e2 * ds * ds + d2 * dds
        tau = x * dy - y * dx
        _turn(A, -c3 * x * y, 1.0 - c3 * y * y, -c2 * y, w, i, S)
        _turn(A, -1.0 + c3 * x * x, c3 * x * y, c2 * x, w, i, S + 6)
        _turn(A, c1 * x, c1 * y, c0, w, i, S + 12)
        _turn(A, L * (c2 + 2.0 * d2 * x * x), L * 2.0 * d2 * x * y, L * 2.0 * d1 * x, w, i, S + 3)
        _turn(A, L * 2.0 * d2 * x * y, L * (c2 + 2.0 * d2 * y * y), L * 2.0 * d1 * y, w, i, S + 9)
        _turn(A, c2 * x, c2 * y, c1, w, i, S + 21)
        # d(ω_rel)/dt and d²t/dt² without q̈, in the frame of the guider before.
        wx = tau * (r3 * x + c3 * dx) + (r1 * x + c1 * dx) * dpsi
        wy = tau * (r3 * y + c3 * dy) + (r1 * y + c1 * dy) * dpsi
        _turn(A, wx, wy, tau * r2 - 0.5 * c1 * ds * dpsi, w, i, BIAS)
        tx = L * (k2 * x + 2.0 * r2 * dx) + 2.0 * dL * (r2 * x + c2 * dx)
        ty = L * (k2 * y + 2.0 * r2 * dy) + 2.0 * dL * (r2 * y + c2 * dy)
        _turn(A, tx, ty, L * k1 + 2.0 * dL * r1, w, i, BIAS + 3)
        # ω_rel and ṫ in the world, then what the moving frame adds: ω × ω_rel and ω × (ω × t + 2 ṫ).
        wx = w[i, S] * dx + w[i, S + 6] * dy + w[i, S + 12] * dpsi
        wy = w[i, S + 1] * dx + w[i, S + 7] * dy + w[i, S + 13] * dpsi
        wz = w[i, S + 2] * dx + w[i, S + 8] * dy + w[i, S + 14] * dpsi
        ax, ay, az = L * w[i, S + 21], L * w[i, S + 22], L * w[i, S + 23]
        gx = oy * az - oz * ay + 2.0 * (w[i, S + 3] * dx + w[i, S + 9] * dy + w[i, S + 21] * dL)
        gy = oz * ax - ox * az + 2.0 * (w[i, S + 4] * dx + w[i, S + 10] * dy + w[i, S + 22] * dL)
        gz = ox * ay - oy * ax + 2.0 * (w[i, S + 5] * dx + w[i, S + 11] * dy + w[i, S + 23] * dL)
        w[i, BIAS] += oy * wz - oz * wy
        w[i, BIAS + 1] += oz * wx - ox * wz
        w[i, BIAS + 2] += ox * wy - oy * wx
        w[i, BIAS + 3] += oy * gz - oz * gy
        w[i, BIAS + 4] += oz * gx - ox * gz
        w[i, BIAS + 5] += ox * gy - oy * gx
        w[i, ARM], w[i, ARM + 1], w[i, ARM + 2] = ax, ay, az
        ox, oy, oz = ox + wx, oy + wy, oz + wz
        w[i, OMEGA], w[i, OMEGA + 1], w[i, OMEGA + 2] = ox, oy, oz
        # A ← A R(b) Rz(ψ): two columns turned by ψ, the third is R e_z.
        f, g, h = 1.0 - c2 * x * x, -c2 * x * y, 1.0 - c2 * y * y
        cos, sin = np.cos(psi), np.sin(psi)
        for r in range(3):
            m0 = A[r, 0] * f + A[r, 1] * g - A[r, 2] * c1 * x
            m1 = A[r, 0] * g + A[r, 1] * h - A[r, 2] * c1 * y
            A[r, 0] = m0 * cos + m1 * sin
            A[r, 1] = m1 * cos - m0 * sin
            A[r, 2] = w[i, S + 12 + r]
