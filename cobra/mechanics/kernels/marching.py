"""The march through time: steps, what happens inside them, and the size they need."""

from typing import Any

import numpy as np

from cobra.mechanics.kernels.articulated import _articulate
from cobra.mechanics.kernels.cables import GRAM, _pull
from cobra.mechanics.kernels.compiling import compiled
from cobra.mechanics.kernels.layout import (
    BENT,
    FINE,
    HELD,
    LARGEST_BEND_RAD,
    LARGEST_STRETCH,
    LARGEST_TWIST_RAD,
    LOAD,
    LOCKED,
    MIDDLE,
    NOT_FINITE,
    PUSH,
    RATE,
    SMALLEST_STEP_S,
    STATE_COLUMNS,
    STOPPED,
    STRETCHED,
    STUCK,
    TENSION,
    TWISTED,
    A,
    Q,
    V,
)
from cobra.mechanics.kernels.segment import _sweep

NOTHING, STOPS, UNLOCKS = 0, 1, 2
"""Events of a chamber within a step."""
CONTACT_SUBSTEPS = 8
"""Into which a step is cut while some chambers touch and others do not."""
EVENT_BUDGET = 32
"""Substeps a chamber may cause in one step: a bound on chattering."""


@compiled
def _copy(source: Any, to: Any) -> None:
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            to[i, j] = source[i, j]


@compiled
def _step(
    c: Any, cables: Any, kind: int, command: Any, h: float, state: Any, rope: Any, w: Any, frame: Any, M: Any, p: Any, t: Any
) -> None:  # fmt: skip
    """One step of the linearly implicit midpoint rule: second order, one articulated solve.

    M, forces and springs at q + h/2 q̇, dampers and springs implicit, velocity products at a q̇ predicted by the last
    acceleration.
    """
    half = 0.5 * h
    for i in range(state.shape[0]):
        for j in range(4):
            w[i, MIDDLE + j] = state[i, Q + j] + half * state[i, V + j]
            w[i, RATE + j] = state[i, V + j] + half * state[i, A + j]
            w[i, HELD + j] = state[i, STOPPED] if j == 3 else state[i, LOCKED]
    _sweep(w, frame)
    _articulate(c, cables, state, h, w, M, p)
    _pull(c, cables, kind, command, rope, h, w, t)
    answer = PUSH + 4 * p.shape[0]
    for i in range(state.shape[0]):
        for j in range(4):
            a = w[i, answer + j]
            for m in range(rope.shape[1]):
                a += w[i, answer + 4 * (1 + m) + j] * rope[TENSION, m]
            state[i, A + j] = a
            state[i, Q + j] += h * (state[i, V + j] + half * a)
            state[i, V + j] += h * a


@compiled
def _advance(
    c: Any, cables: Any, kind: int, command: Any, h: float, state: Any, rope: Any, spare: Any, spare_rope: Any, w: Any,
    frame: Any, M: Any, p: Any, t: Any,
) -> Any:  # fmt: skip
    """A step and what happens inside it, each event at its own moment: (verdict, segment).

    The stop at the locked length only pushes; what it catches loses its rate in an inelastic impact, and with it bend
    and twist, where the chamber is straight enough for the slots. They let go at the unlocking length.
    """
    n = state.shape[0]
    left = h
    for _ in range(EVENT_BUDGET * n):
        touching = 0.0
        for i in range(n):
            touching += state[i, STOPPED]
        # Between chambers that touch and chambers that do not, waves run within a millisecond.
        size = min(left, h / CONTACT_SUBSTEPS) if 0.0 < touching < n else left
        _copy(state, spare)
        _copy(rope, spare_rope)
        _step(c, cables, kind, command, size, state, rope, w, frame, M, p, t)
        event, who, part = _crossing(c, spare, state, size)
        if event == NOTHING:
            _release(state, rope, w, p.shape[0])
        else:
            size = part
            _copy(spare, state)
            _copy(spare_rope, rope)
            if size > 0.0:
                _step(c, cables, kind, command, size, state, rope, w, frame, M, p, t)
            if event == UNLOCKS:
                state[who, LOCKED] = 0.0
            else:
                x, y = state[who, Q], state[who, Q + 1]
                state[who, STOPPED] = 1.0
                if x * x + y * y <= c.lock_bend * c.lock_bend:
                    state[who, LOCKED] = 1.0
                state[who, Q + 3] = c.locked
                _step(c, cables, kind, command, SMALLEST_STEP_S, state, rope, w, frame, M, p, t)
                # The accelerations of the impact say nothing about those that follow.
                for i in range(n):
                    for j in range(4):
                        state[i, A + j] = 0.0
        left -= size
        if left <= SMALLEST_STEP_S:
            break
    return _verdict(c, state)


@compiled
def _release(state: Any, rope: Any, w: Any, columns: int) -> None:
    """A stop that would have to pull lets go."""
    stop = PUSH + 8 * columns
    for i in range(state.shape[0]):
        if state[i, STOPPED] > 0.0:
            force = w[i, stop]
            for m in range(rope.shape[1]):
                force += w[i, stop + 1 + m] * rope[TENSION, m]
            if force < 0.0:
                state[i, STOPPED] = 0.0


