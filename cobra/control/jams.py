"""Tells jammed tendons from healthy ones that rub, and from walls.

A jammed tendon answers its drive with its conduit alone (`cobra.mechanics.stuck`); so does a healthy one until its
friction is overcome, and a jam shows only where the two would differ. So what a tendon carries beyond what a healthy one
would is compared with what one stuck for some time would: a jammed tendon's goes along with that, a healthy one's does not.
Walls press with moments, which take from one tendon what they give to its antagonist. Only what no moment explains, the
part of the tensions with Aᵀ T = 0, is held against a tendon.
"""

import numpy as np

from cobra.control.estimation import TendonEstimate
from cobra.kinematics.configuration import Floats
from cobra.mechanics.losses import Identified
from cobra.mechanics.rubbing import Rubbing
from cobra.mechanics.stuck import StuckTendons

WINDOWS_S = (0.4, 2.0)
"""In which it is looked for. Of each there are two that begin by turns; one is so old when the other begins."""
LEAST_S = 0.2
LEAST_N = 0.45
"""What a stuck tendon would carry more than a healthy one (root mean square): with less nothing can be told."""
LEAST_SHARE, MOST_SHARE = 0.3, 1.3
"""Of that is what a tendon carries beyond a healthy one. A jammed one's is about 1; less, where the others bend the robot."""
DOUBT_N = 0.29
"""That may be by chance, and"""
DRIFT_1_S = 0.025
"""a second of the change of tension, and"""
UNSURE_N, UNSURE_SHARE = 4.0, 1.2
"""times the share by which the stiffness is unsure: so much, and of that change and of what a stuck tendon would carry more, and"""
UNSETTLED_N, SETTLED_M = 5.0, 0.006
"""so much, where a window began before the section's tendons had moved so far since homing: it leaves friction in them that is
known as badly; and"""
RUBBING_SHARE = 1.5
"""times the deviation of the conduit's capstan: of the tension, which friction may hold more or less than is known."""
PRESSED, PRESSED_N = 0.85, 6.0
"""From this share on of the moments that are believed to come from outside at most, so much of a tension may be pretended where
all are reached: hard against walls the robot is elsewhere than the model of its tendons says."""
CONFIRM_S = 0.05
SMOOTH_S = 0.1
"""Over which the tension is taken that a window begins with: where a drive turns back, its friction is read wrongly for a moment."""


