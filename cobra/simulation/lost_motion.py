"""What lies between a drive's encoder and the end of what it moves: spools that are not round, and play.

A spool that winds its tendon on top of itself grows by the tendon's diameter d with every turn, r(α) = r₀ − d α/2π for an angle
α paid out; an eccentric one errs once a turn. Play is the classical one: what is moved stays until the drive has crossed it. It
stands for all that shifts in its seat on a reversal, gear and conduit alike, while the tendon stays taut: so the drive feels the
load throughout.
"""

import math

import numpy as np

from cobra.description import RobotDescription
from cobra.simulation.plant import Floats


class LostMotion:
    """Of all drives (drives,); it remembers where in its play each one stands."""

    def __init__(self, description: RobotDescription, rng: np.random.Generator) -> None:
        drives = description.drives
        self._per_rad = np.array([drive.travel_per_rad for drive in drives])
        layer = description.tendon.diameter_m if description.tendon else 0.0
        self._layer_m_rad = np.array([layer / math.tau if drive.winds_over else 0.0 for drive in drives])
        self._runout_m = np.array([drive.spool_runout_m for drive in drives])
        self._phase = rng.uniform(0.0, math.tau, len(drives))
        backlash = np.radians([description.motor_of(drive).backlash_deg for drive in drives])
        self._play = backlash * np.abs(self._per_rad)
        self._end = np.zeros(len(drives))

    def travel(self, angle: Floats) -> Floats:
        """What has been moved [m or rad] since the shafts stood at 0, for shafts that now stand at `angle` [rad]."""
        paid = np.sign(self._per_rad) * angle
        turned = self._per_rad * angle - self._layer_m_rad * paid**2 / 2.0
        turned += self._runout_m * (np.sin(paid + self._phase) - np.sin(self._phase))
        self._end = np.clip(self._end, turned - self._play / 2.0, turned + self._play / 2.0)
        return self._end

    def lever(self, angle: Floats) -> Floats:
        """d travel / d angle within the play's ends, signed: on what lever the load turns the shaft [m/rad or 1]."""
        sign = np.sign(self._per_rad)
        paid = sign * angle
        return self._per_rad + sign * (self._runout_m * np.cos(paid + self._phase) - self._layer_m_rad * paid)
