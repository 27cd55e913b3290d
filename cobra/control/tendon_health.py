"""Names tendons that do not do what they should: slack, slipped, broken or jammed.

A healthy tendon loses tension only as its own drive pays out or the robot moves, and the robot moves all tendons of a
section in model. So each tendon's tension is compared with what the model expects, less what the other tendons show to
be wrong in common. Losses at once are faults: all of it, broken; a part of it, slipped. A tendon that stays slack though
it is wound in is broken too.

A jammed tendon answers its drive with its own stiffness alone, as if the robot behind it stood still. So do all tendons
of a robot that walls hold; but walls press with moments, which take from one tendon what they give to its antagonist.
Only what no moment explains is held against a tendon: the part of the unforeseen tensions with Aᵀ T = 0. That takes as
long as the antagonist alone needs to bend the robot, and where nothing moves a jam does not show.
"""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from cobra.control.estimation import TendonEstimate
from cobra.description import RobotDescription
from cobra.kinematics.configuration import Floats
from cobra.mechanics.losses import Identified
from cobra.mechanics.rubbing import Rubbing

LOOK_BACK_TICKS = 12
"""A sudden loss is one within so many ticks."""
SUDDEN_N = 1.5
SUDDEN_SHARE = 0.3
"""Of its tension before: a smaller loss is none."""
SUDDEN_OWN = 0.4
"""Of a loss: so much must be unexplained by any moment."""
SLACK_SHARE = 0.5
"""Of the minimum: a tendon with less carries nothing."""
CONFIRM_S = 0.08
SLACK_S = 0.3
JAM_WINDOW_TICKS = 80
JAM_SHARE = 0.2
"""Of its own stiffness: a tendon that answers its drive by so much more stiffly than an exact model foretells moves nothing,"""
JAM_UNSURE_SHARE = 2.3
"""and by so much more, times the share by which the stiffness is unsure."""
JAM_LEAST_M = 4e-4
JAM_BEYOND_N = 0.4
"""Unexplained by any moment, for a model that is exact; and besides, times the share by which the tendons' stiffness is
unsure (a description's numbers foretell less well than a sweep's),"""
JAM_UNSURE_TAUT = 1.1
"""of the tension, because friction grows with it, and"""
JAM_UNSURE_TRIMS = 3.5
"""of the tension that trims have changed."""
JAM_TAUT_SHARE = 0.02
"""Of the tension, in any case."""
JAM_CONFIRM_S = 0.05
STOOD_M = 1e-4
"""A drive that moved less stood: its friction hides what is left of a tension."""


