"""Statics and the inverse problems: postures in balance, and the cable forces for a wanted posture or motion.

Three cables decide three of the 4 n coordinates: the sums of bends and lengths. The rest follows from balance, and what the
cables, which only pull, cannot give is reported as such.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import nnls

from cobra.errors import OperatorError
from cobra.mechanics.chain import Floats, SrcBotParameters
from cobra.mechanics.dynamics import DEFAULT_STEP_S, Chain, Motion
from cobra.mechanics.friction import motor_band, transmission
from cobra.mechanics.kernels import layout
from cobra.mechanics.kernels.balance import generalised_forces, stiffness

DIFFERENCE = 1e-5
"""Step of the stiffness's central differences [rad, m]: errors of 1e-10 of the stiffness."""
ITERATIONS = 60
BALANCED_N = 1e-9
"""Residual [N, N·m] at which a posture counts as in balance; rounding leaves about 1e-12."""
LONGEST_STEP = 0.2
"""A Newton step changes no coordinate by more [rad]; lengths by this part of the chamber."""


class BalanceError(OperatorError):
    """No posture in balance was found: the loads are beyond what the robot can carry, or it buckles."""


@dataclass(frozen=True, slots=True)
class Posture:
    """A posture in balance, and what holds it."""

    q: Floats
    """(n, 4)"""
    tensions_N: Floats
    """(cables,) at the top guider, ≥ 0."""
    motor_N: tuple[Floats, Floats]
    """Least and greatest motor forces that hold it, each (cables,): friction holds the rest."""
    stable: bool
    """Whether it is a minimum of the energy, with motors that keep their force."""
    missed_bend_rad: Floats
    """(2,) wanted minus reached sum of the bend vectors."""
    missed_length_m: float
    """Wanted minus reached sum of the lengths."""
    reasons: tuple[str, ...]
    """Why the wanted posture cannot be reached, in words; empty when it is."""

    @property
    def reached(self) -> bool:
        return not self.reasons


@dataclass(frozen=True, slots=True)
class CableFit:
    """The best non-negative tensions for wanted generalised forces."""

    tensions_N: Floats
    """(cables,)"""
    residual: Floats
    """(n, 4) [N·m, N]: wanted minus given; what no cable can do."""


def equilibrium(
    parameters: SrcBotParameters, tensions_N: Floats, loads_N: Floats | None = None, guess: Floats | None = None
) -> Floats:
    """q (n, 4) in balance with tensions at the top guider (cables,), weight and forces on the guiders (n, 3).

    Raises:
        BalanceError: there is none near the guess.
    """
    loads = _loads(parameters, loads_N)
    columns = _columns(parameters)
    pulled = columns.T @ np.asarray(tensions_N, dtype=np.float64)
    empty = np.zeros((0, columns.shape[1]))
    q, _ = _balance(parameters, loads, parameters.rest if guess is None else guess, pulled, empty, np.zeros(0), empty)
    return q


def inverse_statics(
    parameters: SrcBotParameters,
    bend_rad: Sequence[float],
    length_m: float | None = None,
    loads_N: Floats | None = None,
) -> Posture:
    """The cable forces for a sum of bends (2,) and of lengths under weight and forces on the guiders (n, 3) (S-35).

    It is solved in (b_x, b_y, L), where the map is constant, not in (θ, φ, L), where it is singular when straight.
    Without a length no cable pulls more than bending takes: one at least is slack. What would take a pushing cable is
    approached as the robot does it: cables of the lengths of the wanted posture, those that would push slack.

    Raises:
        BalanceError: no posture in balance was found.
    """
    loads = _loads(parameters, loads_N)
    wanted = np.array([*bend_rad, np.nan if length_m is None else length_m], dtype=np.float64)
    solved = (
        _free_length(parameters, loads, wanted[:2]) if length_m is None else _given_length(parameters, loads, wanted)
    )
    q, tensions = solved
    return _posture(parameters, loads, wanted, q, tensions)


def inverse_dynamics(
    parameters: SrcBotParameters, q: Floats, v: Floats, a: Floats, loads_N: Floats | None = None
) -> tuple[Floats, CableFit]:
    """Generalised forces (n, 4) for a motion of all coordinates, and the cable tensions that come nearest to them."""
    wanted = generalised_forces(parameters.constants, _own(q), _own(v), _own(a), _loads(parameters, loads_N))
    return wanted, fit_tensions(parameters, wanted)


def fit_tensions(parameters: SrcBotParameters, wanted: Floats) -> CableFit:
    """The tensions ≥ 0 whose generalised forces are nearest to the wanted ones (n, 4).

    Nearest in the elastic deformation that the difference would cause, so that moments and forces can be compared.
    """
    p = parameters.constants
    scale = np.tile(1.0 / np.sqrt([p.bending, p.bending, p.torsion, p.axial]), parameters.segments)
    columns = -_columns(parameters)
    tensions, _ = nnls((columns * scale).T, wanted.ravel() * scale)
    return CableFit(tensions, wanted - (tensions @ columns).reshape(wanted.shape))


