"""From an intent to the commanded configuration: rates, never positions, limited in speed and acceleration."""

import math

import numpy as np
from numpy.typing import NDArray

from cobra.description import RobotDescription
from cobra.kinematics.backbone import Backbone
from cobra.kinematics.configuration import FEED, TWIST, Configuration
from cobra.kinematics.ramps import approached, braking_speed, reached, shortened
from cobra.messages import Intent

Floats = NDArray[np.float64]


class SectionMotion:
    """Section mode: the sticks bend the chosen section (and change its length) and the tip section, twist and feed the base.

    Holds the commanded configuration q and its velocity. `propose` computes the next ones without taking them, so that
    later limits may still scale the step; `take` accepts it.
    """

    def __init__(self, description: RobotDescription) -> None:
        self.configuration = Configuration(description)
        self._active = description.active_sections
        self._backbone = Backbone(description)
        self._rate = self.configuration.rate.copy()
        if description.feed:
            # Retracting past the port unbends a fully bent section at κ_max times the feed rate: no faster than it may.
            steepest = max(section.max_curvature_1_m for section in description.sections)
            self._rate[FEED] = min(self._rate[FEED], math.radians(description.teleop.bend_rate_deg_s) / steepest)
        lengths = (index for index in self.configuration.lengths if index is not None)
        self._scalars = tuple(i for i in (TWIST, FEED, *lengths) if self._rate[i] > 0.0)
        self.q: Floats = self.configuration.rest()
        self.velocity: Floats = np.zeros_like(self.q)

    def reset(self, q: Floats) -> None:
        """Start at rest from q, brought inside the limits (bumpless engagement)."""
        self.q = self._inside_limits(q)
        self.velocity = np.zeros_like(self.q)

    def propose(self, intent: Intent | None, dt_s: float) -> tuple[Floats, Floats]:
        """The next q and its velocity after one tick of `dt_s`; None ramps every motion to rest."""
        wanted = self._wanted(intent) if intent else np.zeros_like(self.q)
        q = self.q.copy()
        for i in self._scalars:
            q[i] += self._scalar_speed(i, wanted[i], dt_s) * dt_s
            q[i] = min(max(q[i], self.configuration.low[i]), self.configuration.high[i])
        limits = self._backbone.bend_limits(q)
        for i, limit in enumerate(limits):
            where = self.configuration.bends[i]
            q[where] = self._bend(where, wanted[where], float(limit), dt_s)
        return q, (q - self.q) / dt_s

    def take(self, q: Floats, velocity: Floats) -> None:
        """Make a proposed step, or the part of it that was allowed, the commanded one."""
        self.q, self.velocity = q, velocity

    def _wanted(self, intent: Intent) -> Floats:
        rates = np.zeros_like(self.q)
        rates[TWIST], rates[FEED] = intent.twist, intent.feed
        if self._active:
            bends = self.configuration.bends
            if intent.section in self._active:
                rates[bends[intent.section]] += intent.primary
                if (length := self.configuration.lengths[intent.section]) is not None:
                    rates[length] = intent.length
            rates[bends[self._active[-1]]] += intent.secondary
            for i in self._active:
                rates[bends[i]] = shortened(rates[bends[i]], 1.0)
        return rates * self._rate * intent.speed

    def _scalar_speed(self, i: int, wanted: float, dt_s: float) -> float:
        """Speed of twist, feed or a length: ramped, and never faster than it can stop before its limit."""
        acceleration = self.configuration.acceleration[i]
        speed = approached(self.velocity[i], wanted, acceleration * dt_s)
        up = braking_speed(self.configuration.high[i] - self.q[i], acceleration, dt_s)
        down = braking_speed(self.q[i] - self.configuration.low[i], acceleration, dt_s)
        return min(max(speed, -down), up)

    def _bend(self, where: slice, wanted: Floats, limit: float, dt_s: float) -> Floats:
        """The next bend vector of a section: ramped, braked at its limit, and led inwards when the limit shrinks."""
        step = self._rate[where.start] * dt_s
        acceleration = self.configuration.acceleration[where.start]
        bend = self.q[where]
        inside = shortened(bend, limit)
        left = max(step - math.dist(bend, inside), 0.0)
        velocity = self.velocity[where] + shortened(wanted - self.velocity[where], acceleration * dt_s)
        size = math.hypot(*inside)
        if size > 1e-9:
            outward = inside / size
            speed = float(velocity @ outward)
            velocity = velocity - max(speed - braking_speed(limit - size, acceleration, dt_s), 0.0) * outward
        return reached(inside, inside + shortened(velocity * dt_s, left), np.zeros(2), limit)

    def _inside_limits(self, q: Floats) -> Floats:
        q = np.clip(q, self.configuration.low, self.configuration.high)
        for where, limit in zip(self.configuration.bends, self._backbone.bend_limits(q), strict=True):
            q[where] = shortened(q[where], float(limit))
        return q
