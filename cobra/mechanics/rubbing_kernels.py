"""The compiled half of `rubbing.py`: tendons that rub, and the shape in balance with them, tick after tick.

m tendons of P elements from the motor on (the conduit's parts, then one in each section), n sections, c columns of q that
the tendons decide. Element p is stretched by e and carries T = k max(0, e). Between p and p + 1 friction holds while the
ratio of the tensions is within [1/c, c], c = exp(μ θ), and slides to the edge of that cone else.
"""

from typing import Any

import numpy as np

from cobra.kinematics.kernels import compiled, positions_at

MAX_ITERATIONS = 12
MAX_TRIES = 20
LEAST_N = 1e-9
TOLERANCE_Nm = 1e-7
FINITE_STEP_RAD = 1e-5
LARGEST_STEP_RAD = 0.05
HALVINGS = 5
MAX_REACHES = 25
REACHED_RAD = 1e-4


@compiled
def _share(stretch: Any, stiffness: Any, capstan: Any, slides: Any, count: int, out: Any, slip: Any) -> None:
    """Extensions `out` of one tendon whose nodes slide as told (1: towards the tip, −1: towards the motor, 0: not)."""
    p = 0
    while p < count:
        end, ratio, compliance, total = p, 1.0, 1.0 / stiffness[p], stretch[p]
        out[p] = 1.0
        while end < count - 1 and slides[end] != 0:
            ratio *= 1.0 / capstan[end] if slides[end] > 0 else capstan[end]
            end += 1
            out[end] = ratio
            compliance += ratio / stiffness[end]
            total += stretch[end]
        gone = 0.0
        for i in range(p, end + 1):
            out[i] *= total / compliance / stiffness[i]
            gone += stretch[i] - out[i]
            slip[i] = gone
        p = end + 1


@compiled
def relax(extension: Any, stiffness: Any, capstan: Any, counts: Any, slides: Any, tension: Any) -> None:
    """Let slide what must: changes `extension`, fills `tension` (m, P).

    A linear complementarity problem for each tendon: a node slides only at the edge of its cone and only the way its
    tensions push. Found by trying: who left the cone slides, who slid the wrong way sticks (`slides` is the first guess).
    """
    most = extension.shape[1]
    out, slip = np.empty(most), np.empty(most)
    for j in range(extension.shape[0]):
        n = counts[j]
        for _ in range(MAX_TRIES):
            _share(extension[j], stiffness[j], capstan[j], slides[j], n, out, slip)
            settled = True
            for p in range(n - 1):
                if slides[j, p] * slip[p] < 0.0:
                    slides[j, p] = 0
                    settled = False
                elif slides[j, p] == 0:
                    here = max(0.0, out[p]) * stiffness[j, p]
                    there = max(0.0, out[p + 1]) * stiffness[j, p + 1]
                    if here > capstan[j, p] * there + LEAST_N:
                        slides[j, p], settled = 1, False
                    elif there > capstan[j, p] * here + LEAST_N:
                        slides[j, p], settled = -1, False
            if settled:
                break
        for p in range(n):
            extension[j, p] = out[p]
            tension[j, p] = max(0.0, out[p]) * stiffness[j, p]


@compiled
def _unbalance(
    base: Any, moved: Any, b: Any, robot: Any, hole: float, weight: Any, drag: Any, room: Any, out: Any
) -> None:
    """Moments missing from balance (c,) once the bends `b` have moved by `moved`; the relaxed tendons are left in `room`."""
    slopes, column_section, bending, stiffness, counts, parts = robot
    extension, capstan, tension, slides = room
    m, c = slopes.shape
    angle = np.zeros(bending.shape[0])
    for i in range(c):
        angle[column_section[i]] += (b[i] + moved[i]) ** 2
    for j in range(m):
        for p in range(counts[j]):
            extension[j, p] = base[j, p]
        for i in range(c):
            p = parts + column_section[i]
            if p < counts[j]:
                extension[j, p] += slopes[j, i] * moved[i]
        before = 0.0
        for k in range(counts[j] - parts):
            half = 0.5 * np.sqrt(angle[k])
            capstan[j, parts - 1 + k] = np.exp(hole * (before + half))
            before = half
    relax(extension, stiffness, capstan, counts, slides, tension)
    for i in range(c):
        k = column_section[i]
        total = -bending[k] * (b[i] + moved[i]) - weight[i] - drag[k] * moved[i]
        for j in range(m):
            if parts + k < counts[j]:
                total -= slopes[j, i] * tension[j, parts + k]
        out[i] = total


