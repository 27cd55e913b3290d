"""Names tendons that do not do what they should: slack, slipped, broken or jammed.

A healthy tendon loses tension only as its own drive pays out or the robot moves, and the robot moves all tendons of a
section in model. So each tendon's tension is compared with what the model expects, less what the other tendons show to
be wrong in common. Losses at once are faults: all of it, broken; a part of it, slipped. A tendon that stays slack though
it is wound in is broken too. A jammed one answers its drive with its own stiffness alone, beyond what the model of the
tendons foretells, as if the robot behind it stood still.
"""

import numpy as np

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
SLACK_SHARE = 0.5
"""Of the minimum: a tendon with less carries nothing."""
CONFIRM_S = 0.08
SLACK_S = 0.3
JAM_WINDOW_TICKS = 40
JAM_SHARE = 0.6
"""Of its own stiffness: a tendon that answers its drive so much more stiffly than the model foretells moves nothing."""
JAM_LEAST_M = 4e-4
JAM_BEYOND_N = 1.4
"""Beyond what is foretold, for a model that is exact, and"""
JAM_UNSURE_N = 20.0
"""times the share by which the tendons' stiffness is unsure: the description's numbers foretell less well than a sweep's."""
JAM_TAUT_SHARE = 0.15
"""and this of its tension, because friction grows with it."""
JAM_CONFIRM_S = 0.05


class TendonHealth:
    """Watches the m tendons of one robot. `faults` stay until `reset`."""

    def __init__(self, description: RobotDescription, model: Rubbing, identified: Identified) -> None:
        self._names = description.tendon_names
        self._stiffness = model.stiffness_N_m
        unsure = identified.deviation.axial_stiffness_N / identified.losses.axial_stiffness_N
        self._jam_N = JAM_BEYOND_N + JAM_UNSURE_N * unsure
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
        self._beyond: list[tuple[Floats, Floats]] = []
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
        self._look_for_jams(tension - expected_N, np.maximum(tension, expected_N), travel_m, dt_s)

    def _look_for_jams(self, beyond: Floats, taut: Floats, travel_m: Floats, dt_s: float) -> None:
        """`beyond` (m,) is what of the tension `taut` is not foretold: it grows as the drive winds in against what is stuck."""
        self._beyond = [*self._beyond, (beyond, travel_m)][-JAM_WINDOW_TICKS:]
        before, travel_before = self._beyond[0]
        moved = travel_m - travel_before
        answer = -(beyond - before) / np.where(moved == 0.0, 1.0, moved)
        stiff = (np.abs(moved) > JAM_LEAST_M) & (answer > JAM_SHARE * self._stiffness)
        jammed = stiff & (np.abs(beyond) > self._jam_N + JAM_TAUT_SHARE * taut)
        self._jam_s = np.where(jammed, self._jam_s + dt_s, 0.0)
        if np.any(self._jam_s > JAM_CONFIRM_S):
            # Its neighbours feel it too, but less.
            worst = int(np.argmax(np.where(jammed, np.abs(beyond), 0.0)))
            self._name(worst, "is jammed: it does not follow its drive")

    def _name(self, index: int, words: str) -> None:
        if not any(f"tendon {self._names[index]} " in fault for fault in self.faults):
            self.faults = (*self.faults, f"tendon {self._names[index]} {words}")