def forces_for_motion(
    parameters: SrcBotParameters,
    time_s: Floats,
    bend_rad: Floats,
    length_m: Floats,
    loads_N: Floats | None = None,
    *,
    start: Floats | None = None,
    step_s: float = DEFAULT_STEP_S,
) -> tuple[Motion, Floats]:
    """Cable tensions and motor forces along a wanted motion of the sums of bends (m, 2) and lengths (m,).

    A smooth curve (cubic spline) is laid through the wanted points. At every step the tensions are those that give the
    cables the wanted acceleration, with the whole chain's dynamics; where that takes a push the cable is slack, and the
    motion falls behind. Returns the motion and by how much it missed (m, 3): bends [rad], length [m].

    Args:
        loads_N: forces on the guiders (n, 3), or over time (m, n, 3).
        start: q (n, 4) at rest at the first time; else the posture in balance with the first point.
    """
    if start is None:
        posture = inverse_statics(
            parameters, bend_rad[0], float(length_m[0]), None if loads_N is None else _first(loads_N)
        )
        chain = Chain(parameters, posture.q, posture.tensions_N)
    else:
        chain = Chain(parameters, start)
    matrix = parameters.cable_matrix[:, [0, 1, 3]]
    wanted = np.column_stack([bend_rad, length_m])
    curve = CubicSpline(time_s, wanted @ matrix.T, bc_type="natural" if len(time_s) > 2 else "not-a-knot")
    count = max(int(np.ceil((time_s[-1] - time_s[0]) / step_s)), 1)
    fine = np.union1d(np.linspace(time_s[0], time_s[-1], count + 1), time_s)
    fine = fine[np.append(True, np.diff(fine) > layout.SMALLEST_STEP_S)]
    columns = np.concatenate([curve(fine), curve(fine, 1), curve(fine, 2)], axis=1)
    commands = np.stack([columns[:-1], columns[1:]], axis=1)
    loads = _loads_over(parameters, time_s, loads_N, fine)
    states, tensions, steps = chain.march(
        layout.MOTION, np.array([step_s]), 0.0, fine - fine[0], np.ascontiguousarray(commands), loads
    )
    keep = np.searchsorted(fine, np.asarray(time_s) - 0.5 * layout.SMALLEST_STEP_S)
    q, v = states[keep, :, : layout.V], states[keep, :, layout.V : layout.A]
    inwards = v.sum(axis=1) @ parameters.cable_matrix.T < 0.0
    low, high = motor_band(tensions[keep], transmission(np.hypot(q[..., 0], q[..., 1]), parameters.friction)[:, None])
    motion = Motion(
        parameters, "chain", np.asarray(time_s, dtype=np.float64), q, v, tensions[keep], np.where(inwards, high, low),
        np.concatenate([loads[:1, 0], loads[:, 1]])[keep],
        states[keep, :, layout.LOCKED] > 0.0, states[keep, :, layout.STOPPED] > 0.0, steps,
    )  # fmt: skip
    return motion, wanted - q[..., [0, 1, 3]].sum(axis=1)


def _own(a: Floats) -> Floats:
    """A contiguous writable copy: numba would compile anew for any other."""
    return np.array(a, dtype=np.float64)


def _loads(parameters: SrcBotParameters, loads_N: Floats | None) -> Floats:
    return np.zeros((parameters.segments, 3)) if loads_N is None else _own(loads_N)


def _first(loads_N: Floats) -> Floats:
    return loads_N if np.ndim(loads_N) == 2 else loads_N[0]


def _loads_over(parameters: SrcBotParameters, time_s: Floats, loads_N: Floats | None, fine: Floats) -> Floats:
    """(intervals, 2, n, 3)"""
    n = parameters.segments
    if loads_N is None or np.ndim(loads_N) == 2:
        return np.broadcast_to(_loads(parameters, loads_N), (len(fine) - 1, 2, n, 3)).copy()
    flat = np.asarray(loads_N, dtype=np.float64).reshape(len(time_s), -1)
    at = np.stack([np.interp(fine, time_s, column) for column in flat.T], axis=-1).reshape(len(fine), n, 3)
    return np.stack([at[:-1], at[1:]], axis=1)


def _columns(parameters: SrcBotParameters) -> Floats:
    """∂L_d/∂q (cables, 4 n)."""
    return np.tile(parameters.cable_matrix, parameters.segments)


