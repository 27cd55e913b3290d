"""Names tendons that do not do what they should: slack, slipped, broken or jammed.

A healthy tendon loses tension only as its own drive pays out or the robot moves, and the robot moves all tendons of a
section in model. So each tendon's tension is compared with what the model expects, less what the other tendons show to
be wrong in common. Losses at once are faults: all of it, broken; a part of it, slipped. A tendon that stays slack though
it is wound in is broken too. What is jammed is told by `jams.py`.
"""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from cobra.control.estimation import TendonEstimate
from cobra.control.jams import Jams
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
STOOD_M = 1e-4
"""A drive that moved less stood: its friction hides what is left of a tension."""


class TendonHealth:
    """Watches the m tendons of one robot. `faults` stay until `reset`."""

    def __init__(self, description: RobotDescription, model: Rubbing, identified: Identified) -> None:
        self._names = description.tendon_names
        self._stiffness = model.stiffness_N_m
        tendon = description.tendon
        self._low = tendon.min_tension_N if tendon else 0.0
        self._jams = Jams(model, identified)
        self.reset()

    def reset(self) -> None:
        """Forget what was found."""
        m = len(self._names)
        self.faults: tuple[str, ...] = ()
        self._past: deque[tuple[Floats, Floats, Floats]] = deque(maxlen=LOOK_BACK_TICKS)
        self._lost_s = np.zeros(m)
        self._slack_s = np.zeros(m)
        self._before = np.zeros(m)
        self._jams.reset()

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
        well = not self.faults and not np.any(self._lost_s)
        jammed = self._jams.observe(estimate, dt_s, well)
        if jammed is not None:
            self._name(jammed, "is jammed: it does not follow its drive")

    def _suspect(self, sudden: NDArray[np.bool_], lost: Floats, before: Floats, dt_s: float) -> None:
        """Of the tendons that lost tension at once, the one whose own loss it is: the others give way to it."""
        # A push or a wall gives the antagonist what it takes; what no moment explains is the tendon's own.
        own = self._jams.alone(lost)
        alone = (lost > 2.0 * np.median(np.abs(lost)) + SUDDEN_N) & (own > SUDDEN_N) & (own > SUDDEN_OWN * lost)
        fresh = sudden & alone & (self._lost_s == 0.0)
        self._before = np.where(fresh, before, self._before)
        if np.any(fresh):
            first = int(np.argmax(np.where(fresh, lost, -np.inf)))
            self._lost_s[first] = dt_s

    def _name(self, index: int, words: str) -> None:
        if not any(f"tendon {self._names[index]} " in fault for fault in self.faults):
            self.faults = (*self.faults, f"tendon {self._names[index]} {words}")
