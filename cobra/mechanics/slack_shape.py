"""The shape of a robot with chambers whose cables may hang slack: a cable holds a length, it does not push.

Of the shapes that the paid-out cables allow, the chambers take the one with the least energy (S-38, and the bending
stiffness of the section):

    min  ½ Σ EI/L |b|² + ½ Σ k/n (ℓ − ℓ₀)²    with Δl(b, ℓ) ≤ what is paid out, ℓ at least as short as guiders let it be

With every cable taut that is the shape that their lengths alone tell.
"""

import daqp
import numpy as np

from cobra.description import RobotDescription
from cobra.kinematics.configuration import Floats
from cobra.kinematics.tendons import TendonMap

UNIT_M = 1e-3
"""Lengths in millimetres and bends in milliradians, so that the solver's tolerances mean something."""
_SOLVED = 1
"""daqp's exit flag of an optimum."""


class SlackShape:
    """Of a robot whose sections all bend and shorten by chambers."""

    def __init__(self, description: RobotDescription, tendons: TendonMap) -> None:
        self._tendons, columns = tendons, tendons.columns
        configuration = tendons.configuration
        stiffness, shortest = np.zeros(configuration.size), np.full(configuration.size, -np.inf)
        for section, bends, index in zip(description.sections, configuration.bends, configuration.lengths, strict=True):
            stiffness[bends] = section.bending_stiffness_Nm2 / section.length_m
            if section.elongation is not None and index is not None:
                stiffness[index] = section.elongation.stiffness_N_m / section.vertebrae
                shortest[index] = section.elongation.range_m[0] - tendons.rest[index]
        self._cost = np.ascontiguousarray(np.diag(stiffness[columns]))
        self._allowed = np.ascontiguousarray(np.vstack([np.eye(len(columns)), tendons.matrix[:, columns]]))
        self._shortest = shortest[columns]
        self._sense = np.zeros(len(self._allowed), dtype=np.intc)

    def shape(self, paid_out: Floats, q_known: Floats) -> Floats:
        """(size,) q for cables paid out by `paid_out` (m,) [m]; what they do not decide is taken from `q_known` (size,).

        Cables pulled beyond the guiders' stop stretch, and no shape allows their lengths: then the nearest one by lengths.
        """
        columns = self._tendons.columns
        most = np.concatenate([np.full(len(columns), np.inf), paid_out]) / UNIT_M
        least = np.concatenate([self._shortest, np.full(len(paid_out), -np.inf)]) / UNIT_M
        nothing = np.zeros(len(columns))
        x, _, flag, _ = daqp.solve(self._cost, nothing, self._allowed, most, least, self._sense)
        if flag != _SOLVED or not np.all(np.isfinite(x)):
            return self._tendons.shape(paid_out, q_known).q
        q = np.array(q_known, dtype=float)
        q[columns] = self._tendons.rest[columns] + UNIT_M * np.asarray(x)
        return q
