"""Identified numbers with their 95 % confidence intervals."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

Floats = NDArray[np.float64]

CONFIDENCE = 0.95
MOST_ALIKE = 0.98
"""Neighbouring errors more alike than this leave no independent sample to count."""
BLIND = 1e-9
"""Combinations of parameters that change the fit by less than this share of the others do not change it at all."""


class Estimate(NamedTuple):
    """A number with its 95 % confidence interval."""

    value: float
    low: float
    high: float


class Spread(NamedTuple):
    """Standard deviations (p,) of fitted parameters, and the degrees of freedom behind them."""

    deviation: Floats
    freedom: float

    def interval(self, value: float, i: int = 0, *, at_least: float = -np.inf) -> Estimate:
        """Parameter i with Student's interval, cut off where the number has a least value."""
        half = student_factor(self.freedom) * float(self.deviation[i])
        return Estimate(float(value), max(float(value) - half, at_least), float(value) + half)

    def of_logarithm(self, value: float, i: int = 0) -> Estimate:
        """The number whose logarithm is parameter i."""
        half = student_factor(self.freedom) * float(self.deviation[i])
        with np.errstate(over="ignore"):
            return Estimate(float(np.exp(value)), float(np.exp(value - half)), float(np.exp(value + half)))


def student_factor(freedom: float) -> float:
    """Half-width of the interval in standard deviations."""
    return float(student.ppf(0.5 + CONFIDENCE / 2.0, max(freedom, 1.0)))


def spread(jacobian: Floats, rest: Floats, *, in_order: bool = False) -> Spread:
    """Spread of a least squares fit with Jacobian (N, p) and residuals (N,).

    Samples `in_order` of time share their errors: N then counts for N (1 − ρ)/(1 + ρ), ρ the correlation of neighbours.
    """
    count, size = jacobian.shape
    share = 1.0
    if in_order and float(rest @ rest) > 0.0:
        alike = min(max(float(rest[1:] @ rest[:-1]) / float(rest @ rest), 0.0), MOST_ALIKE)
        share = (1.0 - alike) / (1.0 + alike)
    variance = float(rest @ rest) / max(count - size, 1) / share
    # Scaled, so that parameters in different units do not spoil the inverse.
    scale = np.linalg.norm(jacobian, axis=0)
    scale[scale == 0.0] = 1.0
    _, singular, turn = np.linalg.svd(jacobian / scale, full_matrices=False)
    # What the data cannot tell at all gets an interval that says so, not none.
    singular = np.maximum(singular, BLIND * max(singular[0], BLIND))
    deviation = np.sqrt(variance * np.sum((turn / singular[:, None]) ** 2, axis=0)) / scale
    return Spread(np.asarray(deviation), max(count * share - size, 1.0))
