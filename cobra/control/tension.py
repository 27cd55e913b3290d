"""Keeps every tendon between its lowest and highest tension, by trims that do not bend the robot.

Trims δ of the tendons' travel are projected onto Aᵀ K δ = 0 (K the tendons' stiffnesses): their tensions balance, so the
pretension changes and no bend does. The most distal section comes first, because its tendons load all others. Where the
highest tension binds, the motion slows down in its direction, and the pretension stays.
"""

import numpy as np

from cobra.control.estimation import TendonEstimate
from cobra.description import RobotDescription
from cobra.kinematics.configuration import Floats
from cobra.mechanics.rubbing import Rubbing

FLOOR_MARGIN_N = 1.2
"""Trims begin when a tendon has less than the minimum and this."""
CEILING_SHARE = 0.9
"""Trims begin, and the motion slows down, from this share of the maximum on."""
RESPONSE_1_S = 6.0
"""At which a missing tension is taken up."""
LEAK_1_S = 0.15
"""At which trims that are not needed any more go back."""
CREEP_M_S = 0.004
"""No trim is faster."""
MAX_TRIM_M = 0.012
SLACK_SHARE = 0.3
"""Of the minimum: a tendon with less is slack."""
SLACK_HOLD_S = 0.05


class TensionKeeper:
    """The trims and the allowance of one robot with m tendons."""

    def __init__(self, description: RobotDescription, model: Rubbing) -> None:
        tendon = description.tendon
        assert tendon is not None
        self._names = description.tendon_names
        self._low, self._high = tendon.min_tension_N, tendon.max_tension_N
        self._stiffness = model.stiffness_N_m
        self._sections = [np.flatnonzero(model.section_of == i) for i in reversed(description.active_sections)]
        # K-weighted: what is left of a trim's tensions once their moments are taken off.
        slopes = model.slopes
        weighted = slopes / self._stiffness[:, None]
        self._project = np.eye(len(slopes)) - weighted @ np.linalg.solve(slopes.T @ weighted, slopes.T)
        self.reset()

    def reset(self) -> None:
        """No trims."""
        self.trims_m = np.zeros(len(self._stiffness))
        self._raised_N = np.zeros(len(self._stiffness))
        self._slack_s = np.zeros(len(self._stiffness))
        self._tension = np.full(len(self._stiffness), (self._low + self._high) / 2)
        self.warnings: tuple[str, ...] = ()

    def observe(self, estimate: TendonEstimate, dt_s: float) -> None:
        """Take the tensions and make the next trims."""
        motor = estimate.motor_N
        lowest = np.nanmin(estimate.profile_N, axis=1)
        self._tension = motor
        floor, ceiling = self._low + FLOOR_MARGIN_N, CEILING_SHARE * self._high
        wanted = np.zeros_like(motor)
        for own in self._sections:
            missing = max(floor - float(lowest[own].min()), 0.0)
            beyond = max(float(motor[own].max()) - ceiling, 0.0)
            spare = max(float(lowest[own].min()) - floor, 0.0)
            rate = RESPONSE_1_S * (missing if missing else -min(beyond, spare))
            if not missing and not beyond:
                rate = -LEAK_1_S * self._raised_N[own].mean()
                rate = max(rate, -LEAK_1_S * spare) if rate < 0.0 else rate
            wanted[own] = rate
            if missing or beyond:
                break
        change = self._project @ wanted
        most = CREEP_M_S * self._stiffness
        change *= min(1.0, float(np.min(most / np.maximum(np.abs(change), 1e-12)))) * dt_s
        raised = self._raised_N + change
        if np.all(np.abs(raised) / self._stiffness <= MAX_TRIM_M):
            self._raised_N = raised
        self.trims_m = -self._raised_N / self._stiffness
        slack = lowest < SLACK_SHARE * self._low
        self._slack_s = np.where(slack, self._slack_s + dt_s, 0.0)
        self.warnings = tuple(
            f"tendon {self._names[i]} is slack: it is being taken up, slow down"
            for i in np.flatnonzero(self._slack_s > SLACK_HOLD_S)
        )

    def allow(self, change_m: Floats, feeds_in: bool) -> tuple[float, str]:
        """Which share of a motion the tensions allow, and why not all; what relieves them is always allowed.

        `change_m` (m,) is what the motion makes of the tendons' lengths.
        """
        loose = (self._slack_s > SLACK_HOLD_S) & (change_m > 1e-9)
        if np.any(loose):
            return 0.0, f"tendon {self._names[int(np.argmax(loose))]} is slack: it is taken up first"
        start = CEILING_SHARE * self._high
        tight = (self._tension > start) & ((change_m < -1e-9) | feeds_in)
        if not np.any(tight):
            return 1.0, ""
        i = int(np.argmax(np.where(tight, self._tension, -np.inf)))
        share = float(np.clip((self._high - self._tension[i]) / (self._high - start), 0.0, 1.0))
        if share > 0.0:
            return share, f"tendon {self._names[i]} is near {self._high:.0f} N: slower"
        return 0.0, f"tendon {self._names[i]} is above {self._high:.0f} N: drive the other way to relieve it"