@compiled
def _crossing(c: Any, before: Any, after: Any, h: float) -> Any:
    """The first chamber of a step of constant accelerations to reach its stop or its unlocking: (event, chamber, time)."""
    event, who, first = NOTHING, 0, h
    for i in range(after.shape[0]):
        kind, sign, gap = NOTHING, 1.0, 0.0
        if before[i, STOPPED] == 0.0 and after[i, Q + 3] < c.locked:
            kind, sign, gap = STOPS, -1.0, max(before[i, Q + 3] - c.locked, 0.0)
        elif before[i, LOCKED] > 0.0 and after[i, Q + 3] >= c.unlocked:
            kind, gap = UNLOCKS, max(c.unlocked - before[i, Q + 3], 0.0)
        if kind != NOTHING:
            speed = sign * before[i, V + 3]
            gain = sign * (after[i, V + 3] - before[i, V + 3]) / h
            root = speed + np.sqrt(max(speed * speed + 2.0 * gain * gap, 0.0))
            time = min(2.0 * gap / root, h) if root > 0.0 else 0.0
            if event == NOTHING or time < first:
                event, who, first = kind, i, time
    return event, who, first


@compiled
def _verdict(c: Any, state: Any) -> Any:
    """Whether the state is still that of a robot, and the first segment where it is not."""
    for i in range(state.shape[0]):
        x, y, psi, L = state[i, Q], state[i, Q + 1], state[i, Q + 2], state[i, Q + 3]
        if not np.isfinite(x + y + psi + L + state[i, V] + state[i, V + 1] + state[i, V + 2] + state[i, V + 3]):
            return NOT_FINITE, i
        if x * x + y * y > LARGEST_BEND_RAD * LARGEST_BEND_RAD:
            return BENT, i
        if abs(psi) > LARGEST_TWIST_RAD:
            return TWISTED, i
        if not 0.0 < L < LARGEST_STRETCH * c.rest:
            return STRETCHED, i
    return FINE, 0


@compiled
def march(
    c: Any, cables: Any, kind: int, size: Any, tolerance: float, times: Any, commands: Any, loads: Any, state: Any,
    rope: Any, states: Any, tensions: Any,
) -> Any:  # fmt: skip
    """From mark to mark, in place: (verdict, segment, time, steps); `states` and `tensions` get every mark reached.

    commands (marks − 1, 2, columns) and loads (marks − 1, 2, n, 3) hold each interval's values at its beginning and
    end. `size` (1,) is the step [s]; with a tolerance > 0 [m] it is halved or stretched so that a step and its two
    halves agree within it, and keeps the size found. State (n, STATE_COLUMNS) and rope (2, cables) as in `layout.py`.
    """
    n, k = state.shape[0], cables.shape[0]
    w = np.zeros((n, PUSH + 9 * (1 + k)))
    frame, M, p, t = np.zeros((3, 3)), np.zeros((6, 6)), np.zeros((1 + k, 6)), np.zeros((GRAM + k, k))
    spare, start, coarse = np.zeros((n, STATE_COLUMNS)), np.zeros((n, STATE_COLUMNS)), np.zeros((n, STATE_COLUMNS))
    spare_rope, start_rope = np.zeros((2, k)), np.zeros((2, k))
    command = np.zeros(commands.shape[2])
    steps = 0
    adaptive = tolerance > 0.0
    for mark in range(times.shape[0] - 1):
        span = times[mark + 1] - times[mark]
        count = max(np.ceil(span / size[0] - 1e-9), 1.0)
        done = 0.0
        while span - done > SMALLEST_STEP_S:
            h = min(size[0], span - done) if adaptive else span / count
            verdict, segment = FINE, 0
            if adaptive:
                _copy(state, start)
                _copy(rope, start_rope)
            for trial in range(3 if adaptive else 1):
                # Once the whole step; and, to judge it, in two halves from the same start.
                part = h if trial == 0 else 0.5 * h
                begin = done + 0.5 * h if trial == 2 else done
                if trial == 1:
                    _copy(state, coarse)
                    _copy(start, state)
                    _copy(start_rope, rope)
                if verdict == FINE:
                    at = (begin + 0.5 * part) / span
                    for m in range(command.shape[0]):
                        command[m] = commands[mark, 0, m] + at * (commands[mark, 1, m] - commands[mark, 0, m])
                    for i in range(n):
                        for r in range(3):
                            w[i, LOAD + r] = loads[mark, 0, i, r] + at * (loads[mark, 1, i, r] - loads[mark, 0, i, r])
                    verdict, segment = _advance(
                        c, cables, kind, command, part, state, rope, spare, spare_rope, w, frame, M, p, t
                    )
                    steps += 1
            if adaptive:
                error = _distance(c, state, coarse)
                if (verdict != FINE or error > tolerance) and h > 2.0 * SMALLEST_STEP_S:
                    _copy(start, state)
                    _copy(start_rope, rope)
                    size[0] = 0.5 * h
                    continue
                if verdict == FINE and error > tolerance:
                    verdict = STUCK
                if h == size[0]:
                    size[0] = h * min(2.0, 0.9 * (tolerance / max(error, 1e-3 * tolerance)) ** (1.0 / 3.0))
            done += h
            if verdict != FINE:
                return verdict, segment, times[mark] + done, steps
        for i in range(n):
            for j in range(STATE_COLUMNS):
                states[mark + 1, i, j] = state[i, j]
        for m in range(k):
            tensions[mark + 1, m] = rope[TENSION, m]
    return FINE, 0, times[-1], steps


@compiled
def _distance(c: Any, a: Any, b: Any) -> float:
    """How far two states are apart [m]: lengths, and angles times the robot's rest length."""
    reach = c.rest * a.shape[0]
    largest = 0.0
    for i in range(a.shape[0]):
        for j in range(4):
            lever = 1.0 if j == 3 else reach
            largest = max(largest, lever * abs(a[i, Q + j] - b[i, Q + j]))
    return largest
