"""Stretch, friction and play of the tendons, taken out of what the drives are told.

The model of the tendons (`cobra.mechanics.rubbing`), in the state that the feedback has brought it to, is asked where the
motor ends must go for the commanded bends. After a reversal that is further by what stretch and friction swallow and by
the play of the gears: both are crossed at a limited rate. While nothing is to move, nothing is asked, so nothing chatters.
"""

import numpy as np

from cobra.kinematics.configuration import Floats
from cobra.mechanics.rubbing import Rubbing

TAKE_UP_RAD_S = 5.0
"""No lost motion is taken up faster, as bend of the straight tendon map."""
ASTRAY_RAD = 0.005
"""Bends may err by this where setting them right costs a reversal of their drives, which crosses all that friction holds."""
BEHIND_RAD = 1e-3
"""And by this in the direction in which they move."""
DEAD_BAND_M = 1.5e-5
"""A drive that is to turn back by less than this does not cross its play."""
REVERSAL_S = 0.05
"""In which a drive crosses its play."""


class Compensation:
    """The travel of the tendons (m,) that brings a robot to the commanded bends."""

    def __init__(self, model: Rubbing) -> None:
        self._model = model
        self._play_m = model.losses.backlash_m
        self._base = np.zeros(len(model.slopes))
        self._shift = np.zeros(len(model.columns))
        self._side = self._goal = -np.ones(len(model.slopes))
        self._turn = self._base.copy()

    def resume(self, travel: Floats, spool_m: Floats) -> None:
        """Begin at this travel (m,) of the drives' shafts, where the spools stand at `spool_m`."""
        self._shift[:] = 0.0
        half = self._play_m / 2
        lag = np.where(half > 0.0, (travel - spool_m) / np.maximum(half, 1e-12), -1.0)
        self._side = np.clip(lag, -1.0, 1.0)
        self._goal = np.where(self._side < 0.0, -1.0, 1.0)
        self._base = travel - self._side * half
        self._turn = self._base.copy()

    def travel(self) -> Floats:
        """(m,) for the shafts."""
        return self._ends() + self._side * self._play_m / 2

    def step(self, q: Floats, velocity: Floats, extra: Floats, spool_m: Floats, outside: Floats, dt_s: float) -> None:
        """One tick on the way to q (size,), with its velocity.

        `extra` (m,) is what others add to the travel (trims), `spool_m` (m,) where the spools stand now by the feedback.
        """
        ends = self._ends()
        moves = velocity[self._model.columns]
        tolerance = np.where(np.stack([moves > 0.0, moves < 0.0]), BEHIND_RAD, ASTRAY_RAD)
        wanted = self._model.reach(q, velocity, ends + extra - spool_m, outside, tolerance)
        fastest = float(np.max(np.abs(wanted), initial=0.0))
        self._shift = self._shift + wanted * min(1.0, TAKE_UP_RAD_S * dt_s / max(fastest, 1e-12))
        ends = self._ends()
        back = self._goal * (ends - self._turn)
        self._goal = np.where(back < -DEAD_BAND_M, -self._goal, self._goal)
        self._turn = np.where((back > 0.0) | (back < -DEAD_BAND_M), ends, self._turn)
        most = 2.0 * dt_s / REVERSAL_S
        self._side = self._side + np.clip(self._goal - self._side, -most, most)

    def _ends(self) -> Floats:
        """(m,) where the spools are to go."""
        out: Floats = self._base + self._model.slopes @ self._shift
        return out
