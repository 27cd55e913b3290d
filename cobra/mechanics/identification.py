"""Stiffness, damping and friction from measured data, by straight lines and linear least squares.

Equivalent stiffness from load tests (S-38): EI = τ_θ L₀/Δθ, GA = τ_φ L₀/Δφ and K = f_L/ΔL, each as the slope of load over
deflection. Damping and friction from a sweep back and forth; `release.py` takes them from a free release.
"""

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import least_squares
from scipy.stats import theilslopes

from cobra.errors import OperatorError
from cobra.mechanics.estimates import Estimate, Spread, spread
from cobra.mechanics.friction import transmission

Floats = NDArray[np.float64]
Quantity = Literal["bending", "torsion", "elongation"]
SYMBOLS: dict[Quantity, tuple[str, str]] = {
    "bending": ("EI", "N m2"),
    "torsion": ("GA", "N m2"),
    "elongation": ("K", "N/m"),
}
LEAST_POINTS = 3
LEAST_SWEEP_POINTS = 12
TURNING = 0.1
"""Around a reversal, slower than this share of the median speed, friction has no clear direction."""
OFF_LINE = 0.2
"""A point this far off its line, as a share of all load, may be in another unit,"""
ON_LINE = 0.25
"""if it comes nearer, to this share, when multiplied by a thousand or divided by it."""
MIXED = 1000.0


class StiffnessTest(NamedTuple):
    """An equivalent stiffness and the straight lines behind it."""

    quantity: Quantity
    stiffness: Estimate
    """N·m² (bending, torsion) or N/m (elongation)."""
    length_m: float
    """L₀; 1 for elongation. Load over deflection is stiffness/L₀."""
    set_names: tuple[str, ...]
    set_stiffness: Floats
    """(sets,) each set's own."""
    offsets: Floats
    """(sets,) load at zero deflection [N·m or N]."""
    nonlinearity: float
    """Root mean square of load that the lines leave, over the largest load."""


class Sweep(NamedTuple):
    """Load = k x + d x′ + f sign x′ + load₀, fitted to a recording that goes back and forth."""

    stiffness: Estimate
    damping: Estimate
    friction: Estimate
    offset: Estimate
    speed: Floats
    """(N,)"""
    used: NDArray[np.bool_]
    """(N,) samples that move clearly"""
    rms: float


def stiffness_from_load_test(
    quantity: Quantity,
    load: ArrayLike,
    deflection: ArrayLike,
    *,
    rest_length_m: float = 1.0,
    sets: ArrayLike | None = None,
) -> StiffnessTest:
    """S-38 by a line through each set of measured pairs.

    `load` is τ [N·m] or f [N], `deflection` Δθ, Δφ [rad] or ΔL [m]; `rest_length_m` is L₀ (not used for elongation).
    With several sets the interval comes from the scatter between them, else from the scatter about the line.

    Raises:
        OperatorError: too few points, no deflection, or a stiffness that is not positive.
    """
    f, x = np.asarray(load, dtype=np.float64), np.asarray(deflection, dtype=np.float64)
    labels = np.zeros(len(f), dtype=np.int64) if sets is None else np.asarray(sets)
    names = tuple(dict.fromkeys(labels.tolist()))
    length = rest_length_m if quantity != "elongation" else 1.0
    slopes, offsets, left = [], [], []
    of_line = Spread(np.zeros(1), 1.0)
    for name in names:
        rows = labels == name
        if rows.sum() < LEAST_POINTS or np.ptp(x[rows]) == 0.0:
            of = f" of set {name}" if len(names) > 1 else ""
            raise OperatorError(f"{quantity}: a line{of} needs {LEAST_POINTS} points or more at different deflections")
        design = np.stack([x[rows], np.ones(rows.sum())], axis=-1)
        solution, _, _, _ = np.linalg.lstsq(design, f[rows], rcond=None)
        rest = f[rows] - design @ solution
        slopes.append(solution[0] * length)
        offsets.append(solution[1])
        of_line = spread(design, rest)
        left.append(rest)
    value = float(np.mean(slopes))
    if value <= 0.0:
        raise OperatorError(
            f"{quantity}: the load falls as the deflection grows (by {-value / length:.4g} a unit); "
            "count both in the same direction"
        )
    if len(slopes) > 1:
        between = float(np.std(slopes, ddof=1) / np.sqrt(len(slopes)))
        scatter = Spread(np.array([between]), len(slopes) - 1.0)
    else:
        scatter = Spread(of_line.deviation * length, of_line.freedom)
    rms = float(np.sqrt(np.mean(np.concatenate(left) ** 2)) / np.abs(f).max())
    return StiffnessTest(
        quantity,
        scatter.interval(value),
        length,
        tuple(str(name) for name in names),
        np.array(slopes),
        np.array(offsets),
        rms,
    )


