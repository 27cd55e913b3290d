"""Which motor is it? One drive moves to and fro a little, so that somebody who stands beside it sees and hears it."""

import math
from typing import Final

import numpy as np

from cobra.description import RobotDescription
from cobra.motors.commissioning.procedure import Bounds, Floats, Seen

SWINGS: Final = 3
PERIOD_S: Final = 1.2
REST_S: Final = 0.25
"""At the end, until it is back."""
DEGREES: Final = 5.0
"""Of the output shaft; most drives' shafts can be seen to move by that, and a spool of 10 mm pays out 0.9 mm."""
LARGEST_DEGREES: Final = 90.0


class Wiggle:
    """Drive `index` swings by `degrees` of its output shaft, from end to end. A tendon is paid out only, never pulled."""

    def __init__(self, description: RobotDescription, index: int, degrees: float = DEGREES) -> None:
        drive = description.drives[index]
        self._index = index
        self._one_sided = drive.moves == "tendon"
        self._swing = abs(drive.travel_per_rad) * math.radians(degrees)
        self._per_degree = abs(drive.travel_per_rad) * math.radians(1.0)
        self._elapsed = 0.0
        self._start = 0.0
        self._seen = (math.inf, -math.inf)
        self.largest_A = 0.0
        """Current that it drew at most."""
        self.name = drive.name
        self.moved = (index,)
        self.bounds = Bounds(seconds=SWINGS * PERIOD_S + 2.0, travel=math.radians(2.0 * degrees + 5.0), current=0.4)

    @property
    def done(self) -> bool:
        return self._elapsed >= SWINGS * PERIOD_S + REST_S

    @property
    def progress(self) -> str:
        return f"drive {self.name} moves to and fro"

    @property
    def moved_degrees(self) -> float:
        """How far it really swung, by its own encoder."""
        low, high = self._seen
        return (high - low) / self._per_degree if high > low else 0.0

    def step(self, setpoint: Floats, seen: Seen, dt_s: float) -> Floats:
        """As `Procedure.step`."""
        if self._elapsed == 0.0:
            self._start = float(setpoint[self._index])
        self._elapsed += dt_s
        low, high = self._seen
        here = float(seen.travel[self._index])
        self._seen = (min(low, here), max(high, here))
        self.largest_A = max(self.largest_A, abs(float(np.nan_to_num(seen.feedback.current[self._index]))))
        phase = math.tau * min(self._elapsed, SWINGS * PERIOD_S) / PERIOD_S
        out = setpoint.copy()
        part = (1.0 - math.cos(phase)) / 2.0 if self._one_sided else math.sin(phase) / 2.0
        out[self._index] = self._start + self._swing * part
        return out
