"""Cables: their lengths, what they pull with friction, and the tensions in balance with the chain's answer."""

from typing import Any

from cobra.mechanics.kernels.compiling import compiled
from cobra.mechanics.kernels.layout import LENGTH, LENGTHS, MIDDLE, MOTION, PUSH, RATE, SINE, TENSION

SWEEPS = 20
ACCURACY_N = 1e-9
FREE, LONG, FORCE, GRAM = 0, 1, 2, 3
"""Rows of the scratch array: answer without tensions, lengths, tensions, then answer to each tension."""


@compiled
def _lengths(cables: Any, rows: Any, at: int, out: Any, row: int) -> None:
    """L_d of every cable (S-8) [m] from the coordinates that stand in the columns from `at` on; or its rate, from rates."""
    x = y = psi = L = 0.0
    for i in range(rows.shape[0]):
        x += rows[i, at]
        y += rows[i, at + 1]
        psi += rows[i, at + 2]
        L += rows[i, at + 3]
    for m in range(cables.shape[0]):
        out[row, m] = cables[m, 0] * x + cables[m, 1] * y + cables[m, 2] * psi + cables[m, 3] * L


@compiled
def _law(c: Any, kind: int, command: float, g: float, length: float, before: float, tension: float) -> Any:
    """Tension at the top guider [N] and its slope by the cable's length [N/m]: `friction.top_tension` at this length.

    Between the two sliding limits the cable sticks in the guiders, and only its own elasticity gives.
    """
    motor, slope = command, 0.0
    if kind == LENGTHS:
        slope = c.cable_stiffness
        motor = slope * (length - command)
        if motor <= 0.0:
            return 0.0, 0.0
    trial = tension + c.cable_stiffness * (length - before)
    if trial <= motor * g:
        return motor * g, slope * g
    if trial >= motor / g:
        return motor / g, slope / g
    return trial, c.cable_stiffness


@compiled
def _pull(c: Any, cables: Any, kind: int, command: Any, rope: Any, h: float, w: Any, t: Any) -> None:
    """Tensions at the middle of the step into `rope`, in balance with the cables' lengths there.

    The lengths answer linearly, y = y₀ − h²/4 G F, the law is piecewise linear: Newton, one cable after the other,
    until none changes. `t` is scratch.
    """
    k = cables.shape[0]
    answer = PUSH + 4 * (1 + k)
    # All segments have the same cable columns, so their answers are summed first.
    for m in range(1 + k):
        x = y = psi = L = 0.0
        for i in range(w.shape[0]):
            at = answer + 4 * m
            x += w[i, at]
            y += w[i, at + 1]
            psi += w[i, at + 2]
            L += w[i, at + 3]
        for a in range(k):
            total = cables[a, 0] * x + cables[a, 1] * y + cables[a, 2] * psi + cables[a, 3] * L
            if m == 0:
                t[FREE, a] = total
            else:
                t[GRAM + m - 1, a] = -total
    for a in range(k):
        t[FORCE, a] = rope[TENSION, a]
    _lengths(cables, w, MIDDLE, t, LONG)
    if kind == MOTION:
        _follow(c, cables, command, w, t)
    else:
        _balance(c, kind, command, rope, h, w, t)
    for a in range(k):
        rope[TENSION, a] = t[FORCE, a]
        rope[LENGTH, a] = t[LONG, a]


@compiled
def _balance(c: Any, kind: int, command: Any, rope: Any, h: float, w: Any, t: Any) -> None:
    k = rope.shape[1]
    quarter = 0.25 * h * h
    g, last = 1.0, 1.0
    for i in range(w.shape[0]):
        last = 1.0 - c.friction * w[i, SINE]
        g *= last * last
    g /= last
    for a in range(k):
        t[LONG, a] += quarter * t[FREE, a]
        for b in range(k):
            t[LONG, a] -= quarter * t[GRAM + b, a] * t[FORCE, b]
    for _ in range(SWEEPS):
        largest = 0.0
        for a in range(k):
            force, slope = _law(c, kind, command[a], g, t[LONG, a], rope[LENGTH, a], rope[TENSION, a])
            change = (force - t[FORCE, a]) / (1.0 + slope * quarter * t[GRAM + a, a])
            t[FORCE, a] += change
            for b in range(k):
                t[LONG, b] -= quarter * t[GRAM + a, b] * change
            largest = max(largest, abs(change))
        if largest < ACCURACY_N:
            break


@compiled
def _follow(c: Any, cables: Any, command: Any, w: Any, t: Any) -> None:
    """Tensions F ≥ 0 that give the cables the wanted acceleration (the inverse of S-34), projected Gauss-Seidel.

    The command holds lengths, rates and accelerations; errors fade as a critically damped oscillator does.
    """
    k = cables.shape[0]
    for a in range(k):
        error = command[a] - t[LONG, a]
        t[FREE, a] -= command[2 * k + a] + c.follow * c.follow * error + 2.0 * c.follow * command[k + a]
    x = y = psi = L = 0.0
    for i in range(w.shape[0]):
        x += w[i, RATE]
        y += w[i, RATE + 1]
        psi += w[i, RATE + 2]
        L += w[i, RATE + 3]
    for a in range(k):
        rate = cables[a, 0] * x + cables[a, 1] * y + cables[a, 2] * psi + cables[a, 3] * L
        t[FREE, a] += 2.0 * c.follow * rate
    for _ in range(10 * SWEEPS):
        largest = 0.0
        for a in range(k):
            excess = t[FREE, a]
            for b in range(k):
                excess -= t[GRAM + b, a] * t[FORCE, b]
            force = max(0.0, t[FORCE, a] + excess / t[GRAM + a, a])
            largest = max(largest, abs(force - t[FORCE, a]))
            t[FORCE, a] = force
        if largest < ACCURACY_N:
            break
