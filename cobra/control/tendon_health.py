"""Names tendons that do not do what they should: slack, slipped, broken or jammed.

A healthy tendon loses tension only as its own drive pays out or the robot moves, and the robot moves all tendons of a
section in model. So each tendon's tension is compared with what the model expects, less what the other tendons show to
be wrong in common. Losses at once are faults: all of it, broken; a part of it, slipped. A tendon that stays slack though
it is wound in is broken too. A jammed one answers its drive with its own stiffness alone, far beyond what friction and
play can explain, as if the robot behind it stood still.
"""

import numpy as np

from cobra.control.estimation import TendonEstimate
from cobra.description import RobotDescription
from cobra.kinematics.configuration import Floats
from cobra.mechanics.rubbing import Rubbing

LOOK_BACK_TICKS = 12
"""A sudden loss is one within so many ticks."""
SUDDEN_N = 1.5
SUDDEN_SHARE = 0.3
"""Of its tension before: a smaller loss is none."""
SLACK_SHARE = 0.5
"""Of the minimum: a tendon with less carries nothing."""
CONFIRM_S = 0.08
SLACK_S = 0.3
JAM_SHARE = 0.75
"""Of its own stiffness: a tendon that answers so stiffly, for longer than the lost motion, moves nothing."""
JAM_MARGIN = 2.0
"""Times the lost motion that friction and play explain."""
JAM_LEAST_M = 4e-4
JAM_EXCESS_N = 3.0


class TendonHealth:
    """Watches the m tendons of one robot. `faults` stay until `reset`."""

    def __init__(self, description: RobotDescription, model: Rubbing) -> None:
        self._names = description.tendon_names
        self._model = model
        self._stiffness = model.stiffness_N_m
        # Motors cannot tell which of two antagonists is stuck: either holds the section.
        slopes = model.slopes
        alike = slopes @ slopes.T / np.linalg.norm(slopes, axis=1)
        alike[model.section_of[:, None] != model.section_of[None, :]] = np.inf
        self._antagonist = np.argmin(alike, axis=1)
        self._low = description.tendon.min_tension_N if description.tendon else 0.0
        self.reset()

    def reset(self) -> None:
        """Forget what was found."""
        m = len(self._names)
        self.faults: tuple[str, ...] = ()
        self._past: list[tuple[Floats, Floats, Floats]] = []
        self._lost_s = np.zeros(m)
        self._slack_s = np.zeros(m)
        self._before = np.zeros(m)
        self._turn_x = np.full(m, np.nan)
        self._turn_T = np.zeros(m)
        self._turn_expected = np.zeros(m)
        self._direction = np.zeros(m)
        self._jam_s = np.zeros(m)

    def observe(self, estimate: TendonEstimate, travel_m: Floats, dt_s: float) -> None:
        """One tick: tensions, what the model expects, and where the tendons' drives stand (m,) [m]."""
        tension, expected_N = estimate.motor_N, estimate.expected_N
        self._past = [*self._past, (tension, expected_N, travel_m)][-LOOK_BACK_TICKS:]
        before, expected_before, travel_before = self._past[0]
        # What the drive itself paid out, and what the model foresaw, is no fault's doing.
        foreseen = np.minimum(-(travel_m - travel_before) * self._stiffness, expected_N - expected_before)
        lost = before + np.minimum(foreseen, 0.0) - tension
        sudden = (lost > SUDDEN_N) & (lost > SUDDEN_SHARE * before)
        alone = lost > 2.0 * np.median(np.abs(lost)) + SUDDEN_N
        fresh = sudden & alone & (self._lost_s == 0.0)
        self._before = np.where(fresh, before, self._before)
        # The largest loss is the fault; the others give way to it.
        if np.any(fresh):
            first = int(np.argmax(np.where(fresh, lost, -np.inf)))
            self._lost_s[first] = dt_s
        running = self._lost_s > 0.0
        self._lost_s = np.where(running, self._lost_s + dt_s, 0.0)
        empty = tension < SLACK_SHARE * self._low
        for i in np.flatnonzero(self._lost_s > CONFIRM_S):
            if empty[i]:
                self._name(int(i), "is broken or off its spool: its tension is gone at once")
            elif self._before[i] - tension[i] > SUDDEN_SHARE * self._before[i]:
                self._name(int(i), "has slipped: it lost part of its tension at once. Home again")
            self._lost_s[i] = 0.0
        self._slack_s = np.where(empty, self._slack_s + dt_s, 0.0)
        for i in np.flatnonzero(self._slack_s > SLACK_S):
            self._name(int(i), "stays slack though it is wound in: is it broken or off its spool?")
        self._look_for_jams(tension, expected_N, travel_m, dt_s)

    def _look_for_jams(self, tension: Floats, expected_N: Floats, travel_m: Floats, dt_s: float) -> None:
        if np.isnan(self._turn_x[0]):
            self._turn_x, self._turn_T, self._turn_expected = travel_m.copy(), tension.copy(), expected_N.copy()
        moved = travel_m - self._turn_x
        # A reversal starts anew: where it went farthest.
        turned = (np.sign(moved) != self._direction) & (np.abs(moved) > 1e-4)
        self._direction = np.where(turned, np.sign(moved), self._direction)
        losses = self._model.losses
        cone = 2.0 * np.sinh(losses.conduit_capstan)
        lost = losses.backlash_m + cone * np.maximum(tension, self._turn_T) / self._stiffness
        far = np.abs(moved) > JAM_MARGIN * lost + JAM_LEAST_M
        answer = -(tension - self._turn_T) / np.where(moved == 0.0, 1.0, moved)
        excess = np.abs(tension - expected_N) > JAM_EXCESS_N
        jammed = far & (answer > JAM_SHARE * self._stiffness) & excess
        self._jam_s = np.where(jammed, self._jam_s + dt_s, 0.0)
        if np.count_nonzero(jammed) <= 2:
            for i in np.flatnonzero(self._jam_s > CONFIRM_S):
                other = self._names[self._antagonist[i]]
                self._name(int(i), f"(or its antagonist {other}) is jammed: the robot does not follow its drive")
        # Follow the drive: the window's start trails behind.
        trail = 3.0 * (JAM_MARGIN * lost + JAM_LEAST_M)
        restart = turned | (np.abs(moved) > trail)
        self._turn_x = np.where(restart, travel_m, self._turn_x)
        self._turn_T = np.where(restart, tension, self._turn_T)

    def _name(self, index: int, words: str) -> None:
        if not any(f"tendon {self._names[index]} " in fault for fault in self.faults):
            self.faults = (*self.faults, f"tendon {self._names[index]} {words}")
