"""Section mode: the sticks bend the chosen section (and change its length) and the tip section, twist and feed the base."""

import numpy as np
from numpy.typing import NDArray

from cobra.control.modes.joint_rates import JointRates
from cobra.control.modes.stick_frame import bend_direction
from cobra.description import RobotDescription
from cobra.kinematics.backbone import Backbone
from cobra.kinematics.configuration import FEED, TWIST
from cobra.kinematics.ramps import shortened
from cobra.messages import Intent, ModeReport

Floats = NDArray[np.float64]


class SectionMode:
    """Holds the commanded q and its velocity; see `Mode`."""

    def __init__(self, description: RobotDescription) -> None:
        self._rates = JointRates(description)
        self._backbone = Backbone(description)
        self._active = description.active_sections
        self._bends = self._rates.configuration.bends
        self.q: Floats = self._rates.configuration.rest()
        self.velocity: Floats = np.zeros_like(self.q)

    def warm_up(self) -> None:
        """Nothing here is compiled."""

    def reset(self, q: Floats) -> None:
        self.q, self.velocity = self._rates.inside(q), np.zeros_like(q)

    def propose(self, intent: Intent | None, dt_s: float, fed_m: float | None = None) -> tuple[Floats, Floats]:
        wanted = self._wanted(intent) if intent else np.zeros_like(self.q)
        q = self._rates.step(self.q, self.velocity, wanted, dt_s, fed_m)
        return q, (q - self.q) / dt_s

    def take(self, q: Floats, velocity: Floats) -> None:
        self.q, self.velocity = q, velocity

    def report(self) -> ModeReport:
        return ModeReport()

    def _wanted(self, intent: Intent) -> Floats:
        rates = np.zeros_like(self.q)
        rates[TWIST], rates[FEED] = intent.twist, intent.feed
        sticks = [(self._active[-1], intent.secondary)] if self._active else []
        if intent.section in self._active:
            sticks.append((intent.section, intent.primary))
            if (length := self._rates.configuration.lengths[intent.section]) is not None:
                rates[length] = intent.length
        for section, stick in sticks:
            if any(stick):
                direction = bend_direction(self._backbone, self.q, intent.frame, section, np.array(stick))
                rates[self._bends[section]] += direction
        for i in self._active:
            rates[self._bends[i]] = shortened(rates[self._bends[i]], 1.0)
        return rates * self._rates.rate * intent.speed