class Jams:
    """Watches the m tendons of one robot."""

    def __init__(self, model: Rubbing, identified: Identified) -> None:
        self._unsure = identified.deviation.axial_stiffness_N / identified.losses.axial_stiffness_N
        self._rubbing = RUBBING_SHARE * float(identified.deviation.conduit_capstan)
        # What is left of tensions once the bends that cause them are taken out, and how much of it each tendon alone makes.
        K, A = model.stiffness_N_m, model.slopes
        bending = K[:, None] * A
        self._stiffness = K
        self._unbent = np.eye(len(K)) - bending @ np.linalg.solve(A.T @ bending, A.T) if A.size else np.eye(len(K))
        self._own = np.einsum("ji,j,ji->i", self._unbent, 1.0 / K, self._unbent)
        alike = (model.section_of[:, None] == model.section_of).astype(np.float64)
        self._section_mean = alike / alike.sum(axis=1, keepdims=True)
        """(m, m): of the tendons of each one's section."""
        self._length_s = 2.0 * np.repeat(WINDOWS_S, 2)
        self._stuck = StuckTendons(model, len(self._length_s))
        self.reset()

    def reset(self) -> None:
        """Forget what has happened."""
        m, n = len(self._stiffness), len(self._length_s)
        self._for_s = np.zeros(m)
        self._spool_m: Floats | None = None
        self._smooth = np.zeros(m)
        self._left_s, self._age_s = np.zeros(n), np.zeros(n)
        self._alone_before, self._expected_before = np.zeros((n, m)), np.zeros((n, m))
        self._path_m, self._unsettled, self._pressed = np.zeros(m), np.ones((n, m)), np.zeros(n)
        # Integrals over each window: of what is beyond a healthy tendon times what would be if it were stuck, and of squares.
        self._product, self._stuck_square, self._change_square = np.zeros((n, m)), np.zeros((n, m)), np.zeros((n, m))

    def alone(self, tension: Floats) -> Floats:
        """(m,) [N] by how much each tendon alone would have to be pulled for what of the tensions no bends explain."""
        left = self._unbent @ tension
        out: Floats = self._unbent.T @ (left / self._stiffness) / np.maximum(self._own, 1e-12)
        return out

    def observe(self, estimate: TendonEstimate, dt_s: float, well: bool) -> int | None:
        """One tick: which tendon is jammed, or None. The model of healthy tendons must be in the state of the estimate.

        `well`: no other fault is known or suspected; what that does looks like a jam.
        """
        expected, spool_m = estimate.expected_N, estimate.spool_m
        alone = self.alone(estimate.motor_N - expected)
        if self._spool_m is None:
            self._smooth = alone
            for window in range(len(self._length_s)):
                self._begin(window, estimate)
            self._left_s[1::2] /= 2.0
            self._spool_m = spool_m
        paid_out = spool_m - self._spool_m
        self._spool_m, self._path_m = spool_m, self._path_m + np.abs(paid_out)
        stuck = self._stuck.advance(paid_out) - expected
        self._smooth = self._smooth + min(1.0, dt_s / SMOOTH_S) * (alone - self._smooth)
        self._age_s += dt_s
        self._left_s -= dt_s
        self._product += dt_s * stuck * (alone - self._alone_before)
        self._stuck_square += dt_s * stuck**2
        self._change_square += dt_s * (expected - self._expected_before) ** 2
        self._pressed = np.maximum(self._pressed, estimate.pressed)
        jammed = self._strength(estimate.motor_N) if well else np.zeros_like(alone)
        self._for_s = np.where(jammed > 0.0, self._for_s + dt_s, 0.0)
        for over in np.flatnonzero(self._left_s < dt_s / 2).tolist():
            self._begin(over, estimate)
        # Its neighbours feel it too, but less.
        return int(np.argmax(jammed)) if np.any(self._for_s > CONFIRM_S) else None

    def _begin(self, window: int, estimate: TendonEstimate) -> None:
        self._stuck.begin(window)
        self._left_s[window], self._age_s[window] = self._length_s[window], 0.0
        self._alone_before[window], self._expected_before[window] = self._smooth, estimate.expected_N
        self._unsettled[window] = np.clip(1.0 - self._section_mean @ self._path_m / SETTLED_M, 0.0, 1.0)
        self._pressed[window] = estimate.pressed
        self._product[window] = self._stuck_square[window] = self._change_square[window] = 0.0

    def _strength(self, tension: Floats) -> Floats:
        """(m,) [N] of what each, now at `tension` (m,), carries beyond a healthy one, as one would that is stuck; 0 where it
        may be healthy."""
        age_s = np.maximum(self._age_s, LEAST_S)[:, None]
        would, changed = np.sqrt(self._stuck_square / age_s), np.sqrt(self._change_square / age_s)
        does = self._product / age_s / np.maximum(would, 1e-9)
        doubt = (
            DOUBT_N
            + DRIFT_1_S * age_s * changed
            + self._rubbing * tension
            + self._unsure * (UNSURE_N + UNSURE_SHARE * (changed + would) + UNSETTLED_N * self._unsettled)
        )
        doubt += PRESSED_N * np.clip((self._pressed - PRESSED) / (1.0 - PRESSED), 0.0, 1.0)[:, None]
        judged = (would > LEAST_N) & (does > LEAST_SHARE * would) & (does < MOST_SHARE * would)
        judged &= self._age_s[:, None] > LEAST_S - 1e-9
        out: Floats = np.where(judged & (does > doubt), does, 0.0).max(axis=0)
        return out
