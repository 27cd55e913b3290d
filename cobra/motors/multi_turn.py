"""Multi-turn angle from a single-turn encoder on the motor's shaft (RMD dialect v1).

Every reply carries the encoder; the multi-turn angle (0x92) is read once at the start and then round-robin as a check.
Between two replies less than half a turn can pass as long as the gap is short; after a longer gap the turns are guessed
from the speed, and the next 0x92 decides.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

RESTART_S: Final = 0.15
"""A drive that was silent for longer may have been without power, and counts turns from anew."""

SAFE_TURN_DEG: Final = 144.0
"""A shaft that may have turned farther than this since its last reading may have turned more than half a turn."""
JUMP_DEG: Final = 60.0
"""A shaft cannot have turned by so much more than at full speed since its last reading: that is 15 ms of delay of the reply
before, at full speed."""


class MultiTurn:
    """Angles of n motor shafts [degrees], NaN until anchored."""

    def __init__(self, counts_per_turn: Floats, full_speed_dps: Floats) -> None:
        """Both (n,), of the motor shafts."""
        n = len(counts_per_turn)
        self.angle_deg: Floats = np.full(n, np.nan)
        self.doubtful: Bools = np.ones(n, dtype=bool)
        """Turns guessed over a long gap, or not yet anchored: 0x92 is wanted."""
        self.jump_deg: Floats = np.zeros(n)
        """By how much a shaft was elsewhere in the newest reading than it can have turned to since the one before; 0: it was not."""
        self._counts = counts_per_turn
        self._full_speed_dps = full_speed_dps
        self._safe_gap_s = SAFE_TURN_DEG / full_speed_dps
        self._encoder: Floats = np.full(n, np.nan)
        self._speed_dps: Floats = np.zeros(n)
        self._time_s: Floats = np.full(n, -np.inf)
        self._before_deg: Floats = np.full(n, np.nan)
        self._silence_s: Floats = np.zeros(n)

    def advance(self, encoder: Floats, speed_dps: Floats, time_s: Floats) -> None:
        """Take the newest encoder readings, speeds and their times; a drive whose time did not change stays. All (n,)."""
        fresh = time_s > self._time_s
        first = fresh & np.isnan(self._encoder)
        gap = np.where(fresh & ~first, time_s - self._time_s, 0.0)
        long = gap > self._safe_gap_s
        expected = np.where(long, 0.5 * (speed_dps + self._speed_dps) * gap * self._counts / 360.0, 0.0)
        step = np.where(fresh & ~first, encoder - self._encoder, 0.0)
        step += np.round((expected - step) / self._counts) * self._counts
        self._before_deg = np.where(long & ~self.doubtful, self.angle_deg, self._before_deg)
        self._silence_s = np.maximum(self._silence_s, gap)
        step_deg = step * (360.0 / self._counts)
        possible_deg = self._full_speed_dps * gap + JUMP_DEG
        self.jump_deg = np.where(~long & (np.abs(step_deg) > possible_deg), step_deg, 0.0)
        self.angle_deg += step_deg
        self.doubtful |= long
        self._encoder = np.where(fresh, encoder, self._encoder)
        self._speed_dps = np.where(fresh, speed_dps, self._speed_dps)
        self._time_s = np.where(fresh, time_s, self._time_s)

    def anchor(self, i: int, angle_deg: float) -> int:
        """Compare with the multi-turn angle that drive i reports; set what was not known, correct whole turns.

        Returns the turns by which the angle is elsewhere than it can be: off a count that was not in doubt, or, after a long
        silence, farther than a drive goes that only finishes its last setpoint. It was restarted, or its encoder slipped.
        """
        if np.isnan(self._encoder[i]):
            return 0
        trusted, silence = not self.doubtful[i], self._silence_s[i]
        self.doubtful[i], self._silence_s[i] = False, 0.0
        if np.isnan(self.angle_deg[i]):
            self.angle_deg[i] = angle_deg
            return 0
        turns = round((angle_deg - self.angle_deg[i]) / 360.0)
        self.angle_deg[i] += 360.0 * turns
        if trusted:
            return turns
        return round((self.angle_deg[i] - self._before_deg[i]) / 360.0) if silence > RESTART_S else 0
