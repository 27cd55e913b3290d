"""Pulls to and fro, in which friction on the way to the tip cancels: so equal tensions at the motors are equal at the tip.

A tendon that was only wound in carries less at its far end than at its motor, by what its conduit takes, and no two conduits
take alike: equal readings then leave the robot bent. While all tendons are pulled to and fro far enough to slide both ways, each
one's far end goes as far below its motor's tension as above it, and so does its reading for the gear's friction: over a whole
cycle the means tell. After each cycle every tendon is paid out or wound in towards the others. In the end the pulls die away.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

SPEED_M_S: Final = 0.012
DYING: Final = (-0.7, 0.5, -0.3, 0.3)
"""Last strokes, in parts of the amplitude: they end with paying out."""
REST_S: Final = 0.1
"""In the end, until the readings are of where the tendons stand."""
BENDING_GAIN: Final = 1.8
EVENING_GAIN: Final = 0.8
"""Part of a tendon's stretch under what its mean is off by, that is taken up after a cycle. Where the tensions bend the robot
it gives way too, more than the tendon stretches; where they only balance each other it does not."""
MOST_M: Final = 0.002
"""Taken up after one cycle."""


class Dither:
    """All tendons (m,) together by the same strokes, and each a little more or less until their means are alike.

    It begins and ends with paying out, so that what follows winds in, as before it.

    Args:
        amplitude_m: of a stroke to either side of where it begins.
        cycles: of full strokes, before they die away.
        compliance_m_N: what a newton stretches a tendon by.
        bending: (m, m) projector onto those length changes that bend the robot.
    """

    def __init__(self, amplitude_m: float, cycles: int, compliance_m_N: float, bending: Floats) -> None:
        self._goals = [amplitude_m, *[-amplitude_m, amplitude_m] * cycles, *(part * amplitude_m for part in DYING)]
        self._amplitude_m = amplitude_m
        self._gain = compliance_m_N * (EVENING_GAIN * np.eye(len(bending)) + (BENDING_GAIN - EVENING_GAIN) * bending)
        self._at = self._resting = 0.0
        self._peaks = 0
        """How often the tendons were paid out in full."""
        self._sum: Floats = np.zeros(len(bending))
        self._ticks = 0
        self._owed: Floats = np.zeros(len(bending))
        """(m,) still to be paid out beside the strokes [m]."""

    @property
    def done(self) -> bool:
        return not self._goals and self._resting >= REST_S

    def step(self, tension_N: Floats, dt_s: float) -> Floats:
        """How much more to pay out now (m,) [m], from the tensions at the motors (m,); the gears' friction may be in them."""
        if not self._goals:
            self._resting += dt_s
            return np.zeros_like(tension_N)
        goal = self._goals[0]
        left = goal - self._at
        moved = float(np.clip(left, -SPEED_M_S * dt_s, SPEED_M_S * dt_s))
        self._at += moved
        self._sum = self._sum + tension_N
        self._ticks += 1
        # Within half a cycle, so that the mean of the next one is of where the tendon then stands.
        most = MOST_M * min(1.0, SPEED_M_S * dt_s / (2.0 * self._amplitude_m))
        own = np.clip(self._owed, -most, most)
        self._owed = self._owed - own
        if moved == left:
            self._goals.pop(0)
            self._after_stroke(goal)
        return np.asarray(moved + own)

    def _after_stroke(self, goal: float) -> None:
        if goal != self._amplitude_m:
            return
        if self._peaks:
            mean = self._sum / self._ticks
            self._owed = np.clip(self._gain @ (mean - mean.mean()), -MOST_M, MOST_M)
        self._peaks += 1
        self._sum, self._ticks = np.zeros_like(self._sum), 0
