"""What an orphaned robot does at the end: stay on hold with less tension, pay the tendons out, or switch off."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cobra.description import RobotDescription

Floats = NDArray[np.float64]

RELAX_SPEED_M_S = 0.003
MAX_RELAX_M = 0.010
SLACK_M = 0.010


class FinalAction:
    """Pays the tendons of each section out together: equal lengths all round do not bend the robot."""

    def __init__(self, description: RobotDescription) -> None:
        self.kind: Literal["hold", "slack", "off"] = description.teleop.final_action
        drives = np.array(description.tendon_drives, dtype=np.int64)
        section = np.array(description.tendon_section, dtype=np.int64)
        self._groups = [drives[section == i] for i in description.active_sections]
        self._min_tension = description.tendon.min_tension_N if description.tendon else 0.0
        self._paid = 0.0
        self.done = self.kind == "off" or not self._groups

    def step(self, travel: Floats, load: Floats, dt_s: float) -> Floats:
        """One tick: the next travel setpoint of all drives."""
        limit = SLACK_M if self.kind == "slack" else MAX_RELAX_M
        loose = [self.kind == "hold" and bool(np.min(load[group]) <= self._min_tension) for group in self._groups]
        out = travel.copy()
        for group, enough in zip(self._groups, loose, strict=True):
            if not enough:
                out[group] += RELAX_SPEED_M_S * dt_s
        self._paid += RELAX_SPEED_M_S * dt_s
        self.done = all(loose) or self._paid >= limit
        return out
