"""Tells jammed tendons from healthy ones that rub, and from walls.

A jammed tendon answers its drive with its own stiffness alone, as if the robot behind it stood still. So do all tendons
of a robot that walls hold; but walls press with moments, which take from one tendon what they give to its antagonist.
Only what no moment explains is held against a tendon: the part of the unforeseen tensions with Aᵀ T = 0. That takes as
long as the antagonist alone needs to bend the robot, and where nothing moves a jam does not show.

It is looked for twice: in what has happened within a moment, and in what a tendon's unforeseen tension has had to do
with its drive's travel for seconds (the slope of one over the other), which sees jams in slow driving, to and fro.
"""

from collections import deque

import numpy as np

from cobra.kinematics.configuration import Floats
from cobra.mechanics.losses import Identified
from cobra.mechanics.rubbing import Rubbing

WINDOW_TICKS = 80
SHARE = 0.2
"""Of its own stiffness: a tendon that answers its drive by so much more stiffly than an exact model foretells moves nothing,"""
UNSURE_SHARE = 2.3
"""and by so much more, times the share by which the stiffness is unsure."""
LEAST_M = 4e-4
BEYOND_N = 0.6
"""Unexplained by any moment, and besides"""
BENT_SHARE = 0.25
"""of the section's highest tension beyond its pretension, because what bends a section rubs; and, times the share by which
stiffness is unsure,"""
UNSURE_TAUT = 0.4
"""of that highest tension, and"""
UNSURE_TRIMS = 3.5
"""of the tension that trims have changed."""
CONFIRM_S = 0.05

MEMORY_S = 4.0
"""In which what has happened is forgotten, where the slope of unforeseen tension over travel is looked at."""
LASTING_SHARE, LASTING_UNSURE_SHARE = 0.15, 1.2
"""Of its own stiffness, and times the share by which that is unsure: a healthy tendon's slope is below,"""
LASTING_M, LASTING_UNSURE_M = 2e-4, 1.55e-3
"""and by so much over how far its drive moves (standard deviation), because friction holds in small motions."""
LASTING_LEAST_M = 8e-4


class Jams:
    """Watches the m tendons of one robot."""

    def __init__(self, model: Rubbing, identified: Identified, pretension_N: float) -> None:
        self._pretension_N = pretension_N
        self._stiffness, self._sections = model.stiffness_N_m, model.section_of
        self._unsure = identified.deviation.axial_stiffness_N / identified.losses.axial_stiffness_N
        # What is left of tensions once the bends that cause them are taken out, and how much of it each tendon alone makes.
        K, A = self._stiffness, model.slopes
        bending = K[:, None] * A
        self._unbent = np.eye(len(K)) - bending @ np.linalg.solve(A.T @ bending, A.T) if A.size else np.eye(len(K))
        self._own = np.einsum("ji,j,ji->i", self._unbent, 1.0 / K, self._unbent)
        self.reset()

    def reset(self) -> None:
        """Forget what has happened."""
        m = len(self._stiffness)
        self._past: deque[tuple[Floats, Floats]] = deque(maxlen=WINDOW_TICKS)
        self._for_s = np.zeros(m)
        self._mean: tuple[Floats, Floats] | None = None
        self._variance, self._covariance = np.zeros(m), np.zeros(m)

    def alone(self, tension: Floats) -> Floats:
        """(m,) [N] by how much each tendon alone would have to be pulled for what of the tensions no bends explain."""
        left = self._unbent @ tension
        out: Floats = self._unbent.T @ (left / self._stiffness) / np.maximum(self._own, 1e-12)
        return out

    def observe(self, beyond: Floats, taut: Floats, travel_m: Floats, dt_s: float, well: bool) -> int | None:
        """One tick: which tendon is jammed, or None.

        `beyond` (m,) is what of the tension `taut` is not foretold: it grows as the drive, which stands at `travel_m`, winds
        in against what is stuck. `well`: no other fault is known or suspected; what that does to a tendon looks like a jam.
        """
        strength = np.maximum(self._lasting(beyond, travel_m, dt_s), self._sudden(beyond, taut, travel_m))
        jammed = (strength > 0.0) & well
        self._for_s = np.where(jammed, self._for_s + dt_s, 0.0)
        if not np.any(self._for_s > CONFIRM_S):
            return None
        # Its neighbours feel it too, but less.
        return int(np.argmax(np.where(jammed, strength, 0.0)))

    def _sudden(self, beyond: Floats, taut: Floats, travel_m: Floats) -> Floats:
        """(m,) [N] by how much each has answered its drive, where that was too stiffly to be healthy; else 0."""
        self._past.append((beyond, travel_m))
        before, travel_before = self._past[0]
        moved, change = travel_m - travel_before, beyond - before
        answer = -change / np.where(moved == 0.0, 1.0, moved)
        share = SHARE + UNSURE_SHARE * self._unsure
        stiff = (np.abs(moved) > LEAST_M) & (answer > share * self._stiffness)
        if not np.any(stiff):
            return np.zeros_like(moved)
        trimmed = np.abs(self.alone(self._stiffness * moved))
        tautest = self._tautest(taut)
        doubt = BEYOND_N + BENT_SHARE * np.maximum(tautest - self._pretension_N, 0.0)
        doubt += self._unsure * (UNSURE_TAUT * tautest + UNSURE_TRIMS * trimmed)
        return np.where(stiff & (np.sign(change) * self.alone(change) > doubt), np.abs(change), 0.0)

    def _lasting(self, beyond: Floats, travel_m: Floats, dt_s: float) -> Floats:
        """(m,) [N] the same, for what has happened in the last seconds."""
        alone, share = self.alone(beyond), min(1.0, dt_s / MEMORY_S)
        if self._mean is None:
            self._mean = alone, travel_m
        off, moved = alone - self._mean[0], travel_m - self._mean[1]
        self._mean = self._mean[0] + share * off, self._mean[1] + share * moved
        self._variance = (1.0 - share) * (self._variance + share * moved**2)
        self._covariance = (1.0 - share) * (self._covariance + share * moved * off)
        far = np.sqrt(self._variance)
        if not np.any(far > LASTING_LEAST_M):
            return np.zeros_like(far)
        slope = -self._covariance / np.maximum(self._variance, 1e-12) / self._stiffness
        doubt_m = LASTING_M + LASTING_UNSURE_M * self._unsure
        doubt = LASTING_SHARE + LASTING_UNSURE_SHARE * self._unsure + doubt_m / np.maximum(far, 1e-9)
        out: Floats = np.where((far > LASTING_LEAST_M) & (slope > doubt), slope * far * self._stiffness, 0.0)
        return out

    def _tautest(self, taut: Floats) -> Floats:
        """(m,) of each tendon's section."""
        sections = np.full(int(self._sections.max()) + 1, 0.0)
        np.maximum.at(sections, self._sections, taut)
        out: Floats = sections[self._sections]
        return out
