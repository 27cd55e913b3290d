"""From an intent to the commanded configuration: rates, never positions, limited in speed and acceleration."""

import math

import numpy as np
from numpy.typing import NDArray

from cobra.description import RobotDescription
from cobra.kinematics.backbone import Backbone
from cobra.kinematics.configuration import FEED, TWIST, Configuration
from cobra.messages import Intent

Floats = NDArray[np.float64]


class SectionMotion:
    """Section mode: the sticks bend the chosen section and the tip section, twist and feed the base.

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
        self._scalars = tuple(i for i in (TWIST, FEED) if self._rate[i] > 0.0)
        self.q: Floats = self.configuration.rest()
        self.velocity: Floats = np.zeros_like(self.q)

    def reset(self, q: Floats) -> None:
        """Start at rest from q, brought inside the limits (bumpless engagement)."""
        self.q = self._inside_limits(q)
        self.velocity = np.zeros_like(self.q)

    def propose(self, intent: Intent | None, dt_s: float) -> tuple[Floats, Floats]:
        """The next q and its velocity after one tick of `dt_s`; None ramps every motion to rest."""
        wanted = self._wanted(intent) if intent else np.zeros_like(self.q)
        velocity = self._brake_at_limits(self._ramp(wanted, dt_s), dt_s)
        q = self._inside_limits(self.q + velocity * dt_s)
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
            rates[bends[self._active[-1]]] += intent.secondary
            for i in self._active:
                rates[bends[i]] = _shorten(rates[bends[i]], 1.0)
        return rates * self._rate * intent.speed

    def _ramp(self, wanted: Floats, dt_s: float) -> Floats:
        step = self.configuration.acceleration * dt_s
        velocity = self.velocity.copy()
        for i in self._scalars:
            velocity[i] += np.clip(wanted[i] - velocity[i], -step[i], step[i])
        for i in self._active:
            where = self.configuration.bends[i]
            velocity[where] += _shorten(wanted[where] - velocity[where], step[where.start])
        return velocity

    def _brake_at_limits(self, velocity: Floats, dt_s: float) -> Floats:
        """Approach every limit no faster than the deceleration can stop it."""
        layout = self.configuration
        for i in self._scalars:
            up = _braking_speed(layout.high[i] - self.q[i], layout.acceleration[i], dt_s)
            down = _braking_speed(self.q[i] - layout.low[i], layout.acceleration[i], dt_s)
            velocity[i] = np.clip(velocity[i], -down, up)
        room = self._backbone.bend_limits(self.q)
        for i in self._active:
            where = layout.bends[i]
            bend = float(np.hypot(*self.q[where]))
            if bend < 1e-9:
                continue
            outward = self.q[where] / bend
            speed = float(velocity[where] @ outward)
            allowed = _braking_speed(room[i] - bend, layout.acceleration[where.start], dt_s)
            if speed > allowed:
                velocity[where] -= (speed - allowed) * outward
        return velocity

    def _inside_limits(self, q: Floats) -> Floats:
        q = np.clip(q, self.configuration.low, self.configuration.high)
        for where, limit in zip(self.configuration.bends, self._backbone.bend_limits(q), strict=True):
            q[where] = _shorten(q[where], float(limit))
        return q


def _braking_speed(distance: float, acceleration: float, dt_s: float) -> float:
    """Largest speed for the next step from which steps of `dt_s` can still come to rest within `distance`.

    Far away: v dt + v²/2a − v dt/2 + a dt²/8 ≤ d, the sum of a ramp's steps. Within one step of rest: all that is left.
    """
    distance = max(distance, 0.0)
    ramp = math.sqrt(2.0 * acceleration * distance) - 0.5 * acceleration * dt_s
    return max(ramp, min(distance / dt_s, acceleration * dt_s))


def _shorten(vector: Floats, length: float) -> Floats:
    """The vector, no longer than `length`."""
    size = math.hypot(vector[0], vector[1])
    return vector if size <= length else vector * (length / size)