def points_in_another_unit(load: ArrayLike, deflection: ArrayLike) -> dict[int, str]:
    """Points far off the line through most of them, and near it once a thousand times larger or smaller."""
    f, x = np.asarray(load, dtype=np.float64), np.asarray(deflection, dtype=np.float64)
    if len(f) < LEAST_POINTS or np.ptp(x) == 0.0 or np.ptp(f) == 0.0:
        return {}
    slope, offset, _, _ = theilslopes(f, x)
    lines = f - offset - slope * x
    # The range of most, since a point in another unit would stretch that of all.
    scale = float(np.ptp(np.quantile(f, [0.1, 0.9])))
    found = {}
    for i in np.flatnonzero(np.abs(lines) > OFF_LINE * scale):
        for factor in (MIXED, 1.0 / MIXED):
            if abs(f[i] - offset - slope * factor * x[i]) < ON_LINE * abs(lines[i]):
                found[int(i)] = f"its deflection fits the others only when multiplied by {factor:g}"
            elif abs(factor * f[i] - offset - slope * x[i]) < ON_LINE * abs(lines[i]):
                found[int(i)] = f"its load fits the others only when multiplied by {factor:g}"
    return found


def fit_sweep(time_s: ArrayLike, position: ArrayLike, load: ArrayLike) -> Sweep:
    """Stiffness, damping and Coulomb friction from a slow sweep back and forth, by linear least squares.

    Damping shows only where the speed varies; its interval says whether it did.

    Raises:
        OperatorError: too few samples, or a sweep that never turns back.
    """
    time, x, f = (np.asarray(values, dtype=np.float64) for values in (time_s, position, load))
    if len(x) < LEAST_SWEEP_POINTS:
        raise OperatorError(f"a sweep needs at least {LEAST_SWEEP_POINTS} samples; this has {len(x)}")
    speed = np.gradient(x, time)
    used = np.abs(speed) > TURNING * np.median(np.abs(speed))
    if not ((speed[used] > 0.0).any() and (speed[used] < 0.0).any()):
        raise OperatorError(
            "the sweep never turns back; friction shows only as the difference between going and coming"
        )
    design = np.stack([x, speed, np.sign(speed), np.ones(len(x))], axis=-1)[used]
    solution, _, _, _ = np.linalg.lstsq(design, f[used], rcond=None)
    rest = f[used] - design @ solution
    known = spread(design, rest, in_order=True)
    stiffness, damping, friction, offset = (known.interval(value, i) for i, value in enumerate(solution))
    return Sweep(stiffness, damping, friction, offset, speed, used, float(np.sqrt(np.mean(rest**2))))


def friction_in_guiders(motor_N: ArrayLike, top_N: ArrayLike, bend_angles: ArrayLike, winding: ArrayLike) -> Estimate:
    """η of the cable's holes from motor and top tensions (N,) at known chamber angles (N, n) [rad] (S-36, S-37).

    `winding` (N,) says whether the cable moves towards the motor: F_top = F_motor g, else F_motor / g.

    Raises:
        OperatorError: too few samples, a tension that is not positive, or a cable that is straight throughout.
    """
    motor, top = np.asarray(motor_N, dtype=np.float64), np.asarray(top_N, dtype=np.float64)
    angles, sign = np.asarray(bend_angles, dtype=np.float64), np.where(np.asarray(winding, dtype=np.bool_), 1.0, -1.0)
    if len(motor) < LEAST_POINTS:
        raise OperatorError(f"friction needs at least {LEAST_POINTS} samples; there are {len(motor)}")
    if (motor <= 0.0).any() or (top <= 0.0).any():
        raise OperatorError("friction needs tensions above zero; leave out the samples where the cable hangs slack")
    if not np.abs(angles).max() > 0.0:
        raise OperatorError("the cable is straight throughout; friction in its holes shows only where it bends")
    wanted = sign * np.log(top / motor)

    def miss(eta: Floats) -> Floats:
        return np.asarray(np.log(transmission(angles, float(eta[0]))) - wanted)

    found = least_squares(miss, np.array([0.1]), bounds=(0.0, 0.99))
    return spread(found.jac, found.fun, in_order=True).interval(found.x[0], at_least=0.0)
