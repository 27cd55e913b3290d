"""Find the zero of every tendon: pay out, wind to contact, settle at pretension, take that as zero.

Current alone is a poor witness (a jammed spool draws some too), so contact needs tension for a hold time, and travel and
time are bounded. Where the sections can be pulled together to a stop, that stop is the reference instead: against it a
tendon's force rises so steeply with its length that neither a gear's friction nor a coarse current reading matters.
"""

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from cobra.description import RobotDescription
from cobra.motors.seating import Seating, has_stop

Floats = NDArray[np.float64]

SLACK_M = 0.002
"""At least this much is paid out, and then more until the tension does not fall any more."""
MAX_SLACK_M = 0.030
SLACK_SPEED_M_S = 0.02
LOOK_BACK_TICKS = 10
STILL_FALLING = 0.05
"""Of the pretension: a smaller fall over the look-back is none."""
FREE_M = 0.0005
"""Wound in before the free reading is taken: by then the gear turns, and what it draws is friction alone."""
WIND_SPEED_M_S = 0.012
MAX_WIND_M = 0.040
CONTACT_FRACTION = 0.4
"""Of the pretension: a tendon that carries this much is wound far enough."""
CONTACT_HOLD_S = 0.03
BEND_TOLERANCE = 0.004
"""Of the pretension: largest error of those combinations that bend the robot. They decide where straight is."""
TOLERANCE = 0.25
"""Of the pretension: largest error of any tendon."""
GOOD_READINGS = 3
"""In a row."""
SETTLE_TIMEOUT_S = 5.0
"""Friction may keep the fine tolerance out of reach; then the coarse one must do."""
TIMEOUT_S = 25.0
MAX_CORRECTION_M = 3e-4
STROKE_M = 3e-5
"""In settling every tendon is paid out by this much and wound in again before it is read: a gear's friction hides the
tension by a different amount each way and at rest, so all are read after the same motion, winding in."""
OUT_TICKS = 3
STROKE_TICKS = 8
FIRST_GAIN_M_N = 1e-6
GAIN_GROWTH = 1.5
GAIN_CUT = 0.3
CONTACT_COUNTS = 3.0
"""A rise of the current by fewer counts is no contact."""
BEND_COUNTS, COUNTS = 0.5, 2.0
"""Counts of the current within which the tolerances cannot be told."""


class HomingError(RuntimeError):
    """Homing cannot go on. The message says which tendon and why."""


class _Stage(Enum):
    SLACK = "paying out"
    WIND = "winding to contact"
    SETTLE = "settling at pretension"
    SEAT = "pulling together to the stop"
    FREE = "letting go of the stop"
    DONE = "homed"


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


