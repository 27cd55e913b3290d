"""Damping and friction from a free release: a part is let go at rest, swings and comes to rest again.

The motion x″ + 2 ζ ω x′ + ω² (x + x_c sign x′) = 0 is solved exact swing by swing and fitted as a whole, so that viscous
damping (the swings shrink in proportion) and Coulomb friction (they shrink by equal steps, and stop) are told apart.
"""

from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import OptimizeResult, least_squares

from cobra.errors import OperatorError
from cobra.mechanics.estimates import Estimate, spread

Floats = NDArray[np.float64]

LEAST_SAMPLES = 12
ONSET = 0.02
"""It was let go where it has moved this share of its swing."""
CROSSING = 0.1
"""Swings under this share of the first one do not count as crossings of rest."""
RATIOS = (0.02, 0.2, 0.8, 2.0)
FRICTIONS = (0.003, 0.01, 0.03, 0.1)
"""Damping ratios, and friction as a share of the swing, from which the fit starts: it has many local minima, since the
number of swings before friction holds is a whole one."""
HOPEFUL = 12
"""Of these starts, as many as are followed."""
NEAR = (0.7, 1.4, 0.85, 1.2, 0.95, 1.05)
"""Once more from the best fit, with its friction times these."""


class Release(NamedTuple):
    """A fitted release."""

    natural_rad_s: Estimate
    """ω"""
    damping_ratio: Estimate
    """ζ"""
    friction: Estimate
    """x_c, the half-width of the band in which friction holds: τ_c/k, in the unit of x"""
    rest: Estimate
    """Where the spring is at rest"""
    begin_s: float
    """When it was let go"""
    fitted: Floats
    """(N,)"""
    rms: float


class Coefficients(NamedTuple):
    """What a release says once the stiffness is known."""

    inertia: float
    damping: Estimate
    friction: Estimate


def release_motion(
    time_s: ArrayLike, start: float, omega: float, zeta: float, friction: float, rest: float, *, begin_s: float = 0.0
) -> Floats:
    """Position (N,) of a body held at `start` and let go at `begin_s`.

    Each swing between two reversals is a damped oscillation about a centre that friction shifts by `friction` against the
    motion; it ends where the spring cannot overcome friction. A motion with ζ ≥ 1 has one swing only.
    """
    time = np.asarray(time_s, dtype=np.float64)
    out = np.full(len(time), start)
    begin, place = begin_s, start
    period = np.pi / (omega * np.sqrt(1.0 - zeta * zeta)) if zeta < 1.0 else np.inf
    at = int(np.searchsorted(time, begin))
    while abs(place - rest) > friction and at < len(time):
        centre = rest + friction * np.sign(place - rest)
        to = int(np.searchsorted(time, begin + period))
        out[at:to] = centre + (place - centre) * _decay(time[at:to] - begin, omega, zeta)
        if not np.isfinite(period):
            return out
        begin, at = begin + period, to
        place = centre + (place - centre) * float(_decay(np.array([period]), omega, zeta)[0])
    out[at:] = place
    return out


def _decay(time: Floats, omega: float, zeta: float) -> Floats:
    """Unit release from rest of a damped oscillator."""
    if zeta < 1.0:
        rate = omega * np.sqrt(1.0 - zeta * zeta)
        return np.asarray(
            np.exp(-zeta * omega * time) * (np.cos(rate * time) + zeta * omega / rate * np.sin(rate * time))
        )
    root = omega * np.sqrt(zeta * zeta - 1.0)
    fast, slow = zeta * omega + root, omega * omega / (zeta * omega + root)
    if fast - slow < 1e-9 * fast:
        return np.asarray((1.0 + omega * time) * np.exp(-omega * time))
    return np.asarray((fast * np.exp(-slow * time) - slow * np.exp(-fast * time)) / (fast - slow))


def fit_release(time_s: ArrayLike, position: ArrayLike) -> Release:
    """ω, ζ and friction from a free release. The recording may begin before it is let go, and goes on until it rests.

    Raises:
        OperatorError: too few samples, or nothing moves.
    """
    time, x = np.asarray(time_s, dtype=np.float64), np.asarray(position, dtype=np.float64)
    if len(x) < LEAST_SAMPLES or np.ptp(x) == 0.0:
        raise OperatorError(
            f"a release needs at least {LEAST_SAMPLES} samples of something that moves; "
            f"this has {len(x)} between {x.min():g} and {x.max():g}"
        )
    first, time = float(time[0]), time - time[0]
    swing = float(np.ptp(x))
    rest = float(np.mean(x[-max(len(x) // 10, 1) :]))
    onset = max(int(np.argmax(np.abs(x - np.median(x[:3])) > ONSET * swing)) - 1, 0)
    step = float(np.median(np.diff(time)))

    def motion(p: Floats) -> Floats:
        return release_motion(time, p[0], np.exp(p[1]), np.exp(p[2]), abs(p[3]), p[4], begin_s=p[5])

    def fit(guess: Floats) -> OptimizeResult:
        return least_squares(
            lambda p: motion(p) - x,
            guess,
            x_scale=[swing, 1.0, 1.0, 0.1 * swing, 0.1 * swing, step],
            bounds=([*[-np.inf] * 5, -1e-6 * step], np.inf),
            diff_step=1e-5,
        )

    before = float(x[: onset + 1].mean())
    starts = [
        np.array([before, np.log(w), np.log(z), f * swing, rest, time[onset]])
        for w, z, f in product(_frequencies(time[onset:], x[onset:] - rest), RATIOS, FRICTIONS)
    ]
    hopeful = sorted(starts, key=lambda p: float(np.sum((motion(p) - x) ** 2)))[:HOPEFUL]
    best = min((fit(start) for start in hopeful), key=lambda found: found.cost)
    for factor in NEAR:
        nudged = fit(np.concatenate([best.x[:3], [factor * best.x[3]], best.x[4:]]))
        best = min(best, nudged, key=lambda found: found.cost)
    _, log_omega, log_zeta, friction, rest, begin = best.x
    known = spread(best.jac, best.fun, in_order=True)
    return Release(
        known.of_logarithm(log_omega, 1),
        known.of_logarithm(log_zeta, 2),
        known.interval(abs(friction), 3, at_least=0.0),
        known.interval(rest, 4),
        first + float(begin),
        motion(best.x),
        float(np.sqrt(np.mean(best.fun**2))),
    )


def coefficients(release: Release, stiffness: float) -> Coefficients:
    """Inertia k/ω², damping 2 ζ k/ω and friction k x_c from the stiffness k in the same coordinate."""
    omega, zeta = release.natural_rad_s, release.damping_ratio
    return Coefficients(
        stiffness / omega.value**2,
        Estimate(*(2.0 * z * stiffness / omega.value for z in zeta)),
        Estimate(*(stiffness * f for f in release.friction)),
    )


def _frequencies(time: Floats, x: Floats) -> list[float]:
    """Starts for ω: from the crossings of rest, and from the time in which most of the motion is over."""
    largest = float(np.abs(x).max())
    side = np.sign(x[np.abs(x) > CROSSING * largest])
    when = time[np.abs(x) > CROSSING * largest]
    crossings = when[1:][np.diff(side) != 0]
    starts = []
    if len(crossings) > 1:
        starts.append(float(np.pi / np.median(np.diff(crossings))))
    over = np.flatnonzero(np.abs(x) > np.exp(-1.0) * largest)
    settled = max(float(time[min(over[-1] + 1, len(time) - 1)] - time[0]), float(time[1] - time[0]))
    return [*starts, 1.0 / settled, 5.0 / settled]
