"""Stretch and lost motion of the tendons, taken out of what the drives are told.

The tendons' travel for a configuration is Δl(q) less their stretch under the tensions that hold it, plus half the drives'
play on the side of the motion. Friction reverses with the direction in which a tendon slides (capstan), and so do
tensions, stretch and play: on a reversal all of them change over a short ramp. What the model leaves over is seen in the
estimated bends while the drives move, and taken up slowly.
"""

import numpy as np

from cobra.description import RobotDescription
from cobra.kinematics.configuration import Floats
from cobra.mechanics.tendon_balance import TendonBalance

DEAD_BAND_M = 1.5e-5
"""A tendon that moved back by less than this has not reversed: 0.3 degrees of bend at COBRA's radius."""
REVERSAL_S = 0.1
"""In which friction and play change sides."""
CORRECTION_1_S = 4.0
"""At which the estimated error of the bends is taken up while the robot moves."""
MAX_CORRECTION_RAD = 0.35
LAG_TICKS = 2
"""Between a setpoint and the feedback that shows it."""
STANDSTILL_RAD_S = 1e-3


class Directions:
    """Which way things slide, for commands that stop and reverse: −1…1, hysteretic, changing over a ramp.

    `step` takes positions; +1 is a falling one (a tendon drawn in). At rest the last direction stays.
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.value = np.ones(shape)
        self._goal = np.ones(shape)
        self._extreme: Floats | None = None

    def reset(self, position: Floats) -> None:
        """At rest at `position`, everything drawn in last, as after homing."""
        self.value = np.ones_like(position)
        self._goal = np.ones_like(position)
        self._extreme = position.copy()

    def resume(self, position: Floats) -> None:
        """At rest at another `position`; friction holds as it did."""
        self._extreme = position.copy()
        self.value = self._goal.copy()

    def step(self, position: Floats, dt_s: float) -> Floats:
        """The directions one tick later."""
        if self._extreme is None:
            self.reset(position)
        assert self._extreme is not None
        back = self._goal * (position - self._extreme)
        self._goal = np.where(back > DEAD_BAND_M, -self._goal, self._goal)
        self._extreme = np.where((back < 0.0) | (back > DEAD_BAND_M), position, self._extreme)
        most = 2.0 * dt_s / REVERSAL_S
        self.value = self.value + np.clip(self._goal - self.value, -most, most)
        return self.value


class Compensation:
    """From the configuration to the travel of the tendons (m,), with losses."""

    def __init__(self, description: RobotDescription, balance: TendonBalance) -> None:
        self._balance = balance
        tendons, sections = len(description.tendon_names), len(description.sections)
        self._level = description.tendon.pretension_N if description.tendon else 0.0
        self._slides = Directions((tendons, sections))
        self._spools = Directions((tendons,))
        self._correction = np.zeros(balance.slopes.shape[1])
        self._past: list[Floats] = []
        self._zero = np.zeros(tendons)
        self._spool = np.zeros(tendons)
        self.expected_N = np.zeros(tendons)
        """(m,) motor tensions that the model expects at the last configuration."""

    def reset(self) -> None:
        """Homed: straight, every tendon at pretension and drawn in last."""
        q = self._balance.configuration.rest()
        self._slides.reset(self._distal(q))
        self._spools.reset(np.zeros_like(self._zero))
        self._correction[:] = 0.0
        self._past = []
        self._zero = np.zeros_like(self._zero)
        self._zero = self._model(q, 0.0)

    def resume(self, q: Floats) -> None:
        """Switched on again where it stands, taken for q."""
        self._slides.resume(self._distal(q))
        self._past = []
        self._model(q, 0.0)
        self._spools.resume(self._spool)

    def travel(self, q: Floats, dt_s: float) -> Floats:
        """(m,) travel of the tendons for q, one tick after the last."""
        self._slides.step(self._distal(q), dt_s)
        return self._model(q, dt_s) + self._balance.slopes @ self._correction

    def correct(self, q: Floats, bends: Floats, moving: bool, dt_s: float) -> None:
        """Take up part of the difference between q and the estimated bends, while the robot moves."""
        columns = self._balance.tendons.columns
        self._past = [*self._past, q[columns].copy()][-(LAG_TICKS + 1) :]
        if not moving:
            return
        self._correction += CORRECTION_1_S * dt_s * (self._past[0] - bends)
        self._correction = np.clip(self._correction, -MAX_CORRECTION_RAD, MAX_CORRECTION_RAD)

    def _distal(self, q: Floats) -> Floats:
        """(m, n) how much longer each tendon is beyond the base of each section: that slides through the section."""
        balance = self._balance
        columns = balance.tendons.columns
        parts = balance.slopes * (q - balance.tendons.rest)[columns]
        sections = np.zeros((len(parts), len(balance.section_lengths_m)))
        np.add.at(sections.T, balance.column_section, parts.T)
        return np.cumsum(sections[:, ::-1], axis=1)[:, ::-1]

    def _model(self, q: Floats, dt_s: float) -> Floats:
        balance = self._balance
        slides = self._slides.value
        level = np.full(len(self._zero), self._level * np.exp(-balance.losses.conduit_capstan))
        _, held = balance.holding(q, level, slides[:, 0], slides)
        self.expected_N = held.motor_N
        spool = balance.slopes @ (q - balance.tendons.rest)[balance.tendons.columns] - held.stretch_m - self._zero
        self._spool = spool
        paying_out = -self._spools.step(spool, dt_s) if dt_s else -self._spools.value
        return spool + (paying_out + 1.0) * balance.losses.backlash_m / 2