class Homing:
    """Steps all tendons together, so that antagonists balance; twist and feed stay where they are.

    Args:
        description: the robot.
        bending: (tendons, tendons) projector onto those length changes that bend the robot; the others only pretension
            it. The two differ in stiffness by orders of magnitude, so each is settled with a gain of its own.
    """

    def __init__(self, description: RobotDescription, bending: Floats) -> None:
        n = len(description.tendon_names)
        self._tendon = description.tendon
        self._names = description.tendon_names
        self._index = np.array(description.tendon_drives, dtype=np.int64)
        self._bending = _Mode(bending)
        self._tightening = _Mode(np.eye(n) - bending)
        self._stage = _Stage.SLACK
        self._elapsed = self._settling = 0.0
        self._stroke_tick = self._good = 0
        self._start: Floats | None = None
        self._target = np.zeros(0)
        self._wound_from = np.zeros(0)
        self._contact = np.zeros(n)
        self._free = np.zeros(n)
        """What each drive reads while it winds a slack tendon: friction, not tension."""
        self._readings: list[Floats] = []
        self._count_N = np.array([_count_N(description, i) for i in self._index])
        self._seating = Seating(description) if has_stop(description) else None
        self._stroke_m = float(self._seating.stroke_m.max()) if self._seating else 0.0

    @property
    def done(self) -> bool:
        return self._stage is _Stage.DONE

    @property
    def progress(self) -> str:
        """What it does now, in words."""
        return self._stage.value

    def step(self, travel: Floats, load: Floats, dt_s: float) -> Floats:
        """One tick: the next travel setpoint of all drives from the present one and the measured load.

        Raises:
            HomingError: a tendon was wound too far without tension, or it takes too long.
        """
        if self._tendon is None or not len(self._index):
            self._stage = _Stage.DONE
            return travel
        if self._start is None:
            self._start, self._target = travel.copy(), travel.copy()
        self._elapsed += dt_s
        if self._elapsed > TIMEOUT_S:
            raise HomingError(f"still {self.progress} after {TIMEOUT_S:.0f} s")
        tension = load[self._index]
        if self._stage is _Stage.SLACK:
            self._pay_out(self._start, tension, self._tendon.pretension_N, dt_s)
        elif self._stage is _Stage.WIND:
            self._wind(tension, self._tendon.pretension_N, dt_s)
        elif self._stage is _Stage.SETTLE:
            self._settle(tension - self._free, self._tendon.pretension_N, dt_s)
        elif self._seating is not None:
            self._seat(self._seating, tension - self._free, dt_s)
        return self._target.copy()

    def _pay_out(self, start: Floats, tension: Floats, pretension: float, dt_s: float) -> None:
        self._readings = [*self._readings, tension][-LOOK_BACK_TICKS:]
        paid = (self._target - start)[self._index]
        falling = self._readings[0] - tension > np.maximum(STILL_FALLING * pretension, self._count_N)
        more = (paid < SLACK_M) | (falling & (paid < MAX_SLACK_M + self._stroke_m))
        self._target[self._index] += np.where(more, SLACK_SPEED_M_S * dt_s, 0.0)
        if not np.any(more):
            self._stage = _Stage.WIND
            self._wound_from = self._target.copy()

    def _wind(self, tension: Floats, pretension: float, dt_s: float) -> None:
        wound = (self._wound_from - self._target)[self._index]
        free = wound <= FREE_M
        self._free = np.where(free, tension, np.minimum(self._free, tension))
        enough = np.maximum(CONTACT_FRACTION * pretension, CONTACT_COUNTS * self._count_N)
        touching = ~free & (tension - self._free >= enough)
        self._contact = np.where(touching, self._contact + dt_s, 0.0)
        self._target[self._index] -= np.where(touching, 0.0, WIND_SPEED_M_S * dt_s)
        if np.any(wound > MAX_WIND_M + self._stroke_m):
            self._complain_of_slack(wound)
        if np.all(self._contact >= CONTACT_HOLD_S):
            self._stage = _Stage.SEAT if self._seating else _Stage.SETTLE

    def _complain_of_slack(self, wound: Floats) -> None:
        worst = int(np.argmax(wound))
        raise HomingError(
            f"tendon {self._names[worst]} was wound in by {wound[worst] * 1e3:.0f} mm and is still slack: "
            "is it broken or off its spool?"
        )

    def _seat(self, seating: Seating, tension: Floats, dt_s: float) -> None:
        if self._stage is _Stage.SEAT:
            self._target[self._index] -= seating.pull(tension, dt_s)
            if np.any(seating.overrun):
                self._complain_of_slack(np.where(seating.overrun, (self._wound_from - self._target)[self._index], 0.0))
            if seating.seated:
                self._stage = _Stage.FREE
        else:
            self._target[self._index] += seating.release(dt_s)
            if seating.released:
                self._stage = _Stage.DONE

    def _settle(self, tension: Floats, pretension: float, dt_s: float) -> None:
        self._settling += dt_s
        self._stroke_tick = (self._stroke_tick + 1) % STROKE_TICKS
        if self._stroke_tick == 1:
            self._target[self._index] += STROKE_M
        elif self._stroke_tick == OUT_TICKS:
            self._target[self._index] -= STROKE_M
        elif self._stroke_tick == 0:
            self._correct(pretension - tension, pretension)

    def _correct(self, error: Floats, pretension: float) -> None:
        """Readings are whole counts of the current: what lies below them is no error that could be told."""
        count = float(np.max(self._count_N))
        bend_error = float(np.max(np.abs(self._bending.projector @ error)))
        near = float(np.max(np.abs(error))) <= max(TOLERANCE * pretension, COUNTS * count)
        straight = bend_error <= max(BEND_TOLERANCE * pretension, BEND_COUNTS * count)
        self._good = self._good + 1 if near and straight else 0
        if self._good >= GOOD_READINGS or (near and self._settling >= SETTLE_TIMEOUT_S):
            self._stage = _Stage.DONE
            return
        self._target[self._index] -= self._bending.step(error) + self._tightening.step(error)


def _count_N(description: RobotDescription, drive: int) -> float:
    """Tension of one count of a drive's current [N]: what it can tell at best."""
    motor = description.motor_of(description.drives[drive])
    torque = motor.current_per_count_A * motor.torque_constant_Nm_A
    return torque / abs(description.drives[drive].travel_per_rad)
