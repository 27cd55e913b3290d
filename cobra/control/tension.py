"""Keeps every tendon between its lowest and highest tension, by trims that do not bend the robot, and by slowing the motion.

What counts is the tension at the spool, where it is measured, and the least along the way of the tendon. A tendon may
lose tension only so fast that it comes to rest at its floor (and gain it towards its ceiling likewise),

    K ḋ ≤ a (T − T_floor),    K ḋ ≥ −a (T_ceiling − T)

as if the robot did not give way at all, which is the worst. The step that keeps this and is nearest to the wanted one
(`tension_steps.py`) trims first. Where trims cannot help the motion slows down in its direction and the pretension stays;
what it is beyond its limits already, the robot gives way.
"""

import numpy as np
from numpy.typing import NDArray

from cobra.control.estimation import TendonEstimate
from cobra.control.tension_steps import TensionSteps
from cobra.description import RobotDescription
from cobra.kinematics.configuration import Floats
from cobra.mechanics.losses import Identified
from cobra.mechanics.rubbing import Rubbing

MARGIN_N = 1.0
"""Floor and ceiling are so far inside the limits: what happens until a drive has answered."""
UNSURE = np.sqrt(3.0)
"""And so many standard deviations of the gears' friction: all that an evenly spread one can be off."""
APPROACH_1_S = 8.0
"""a"""
TRIM_M_S = 0.02
"""No trim is faster,"""
CREEP_M_S = 0.004
"""nor is slack taken up faster once it is told."""
LEAK_1_S = 0.15
"""At which trims that are not needed any more go back while the robot moves."""
RETURN_1_S = 5.0
"""And bends that were held back."""
MAX_TRIM_M = 0.012
HELD_BACK_RAD = 0.05
"""A motion whose bends are held back by so much stands still."""
GIVE_1_S = 2.0
"""At which the commanded bends give way to what holds them back"""
GIVE_FROM_RAD = 0.02
"""beyond this."""
SLACK_SHARE = 0.3
"""Of the minimum: a tendon with less is slack."""
SLACK_HOLD_S = 0.05
STILL_M = 1e-9
"""A tendon that a step changes by less stands."""


