"""The last gate before the drives: travel, speed and overload. Whatever binds scales the whole step, so that the motion
keeps its direction and never jumps.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cobra.description import RobotDescription

Floats = NDArray[np.float64]
LEAST = 1e-12
"""Travel below this is none."""


@dataclass(frozen=True, slots=True)
class Allowed:
    """How much of a step the drives allow, and what binds, in words (empty when nothing does)."""

    scale: float
    reason: str = ""


class DriveLimits:
    """Limits of all drives in travel units."""

    def __init__(self, description: RobotDescription) -> None:
        drives = description.drives
        self._names = tuple(drive.name for drive in drives)
        self._low = np.array([drive.travel_limits[0] for drive in drives])
        self._high = np.array([drive.travel_limits[1] for drive in drives])
        self._speed = np.array(
            [description.motor_of(drive).max_speed_rad_s * abs(drive.travel_per_rad) for drive in drives]
        )
        self._tendons = np.array(description.tendon_drives, dtype=np.int64)
        self._max_tension = description.tendon.max_tension_N if description.tendon else np.inf

    def clamp(self, travel: Floats) -> Floats:
        """Travel inside the described range, whatever asked for it."""
        return np.clip(travel, self._low, self._high)

    def paced(self, travel: Floats, target: Floats, dt_s: float) -> Floats:
        """The way from `travel` to `target` that the drives' speeds allow in a tick, all scaled alike, inside the range."""
        step = self.clamp(target) - travel
        fastest = float(np.max(np.abs(step) / (self._speed * dt_s), initial=0.0))
        return self.clamp(travel + step / max(fastest, 1.0))

    def allow(self, travel: Floats, step: Floats, load: Floats, dt_s: float) -> Allowed:
        """How much of `step` [travel units] may be made from `travel`, given the measured `load` of the drives."""
        far = np.abs(step)
        if not np.all(np.isfinite(far)):
            return Allowed(0.0, "the motion is not finite; it was refused")
        overloaded = self._tendons[load[self._tendons] > self._max_tension]
        tightening = overloaded[step[overloaded] < -1e-9]
        if len(tightening):
            name = self._names[tightening[0]]
            return Allowed(0.0, f"tendon {name} is above {self._max_tension:.0f} N: drive the other way to relieve it")
        moves = far > LEAST
        if not moves.any():
            return Allowed(1.0)
        scale, reason = 1.0, ""
        far = np.maximum(far, LEAST)
        room = np.where(step > 0, self._high - travel, travel - self._low)
        fraction = np.where(moves, np.maximum(room, 0.0) / far, np.inf)
        pace = np.where(moves, self._speed * dt_s / far, np.inf)
        i = int(np.argmin(fraction))
        if fraction[i] < 1.0:
            scale, reason = (
                float(fraction[i]),
                f"drive {self._names[i]} is at the end of its travel: drive the other way",
            )
        return Allowed(min(scale, float(np.min(pace))), reason)
