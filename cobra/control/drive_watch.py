"""Watches every drive's temperature, current and following over time: words of warning, and faults that stop the robot.

The drives' own flags come through `Feedback.faults`; this is what a drive does not tell by itself, for any protocol.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cobra.description import RobotDescription
from cobra.motors.bus import Feedback

Floats = NDArray[np.float64]

WARM_K: Final = 10.0
"""Under its limit a drive is called hot."""
HIGH_CURRENT: Final = 0.8
"""Part of a motor's maximum that is worth a warning, averaged over `CURRENT_TIME_S`."""
FULL_CURRENT: Final = 0.95
CURRENT_TIME_S: Final = 0.4
BEHIND_RAD: Final = 0.6
"""Of the output shaft: so far behind its setpoint a drive does not follow."""
BEHIND_TIME_S: Final = 0.5


@dataclass(frozen=True, slots=True)
class Watched:
    """One entry a drive, empty where all is well."""

    warnings: tuple[str, ...]
    faults: tuple[str, ...]


class DriveWatch:
    """Call `step` once a tick, `forget` when the drives are enabled anew."""

    def __init__(self, description: RobotDescription) -> None:
        motors = [description.motor_of(drive) for drive in description.drives]
        self._hot_C = np.array([motor.max_temperature_C for motor in motors])
        self._max_A = np.array([motor.max_current_A for motor in motors])
        self._none = ("",) * len(motors)
        self.forget()

    def forget(self) -> None:
        """What was, does not count any more."""
        n = len(self._none)
        self._current: Floats = np.zeros(n)
        self._behind_s: Floats = np.zeros(n)

    def step(self, feedback: Feedback, setpoint_rad: Floats | None, dt_s: float) -> Watched:
        """`setpoint_rad` (drives,) of the output shafts; None while nothing is commanded."""
        drawn = np.abs(np.where(np.isfinite(feedback.current), feedback.current, 0.0))
        self._current += (drawn - self._current) * min(1.0, dt_s / CURRENT_TIME_S)
        if setpoint_rad is None:
            self._behind_s[:] = 0.0
        else:
            behind = feedback.valid & (np.abs(setpoint_rad - feedback.angle) > BEHIND_RAD)
            self._behind_s = np.where(behind, self._behind_s + dt_s, 0.0)
        warm = feedback.temperature > self._hot_C - WARM_K
        high = self._current > HIGH_CURRENT * self._max_A
        lost = self._behind_s > BEHIND_TIME_S
        if not (warm.any() or high.any() or lost.any()):
            return Watched(self._none, self._none)
        return Watched(
            tuple(self._warning(i, feedback, bool(warm[i]), bool(high[i])) for i in range(len(warm))),
            tuple(self._fault(i, bool(lost[i]), setpoint_rad is not None) for i in range(len(warm))),
        )

    def _warning(self, i: int, feedback: Feedback, warm: bool, high: bool) -> str:
        words = []
        if warm:
            words.append(f"{feedback.temperature[i]:.0f} °C, limit {self._hot_C[i]:g} °C: let it rest")
        if high:
            words.append(f"{self._current[i]:.1f} A, limit {self._max_A[i]:g} A: is it blocked?")
        return "; ".join(words)

    def _fault(self, i: int, lost: bool, commanded: bool) -> str:
        if commanded and self._current[i] > FULL_CURRENT * self._max_A[i]:
            return f"it draws all the current it may ({self._max_A[i]:g} A): it is blocked or overloaded"
        return "it does not follow its setpoint: it is blocked, overloaded or switched off" if lost else ""