class TensionKeeper:
    """Trims and allowance of one robot with m tendons."""

    def __init__(self, description: RobotDescription, model: Rubbing, identified: Identified) -> None:
        tendon = description.tendon
        assert tendon is not None
        self._names = description.tendon_names
        self._low, self._high = tendon.min_tension_N, tendon.max_tension_N
        self._stiffness = model.stiffness_N_m
        self._margin = MARGIN_N + UNSURE * identified.deviation.drive_friction_N
        self._steps = TensionSteps(model.slopes, model.stiffness_N_m)
        self._endless = (np.full(len(self._stiffness), -np.inf), np.full(len(self._stiffness), np.inf))
        self.reset()

    def reset(self) -> None:
        """No trims, and no limits until tensions are known."""
        m = len(self._stiffness)
        self.offset_m = np.zeros(m)
        """(m,) what of the tendons' travel is other than wanted: trims, and bends held back."""
        self._most = np.full(m, np.inf)
        self._least = np.full(m, np.inf)
        self._bounds = self._endless
        """(m,) each: between what the tendons' travel may change in a tick."""
        self._slack_s = np.zeros(m)
        self.warnings: tuple[str, ...] = ()

    @property
    def trims_m(self) -> Floats:
        """(m,) the part of the offset that does not bend."""
        return self._steps.trims(self.offset_m)

    def observe(self, estimate: TendonEstimate, coming_m: Floats, dt_s: float) -> None:
        """Take the tensions, and what the drives have still to move (m,)."""
        coming = self._stiffness * coming_m
        self._most = estimate.motor_N - np.minimum(coming, 0.0)
        lowest = np.nanmin(estimate.profile_N, axis=1)
        self._least = lowest - np.maximum(coming, 0.0)
        self._slack_s = np.where(lowest < SLACK_SHARE * self._low, self._slack_s + dt_s, 0.0)
        self.warnings = tuple(
            f"tendon {self._names[i]} is slack: it is being taken up, slow down" for i in np.flatnonzero(self._loose)
        )
        self._bounds = self._bounded(dt_s)

    @property
    def _loose(self) -> NDArray[np.bool_]:
        return self._slack_s > SLACK_HOLD_S

    def step(self, wanted_m: Floats, moving: bool, dt_s: float) -> None:
        """One tick: the travel is to change by `wanted_m` (m,); what it may not is in the offset then."""
        trims = self.trims_m
        back = RETURN_1_S * (self.offset_m - trims) + (LEAK_1_S * trims if moving else 0.0)
        low, high = self._bounds
        # Only what is beyond its ceiling takes of the pretension, and what trims have added to it.
        slacken = np.full(len(low), np.inf) if np.any(low > 0.0) else np.maximum(-trims, 0.0)
        change = self._steps.nearest(wanted_m - back * dt_s, low, high, slacken) - wanted_m
        self.offset_m = self.offset_m + change

    def give_way(self, dt_s: float) -> Floats:
        """(c,) what the commanded bends are to change by in a tick, so that they do not stay where they cannot be had."""
        held = self._steps.bends(self.offset_m)
        size = float(np.linalg.norm(held))
        beyond = max(size - GIVE_FROM_RAD, 0.0)
        out: Floats = held * (min(1.0, GIVE_1_S * dt_s) * beyond / max(size, 1e-12))
        return out

    def allow(self, change_m: Floats, fed_m: float) -> tuple[float, str]:
        """Which share of a motion's step the tensions allow, and why not all; what relieves them is always allowed.

        `change_m` (m,) is what the motion makes of the tendons' lengths, `fed_m` what it feeds.
        """
        moved = np.abs(change_m) > STILL_M
        if np.any(loose := self._loose & (change_m > STILL_M)):
            return 0.0, f"tendon {self._names[int(np.argmax(loose))]} is slack: it is taken up first"
        i = int(np.argmax(self._most))
        over = self._most[i] > self._high
        if over and np.isfinite(self._most[i]) and (fed_m > 0.0 or (np.any(moved) and change_m[i] < STILL_M)):
            return 0.0, f"tendon {self._names[i]} is above {self._high:.0f} N: drive the other way to relieve it"
        share, reason = self._share(change_m) if np.any(moved) else (1.0, "")
        ceiling = self._high - self._margin[i]
        if fed_m > 0.0 and np.isfinite(self._most[i]) and self._most[i] > ceiling - self._margin[i]:
            slow = float(np.clip((self._high - self._most[i]) / (2.0 * self._margin[i]), 0.0, 1.0))
            if slow < share:
                share, reason = slow, self._near(i, self._high)
        return share, reason

    def _share(self, change_m: Floats) -> tuple[float, str]:
        low, high = self._bounds
        given = self._steps.nearest(change_m, low, high, np.maximum(-self.trims_m, 0.0))
        wanted = self._steps.bends(change_m)
        size = float(wanted @ wanted)
        if given is change_m or size == 0.0:
            share = 1.0
        else:
            share = float(np.clip(self._steps.bends(given) @ wanted / size, 0.0, 1.0))
        behind = -float(self._steps.bends(self.offset_m) @ wanted) / max(np.sqrt(size), 1e-12)
        share *= float(np.clip(1.0 - behind / HELD_BACK_RAD, 0.0, 1.0))
        if share > 0.99:
            return 1.0, ""
        short, beyond = change_m > high, change_m < low
        if np.any(beyond):
            return share, self._near(int(np.argmax(np.where(beyond, self._most, -np.inf))), self._high)
        if np.any(short):
            return share, self._near(int(np.argmin(np.where(short, self._least, np.inf))), self._low)
        return share, "the tendons have no tension to spare for this: slower"

    def _near(self, index: int, limit_N: float) -> str:
        return f"tendon {self._names[index]} is near {limit_N:g} N: slower"

    def _bounded(self, dt_s: float) -> tuple[Floats, Floats]:
        if not np.all(np.isfinite(self._most)):
            return self._endless
        spare = self._least - (self._low + self._margin)
        room = (self._high - self._margin) - self._most
        fastest = np.where(self._loose, CREEP_M_S, TRIM_M_S) * dt_s
        high = np.maximum(APPROACH_1_S * spare / self._stiffness * dt_s, -fastest)
        low = np.minimum(-APPROACH_1_S * room / self._stiffness * dt_s, fastest)
        # A trim that has gone as far as it may is not forced further.
        trims = self.trims_m
        high = np.where(trims < -MAX_TRIM_M, np.maximum(high, 0.0), high)
        low = np.where(trims > MAX_TRIM_M, np.minimum(low, 0.0), low)
        return np.minimum(low, high), high
