"""The last of homing where nothing rubs along the tendons: then equal tensions mean straight, and are found finely.

A gear's friction hides the tension by a different amount each way and at rest. So before each reading every tendon is
paid out a little and wound in again, and all are read after the same motion.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

BEND_TOLERANCE = 0.004
"""Of the pretension: largest error of those combinations that bend the robot. They decide where straight is."""
TOLERANCE = 0.25
"""Of the pretension: largest error of any tendon."""
GOOD_READINGS = 3
"""In a row."""
TIMEOUT_S = 5.0
"""A coarse current may keep the fine tolerance out of reach; then the coarse one must do."""
MAX_CORRECTION_M = 3e-4
STROKE_M = 3e-5
OUT_TICKS = 3
STROKE_TICKS = 8
FIRST_GAIN_M_N = 1e-6
GAIN_GROWTH = 1.5
GAIN_CUT = 0.3
BEND_COUNTS, COUNTS = 0.5, 2.0
"""Counts of the current within which the tolerances cannot be told."""


@dataclass(slots=True)
class _Mode:
    """Tension control of a family of tendon combinations that share a stiffness: the gain finds it by itself."""

    projector: Floats
    gain: float = FIRST_GAIN_M_N
    last: Floats | None = None

    def step(self, error: Floats) -> Floats:
        """How much more to wind each tendon in [m] for tensions that are too low by `error` [N]."""
        part = self.projector @ error
        if self.last is not None:
            self.gain *= GAIN_CUT if float(part @ self.last) < 0.0 else GAIN_GROWTH
        self.last = part
        return np.clip(self.gain * part, -MAX_CORRECTION_M, MAX_CORRECTION_M)


class Settling:
    """Brings all tendons to their pretension, and those combinations that bend the robot most exactly.

    Args:
        bending: (tendons, tendons) projector onto those length changes that bend the robot; the others only pretension
            it. The two differ in stiffness by orders of magnitude, so each is settled with a gain of its own.
        count_N: tension of one count of the currents [N].
    """

    def __init__(self, bending: Floats, count_N: float) -> None:
        self._bending = _Mode(bending)
        self._tightening = _Mode(np.eye(len(bending)) - bending)
        self._count_N = count_N
        self._elapsed = 0.0
        self._tick = self._good = 0
        self.done = False

    def step(self, tension: Floats, pretension: float, dt_s: float) -> Floats:
        """How much more to pay each tendon out in this tick [m], from tensions freed of the gear's friction [N]."""
        self._elapsed += dt_s
        self._tick = (self._tick + 1) % STROKE_TICKS
        if self._tick == 1:
            return np.full(len(tension), STROKE_M)
        if self._tick == OUT_TICKS:
            return np.full(len(tension), -STROKE_M)
        return self._corrected(pretension - tension, pretension) if self._tick == 0 else np.zeros(len(tension))

    def _corrected(self, error: Floats, pretension: float) -> Floats:
        """Readings are whole counts of the current: what lies below them is no error that could be told."""
        bend_error = float(np.max(np.abs(self._bending.projector @ error)))
        near = float(np.max(np.abs(error))) <= max(TOLERANCE * pretension, COUNTS * self._count_N)
        straight = bend_error <= max(BEND_TOLERANCE * pretension, BEND_COUNTS * self._count_N)
        self._good = self._good + 1 if near and straight else 0
        if self._good >= GOOD_READINGS or (near and self._elapsed >= TIMEOUT_S):
            self.done = True
            return np.zeros(len(error))
        return -(self._bending.step(error) + self._tightening.step(error))