class TendonHealth:
    """Watches the m tendons of one robot. `faults` stay until `reset`."""

    def __init__(self, description: RobotDescription, model: Rubbing, identified: Identified) -> None:
        self._names = description.tendon_names
        self._stiffness, self._sections = model.stiffness_N_m, model.section_of
        self._unsure = identified.deviation.axial_stiffness_N / identified.losses.axial_stiffness_N
        # What is left of tensions once the bends that cause them are taken out, and how much of it each tendon alone makes.
        K, A = self._stiffness, model.slopes
        bending = K[:, None] * A
        self._unbent = np.eye(len(K)) - bending @ np.linalg.solve(A.T @ bending, A.T) if A.size else np.eye(len(K))
        self._own = np.einsum("ji,j,ji->i", self._unbent, 1.0 / K, self._unbent)
        self._low = description.tendon.min_tension_N if description.tendon else 0.0
        self.reset()

    def reset(self) -> None:
        """Forget what was found."""
        m = len(self._names)
        self.faults: tuple[str, ...] = ()
        self._past: deque[tuple[Floats, Floats, Floats]] = deque(maxlen=LOOK_BACK_TICKS)
        self._lost_s = np.zeros(m)
        self._slack_s = np.zeros(m)
        self._before = np.zeros(m)
        self._beyond: deque[tuple[Floats, Floats]] = deque(maxlen=JAM_WINDOW_TICKS)
        self._jam_s = np.zeros(m)

    def observe(self, estimate: TendonEstimate, travel_m: Floats, dt_s: float) -> None:
        """One tick: tensions, what the model expects, and where the tendons' drives stand (m,) [m]."""
        tension, expected_N = estimate.motor_N, estimate.expected_N
        self._past.append((tension, expected_N, travel_m))
        before, expected_before, travel_before = self._past[0]
        # What the drive itself paid out, and what the model foresaw, is no fault's doing.
        foreseen = np.minimum(-(travel_m - travel_before) * self._stiffness, expected_N - expected_before)
        lost = before + np.minimum(foreseen, 0.0) - tension
        if np.any(sudden := (lost > SUDDEN_N) & (lost > SUDDEN_SHARE * before)):
            self._suspect(sudden, lost, before, dt_s)
        running = self._lost_s > 0.0
        self._lost_s = np.where(running, self._lost_s + dt_s, 0.0)
        empty = tension < SLACK_SHARE * self._low
        for i in np.flatnonzero(self._lost_s > CONFIRM_S):
            stood = abs(travel_m[i] - travel_before[i]) < STOOD_M
            if empty[i]:
                self._name(int(i), "is broken or off its spool: its tension is gone at once")
            elif self._before[i] - tension[i] > SUDDEN_SHARE * self._before[i]:
                what = "is broken or has slipped" if stood else "has slipped"
                self._name(int(i), f"{what}: it lost part of its tension at once. Home again")
            self._lost_s[i] = 0.0
        self._slack_s = np.where(empty, self._slack_s + dt_s, 0.0)
        for i in np.flatnonzero(self._slack_s > SLACK_S):
            self._name(int(i), "stays slack though it is wound in: is it broken or off its spool?")
        self._look_for_jams(tension - expected_N, np.maximum(tension, expected_N), travel_m, dt_s)

    def _suspect(self, sudden: NDArray[np.bool_], lost: Floats, before: Floats, dt_s: float) -> None:
        """Of the tendons that lost tension at once, the one whose own loss it is: the others give way to it."""
        # A push or a wall gives the antagonist what it takes; what no moment explains is the tendon's own.
        own = self._alone(lost)
        alone = (lost > 2.0 * np.median(np.abs(lost)) + SUDDEN_N) & (own > SUDDEN_N) & (own > SUDDEN_OWN * lost)
        fresh = sudden & alone & (self._lost_s == 0.0)
        self._before = np.where(fresh, before, self._before)
        if np.any(fresh):
            first = int(np.argmax(np.where(fresh, lost, -np.inf)))
            self._lost_s[first] = dt_s

    def _look_for_jams(self, beyond: Floats, taut: Floats, travel_m: Floats, dt_s: float) -> None:
        """`beyond` (m,) is what of the tension `taut` is not foretold: it grows as the drive winds in against what is stuck."""
        self._beyond.append((beyond, travel_m))
        before, travel_before = self._beyond[0]
        moved, change = travel_m - travel_before, beyond - before
        answer = -change / np.where(moved == 0.0, 1.0, moved)
        share = JAM_SHARE + JAM_UNSURE_SHARE * self._unsure
        stiff = (np.abs(moved) > JAM_LEAST_M) & (answer > share * self._stiffness)
        if not np.any(stiff) or self.faults:  # what another fault does to a tendon looks like a jam
            self._jam_s[:] = 0.0
            return
        unexplained = self._alone(change)
        doubt = JAM_BEYOND_N + JAM_TAUT_SHARE * taut
        doubt += self._unsure * (
            JAM_UNSURE_TAUT * self._tautest(taut) + JAM_UNSURE_TRIMS * np.abs(self._alone(self._stiffness * moved))
        )
        jammed = stiff & (np.sign(change) * unexplained > doubt) & (not np.any(self._lost_s))
        self._jam_s = np.where(jammed, self._jam_s + dt_s, 0.0)
        if np.any(self._jam_s > JAM_CONFIRM_S):
            # Its neighbours feel it too, but less.
            worst = int(np.argmax(np.where(jammed, np.abs(change), 0.0)))
            self._name(worst, "is jammed: it does not follow its drive")

    def _tautest(self, taut: Floats) -> Floats:
        """(m,) of each tendon's section."""
        sections = np.full(int(self._sections.max()) + 1, 0.0)
        np.maximum.at(sections, self._sections, taut)
        out: Floats = sections[self._sections]
        return out

    def _alone(self, tension: Floats) -> Floats:
        """(m,) [N] by how much each tendon alone would have to be pulled for what of the tensions no bends explain."""
        left = self._unbent @ tension
        out: Floats = self._unbent.T @ (left / self._stiffness) / np.maximum(self._own, 1e-12)
        return out

    def _name(self, index: int, words: str) -> None:
        if not any(f"tendon {self._names[index]} " in fault for fault in self.faults):
            self.faults = (*self.faults, f"tendon {self._names[index]} {words}")
