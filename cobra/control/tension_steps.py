"""The step of all tendons that keeps their tensions in limits and is nearest to the wanted one.

A step d (m,) of the tendons' travel bends the robot by β and trims the tendons by δ:

    d = A β + δ,    Aᵀ K δ = 0        K the tendons' stiffnesses, A = ∂Δl/∂b

Trims leave the moments alone, so what a limit asks for is taken from them first, and from the bends only where trims
cannot give it (every tendon of a section at one end of its range or the other):

    min  |δ − δ*|²_K + w |A (β − β*)|²_K    with low ≤ d ≤ high, δ ≤ slacken, w ≫ 1

All sections at once: what a distal tendon needs is known to those that it passes.
"""

import daqp
import numpy as np

from cobra.kinematics.configuration import Floats

BEND_WEIGHT = 1e4
"""w: bending counts so much more than trims."""
UNIT_M = 1e-4
"""Steps are solved for in this unit, so that the solver's tolerances mean something."""
_SOLVED = 1
"""daqp's exit flag of an optimum."""


class TensionSteps:
    """Steps of m tendons over c entries of q that they decide."""

    def __init__(self, slopes: Floats, stiffness_N_m: Floats) -> None:
        self._slopes = slopes
        relative = stiffness_N_m / stiffness_N_m.mean()
        weighted = relative[:, None] * slopes
        self._bends = np.linalg.solve(slopes.T @ weighted, weighted.T) if slopes.size else np.zeros((0, len(slopes)))
        bending = slopes @ self._bends
        self._trimming = trimming = np.ascontiguousarray(np.eye(len(slopes)) - bending)
        cost = trimming.T @ (relative[:, None] * trimming) + BEND_WEIGHT * bending.T @ (relative[:, None] * bending)
        self._cost = np.ascontiguousarray(0.5 * (cost + cost.T))
        self._sense = np.zeros(2 * len(slopes), dtype=np.intc)
        self.failures = 0
        """How often no optimum was found, and each tendon was kept in its limits by itself."""

    def bends(self, step_m: Floats) -> Floats:
        """(c,) β of a step (m,)."""
        out: Floats = self._bends @ step_m
        return out

    def trims(self, step_m: Floats) -> Floats:
        """(m,) δ of a step (m,)."""
        out: Floats = self._trimming @ step_m
        return out

    def nearest(self, wanted_m: Floats, low_m: Floats, high_m: Floats, slacken_m: Floats) -> Floats:
        """(m,) the allowed step nearest to the wanted one; `low_m` ≤ `high_m`. Its trims pay out no more than `slacken_m`."""
        if np.all((low_m <= wanted_m) & (wanted_m <= high_m)):
            return wanted_m
        wanted = wanted_m / UNIT_M
        # What is wanted anyway is no slackening.
        slacken = np.maximum(slacken_m / UNIT_M, self._trimming @ wanted)
        most = np.concatenate([high_m / UNIT_M, slacken])
        least = np.concatenate([low_m / UNIT_M, np.full(len(wanted), -np.inf)])
        x, _, flag, _ = daqp.solve(self._cost, -self._cost @ wanted, self._trimming, most, least, self._sense)
        if flag != _SOLVED or not np.all(np.isfinite(x)):
            self.failures += 1
            x = np.clip(wanted, low_m / UNIT_M, high_m / UNIT_M)
        out: Floats = UNIT_M * np.asarray(x)
        return out