def _given_length(parameters: SrcBotParameters, loads: Floats, wanted: Floats) -> tuple[Floats, Floats]:
    """Balance with cables of the wanted lengths; those that would push are let go one after the other."""
    columns = _columns(parameters)
    lengths = parameters.cable_matrix[:, [0, 1, 3]] @ wanted
    q = _even(parameters, wanted[:2], wanted[2])
    taut = list(range(len(columns)))
    none = np.zeros(columns.shape[1])
    for _ in range(2 ** len(columns)):
        rows = columns[taut]
        q, pulled = _balance(parameters, loads, q, none, rows, lengths[taut], rows)
        tensions = np.zeros(len(columns))
        tensions[taut] = pulled
        slack = [j for j in range(len(columns)) if j not in taut and columns[j] @ q.ravel() > lengths[j] + 1e-12]
        if taut and pulled.min() < -BALANCED_N:
            taut.pop(int(np.argmin(pulled)))
        elif slack:
            taut = sorted({*taut, slack[0]})
        else:
            return q, np.maximum(tensions, 0.0)
    raise BalanceError("no set of taut cables holds this posture")


def _free_length(parameters: SrcBotParameters, loads: Floats, bend: Floats) -> tuple[Floats, Floats]:
    """Balance at a sum of bends with one cable slack at least: the pair of cables that does it by pulling."""
    columns = _columns(parameters)
    sums = np.tile(np.eye(4)[:2], parameters.segments)
    none = np.zeros(columns.shape[1])
    best: tuple[float, Floats, Floats] | None = None
    for pair in combinations(range(len(columns)), 2):
        if abs(np.linalg.det(parameters.cable_matrix[list(pair), :2])) < 1e-12:
            continue
        guess = _even(parameters, bend, parameters.segments * parameters.rest_length_m)
        q, pulled = _balance(parameters, loads, guess, none, sums, bend, columns[list(pair)])
        if best is None or pulled.min() > best[0]:
            tensions = np.zeros(len(columns))
            tensions[list(pair)] = np.maximum(pulled, 0.0)
            best = (float(pulled.min()), q, tensions)
        if best[0] >= -BALANCED_N:
            break
    assert best is not None, "three cables round the backbone always make a pair"
    return best[1], best[2]


def _even(parameters: SrcBotParameters, bend: Floats, length: float) -> Floats:
    """Constant curvature: every chamber the same."""
    q = np.zeros((parameters.segments, 4))
    q[:, :2] = np.asarray(bend) / parameters.segments
    q[:, 3] = length / parameters.segments
    return q


def _balance(
    parameters: SrcBotParameters,
    loads: Floats,
    guess: Floats,
    pulled: Floats,
    rows: Floats,
    target: Floats,
    columns: Floats,
) -> tuple[Floats, Floats]:
    """Newton's method for ∂U/∂q + pulled + columnsᵀ F = 0 and rows q = target: q (n, 4) and F."""
    c = parameters.constants
    still = np.zeros_like(guess)
    q, force = guess.copy(), np.zeros(len(columns))
    limit = np.tile(
        [LONGEST_STEP, LONGEST_STEP, LONGEST_STEP, LONGEST_STEP * parameters.rest_length_m], parameters.segments
    )
    size, m = q.size, len(rows)
    matrix = np.zeros((size + m, size + m))
    for _ in range(ITERATIONS):
        residual = generalised_forces(c, q, still, still, loads).ravel() + pulled + columns.T @ force
        error = rows @ q.ravel() - target
        if max(np.abs(residual).max(), np.abs(error).max(initial=0.0)) < BALANCED_N:
            return q, force
        matrix[:size, :size] = stiffness(c, q, loads, DIFFERENCE)
        matrix[:size, size:] = columns.T
        matrix[size:, :size] = rows
        try:
            change = np.linalg.solve(matrix, -np.concatenate([residual, error]))
        except np.linalg.LinAlgError:
            break
        shorten = min(1.0, float(np.min(limit / np.maximum(np.abs(change[:size]), 1e-300))))
        q = q + shorten * change[:size].reshape(q.shape)
        force = force + shorten * change[size:]
        if not np.isfinite(q).all() or np.abs(q).max() > 10.0:
            break
    raise BalanceError(
        "no posture in balance was found: the loads are more than the robot can carry, or it buckles under them"
    )


def _posture(parameters: SrcBotParameters, loads: Floats, wanted: Floats, q: Floats, tensions: Floats) -> Posture:
    hessian = stiffness(parameters.constants, q, loads, DIFFERENCE)
    stable = bool(np.linalg.eigvalsh(0.5 * (hessian + hessian.T))[0] > 0.0)
    reached = q[:, [0, 1, 3]].sum(axis=0)
    missed = np.where(np.isnan(wanted), 0.0, wanted - reached)
    reasons = []
    if np.abs(missed[:2]).max() > 1e-6 or abs(missed[2]) > 1e-8:
        slack = ", ".join(str(j + 1) for j in np.flatnonzero(tensions <= 0.0))
        reasons.append(f"cable {slack} would have to push")
    short = np.flatnonzero(q[:, 3] < parameters.locked_length_m)
    if len(short):
        reasons.append(
            f"chamber {short[0] + 1} would be {q[short[0], 3] * 1e3:.4g} mm long, shorter than its stop allows"
        )
    g = transmission(np.hypot(q[:, 0], q[:, 1]), parameters.friction)
    return Posture(q, tensions, motor_band(tensions, g), stable, missed[:2], float(missed[2]), tuple(reasons))
