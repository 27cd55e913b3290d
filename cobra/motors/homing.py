"""Find the zero of every tendon: pay out, wind to contact, settle at pretension, take that as zero.

Current alone is a poor witness (a jammed spool draws some too), so contact needs tension for a hold time, and travel and
time are bounded.
"""

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from cobra.description import RobotDescription

Floats = NDArray[np.float64]

SLACK_M = 0.002
SLACK_SPEED_M_S = 0.02
WIND_SPEED_M_S = 0.012
MAX_WIND_M = 0.040
CONTACT_HOLD_S = 0.03
SETTLE_HOLD_S = 0.3
TIMEOUT_S = 20.0
STEP_M = 5e-5
"""First step of the settling per tick; halved whenever the error changes its sign, so that it suits any tendon stiffness."""
MIN_STEP_M = 1e-6


class HomingError(RuntimeError):
    """Homing cannot go on. The message says which tendon and why."""


class _Stage(Enum):
    SLACK = "paying out"
    WIND = "winding to contact"
    SETTLE = "settling at pretension"
    DONE = "homed"


@dataclass(slots=True)
class _Tendons:
    start: Floats
    target: Floats
    contact_s: Floats
    step: Floats
    last_sign: Floats
    settled_s: float = 0.0


class Homing:
    """Steps all tendons together, so that antagonists balance; twist and feed stay where they are."""

    def __init__(self, description: RobotDescription) -> None:
        self._tendon = description.tendon
        self._names = description.tendon_names
        self._index = np.array(description.tendon_drives, dtype=np.int64)
        self._stage = _Stage.SLACK
        self._elapsed = 0.0
        self._state: _Tendons | None = None

    @property
    def done(self) -> bool:
        return self._stage is _Stage.DONE

    @property
    def progress(self) -> str:
        """What it does now, in words."""
        return self._stage.value

    def step(self, travel: Floats, load: Floats, dt_s: float) -> Floats:
        """One tick: the next travel setpoint of all drives from their measured travel and load.

        Raises:
            HomingError: a tendon was wound too far without tension, or it takes too long.
        """
        if self._tendon is None or not len(self._index):
            self._stage = _Stage.DONE
            return travel
        if self._state is None:
            start = travel.copy()
            n = len(self._index)
            self._state = _Tendons(start, start.copy(), np.zeros(n), np.full(n, STEP_M), np.zeros(n))
        self._elapsed += dt_s
        if self._elapsed > TIMEOUT_S:
            raise HomingError(f"still {self.progress} after {TIMEOUT_S:.0f} s")
        tension = load[self._index]
        if self._stage is _Stage.SLACK:
            self._pay_out(self._state, dt_s)
        elif self._stage is _Stage.WIND:
            self._wind(self._state, tension, dt_s)
        elif self._stage is _Stage.SETTLE:
            self._settle(self._state, tension, dt_s)
        return self._state.target.copy()

    def _pay_out(self, state: _Tendons, dt_s: float) -> None:
        goal = state.start[self._index] + SLACK_M
        state.target[self._index] = np.minimum(state.target[self._index] + SLACK_SPEED_M_S * dt_s, goal)
        if np.all(state.target[self._index] >= goal):
            self._stage = _Stage.WIND

    def _wind(self, state: _Tendons, tension: Floats, dt_s: float) -> None:
        assert self._tendon is not None
        touching = tension >= 0.6 * self._tendon.pretension_N
        state.contact_s = np.where(touching, state.contact_s + dt_s, 0.0)
        state.target[self._index] -= np.where(touching, 0.0, WIND_SPEED_M_S * dt_s)
        wound = state.start[self._index] - state.target[self._index]
        if np.any(wound > MAX_WIND_M):
            name = self._names[int(np.argmax(wound))]
            raise HomingError(
                f"tendon {name} was wound in by {MAX_WIND_M * 1e3:.0f} mm and is still slack: is it broken or off its spool?"
            )
        if np.all(state.contact_s >= CONTACT_HOLD_S):
            self._stage = _Stage.SETTLE

    def _settle(self, state: _Tendons, tension: Floats, dt_s: float) -> None:
        assert self._tendon is not None
        error = self._tendon.pretension_N - tension
        sign = np.sign(error)
        crossed = sign * state.last_sign < 0
        state.step = np.where(crossed, np.maximum(state.step / 2, MIN_STEP_M), state.step)
        state.last_sign = np.where(sign != 0, sign, state.last_sign)
        near = np.abs(error) <= 0.25 * self._tendon.pretension_N
        state.target[self._index] -= np.where(near, 0.0, sign * state.step)
        state.settled_s = state.settled_s + dt_s if bool(np.all(near)) else 0.0
        if state.settled_s >= SETTLE_HOLD_S:
            self._stage = _Stage.DONE