@compiled
def advance(state: Any, b: Any, paid_out: Any, robot: Any, hole: float, weight: Any, drag: Any, room: Any) -> None:
    """Move the motor ends by `paid_out` (m,) [m] and find the bends (c,) in balance: changes `state`, `b` and `room`.

    `drag` (n,) [N·m/rad] resists the step, as damping does within its duration.
    """
    c = b.shape[0]
    base = state.copy()
    for j in range(base.shape[0]):
        base[j, 0] -= paid_out[j]
    missing, beside, moved, J = np.empty(c), np.empty(c), np.zeros(c), np.empty((c, c))
    _unbalance(base, moved, b, robot, hole, weight, drag, room, missing)
    for _ in range(MAX_ITERATIONS):
        if np.max(np.abs(missing)) < TOLERANCE_Nm:
            break
        for k in range(c):
            moved[k] += FINITE_STEP_RAD
            _unbalance(base, moved, b, robot, hole, weight, drag, room, beside)
            moved[k] -= FINITE_STEP_RAD
            for i in range(c):
                J[i, k] = (beside[i] - missing[i]) / FINITE_STEP_RAD
        step = np.linalg.solve(J, missing)
        scale = min(1.0, LARGEST_STEP_RAD / np.max(np.abs(step)))
        before = np.sum(missing**2)
        # Friction makes kinks: a full step may jump over one and back.
        for _halving in range(HALVINGS):
            _unbalance(base, moved - scale * step, b, robot, hole, weight, drag, room, missing)
            if np.sum(missing**2) < (1.0 - 0.5 * scale) * before:
                break
            scale *= 0.5
        moved -= scale * step
    b += moved
    state[:] = room[0]


@compiled
def reach(
    state: Any,
    b: Any,
    goal: Any,
    paid_out: Any,
    robot: Any,
    hole: float,
    weight: Any,
    room: Any,
    inverse: Any,
    tolerance: Any,
    out: Any,
) -> None:
    """Let the motor ends also pay out slopes · `out` (c,), as far as balances the bends `goal` after `paid_out`.

    `inverse` is that of the moments by which a unit of `out` changes the balance when all friction slides: while it
    sticks the balance does not answer, and each turn of the iteration goes a little further until it does. What is
    short of the goal by up to tolerance[0] (c,) [rad], or beyond it by up to tolerance[1], is left as it is.
    """
    slopes = robot[0]
    m, c = slopes.shape
    base, missing, moved = state.copy(), np.empty(c), goal - b
    still, left = np.zeros(robot[2].shape[0]), np.zeros(c)
    for turn in range(MAX_REACHES):
        for j in range(m):
            base[j, 0] = state[j, 0] - paid_out[j]
            for i in range(c):
                base[j, 0] -= slopes[j, i] * out[i]
        _unbalance(base, moved, b, robot, hole, weight, still, room, missing)
        step = inverse @ missing
        if turn == 0:
            left = np.minimum(np.maximum(step, -tolerance[0]), tolerance[1])
        step -= left
        out -= step
        if np.max(np.abs(step)) < REACHED_RAD:
            break


@compiled
def weight_moments(q: Any, columns: Any, layout: Any, lengths_m: Any, active_m: float, arc_m: Any, force: Any) -> Any:
    """(c,) ∂U/∂q of the weight: `force` (points, 3) [N] acts at the arc lengths `arc_m`."""
    out = np.empty(columns.shape[0])
    own = q.copy()
    for i in range(columns.shape[0]):
        own[columns[i]] += FINITE_STEP_RAD
        ahead = positions_at(own, layout, lengths_m, active_m, arc_m)
        own[columns[i]] -= 2.0 * FINITE_STEP_RAD
        behind = positions_at(own, layout, lengths_m, active_m, arc_m)
        own[columns[i]] += FINITE_STEP_RAD
        out[i] = -np.sum((ahead - behind) * force) / (2.0 * FINITE_STEP_RAD)
    return out


@compiled
def march(
    state: Any,
    q: Any,
    shafts: Any,
    others: Any,
    end: Any,
    half_play: Any,
    columns: Any,
    robot: Any,
    hole: float,
    drag: Any,
    room: Any,
    body: Any,
) -> Any:
    """Follow shafts (N, m) [m paid out] and q's other entries (N, size): tensions at the motors (N, m) and bends (N, c).

    `end` (m,) is where in the play the spools stand; it, `state` and `q` are changed.
    """
    layout, lengths_m, active_m, arc_m, force = body
    count, m = shafts.shape
    tensions = np.zeros((count, m))
    bends = np.empty((count, columns.shape[0]))
    b = np.empty(columns.shape[0])
    paid = np.empty(m)
    for t in range(count):
        for j in range(m):
            at = min(max(end[j], shafts[t, j] - half_play[j]), shafts[t, j] + half_play[j])
            paid[j] = at - end[j]
            end[j] = at
        b[:] = q[columns]
        q[:] = others[t]
        q[columns] = b
        weight = weight_moments(q, columns, layout, lengths_m, active_m, arc_m, force)
        advance(state, b, paid, robot, hole, weight, drag, room)
        q[columns] = b
        tensions[t] = room[2][:, 0]
        bends[t] = b
    return tensions, bends
