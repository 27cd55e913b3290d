"""From wanted rates of q to its next value: ramped, braked in time at every limit, led inwards where a limit shrinks."""

import math

import numpy as np
from numpy.typing import NDArray

from cobra.description import RobotDescription
from cobra.kinematics.backbone import Backbone
from cobra.kinematics.configuration import FEED, TWIST, Configuration
from cobra.kinematics.ramps import approached, braking_speed, reached, shortened

Floats = NDArray[np.float64]

TURNING_1_S = 1.5
"""How fast a bend at its limit may turn around [rad/s]: where the port takes the limit away, it would have to turn ever faster."""


class JointRates:
    """Limits of one robot, entry by entry of q; a bend is limited as a vector."""

    def __init__(self, description: RobotDescription) -> None:
        self.configuration = Configuration(description)
        self._backbone = Backbone(description)
        self.rate = self.configuration.rate.copy()
        """Largest rates (size,); the feed's also lets the port straighten a bent section in time."""
        self.unbending_m_s = unbending_feed(description)
        if description.feed:
            self.rate[FEED] = min(self.rate[FEED], self.unbending_m_s)
        lengths = (index for index in self.configuration.lengths if index is not None)
        self._scalars = tuple(i for i in (TWIST, FEED, *lengths) if self.rate[i] > 0.0)

    def step(self, q: Floats, velocity: Floats, wanted: Floats, dt_s: float, fed_m: float | None = None) -> Floats:
        """The next q (size,).

        Args:
            q, velocity: now.
            wanted: rates (size,) that are asked for; zero ramps to rest.
            dt_s: duration of the tick.
            fed_m: the exposed length of a robot that is fed by hand.
        """
        out = q.copy()
        if fed_m is not None:
            out[FEED] = fed_m
        for i in self._scalars:
            out[i] += self._scalar_speed(i, q, velocity[i], wanted[i], dt_s) * dt_s
            out[i] = min(max(out[i], self.configuration.low[i]), self.configuration.high[i])
        limits = self._backbone.bend_limits(np.array([q, out]))
        for where, limit in zip(self.configuration.bends, limits.T, strict=True):
            out[where] = self._bend(q[where], velocity[where], wanted[where], where.start, limit, dt_s)
        return out

    def inside(self, q: Floats) -> Floats:
        """q brought inside every limit (size,)."""
        q = np.clip(q, self.configuration.low, self.configuration.high)
        for where, limit in zip(self.configuration.bends, self._backbone.bend_limits(q), strict=True):
            q[where] = shortened(q[where], float(limit))
        return q

    def _scalar_speed(self, i: int, q: Floats, speed: float, wanted: float, dt_s: float) -> float:
        """Speed of twist, feed or a length: ramped, and never faster than it can stop before its limit."""
        acceleration = self.configuration.acceleration[i]
        speed = approached(speed, wanted, acceleration * dt_s)
        up = braking_speed(self.configuration.high[i] - q[i], acceleration, dt_s)
        down = braking_speed(q[i] - self.configuration.low[i], acceleration, dt_s)
        return min(max(speed, -down), up)

    def _bend(self, bend: Floats, speed: Floats, wanted: Floats, index: int, limits: Floats, dt_s: float) -> Floats:
        """The next bend vector of a section: ramped, braked at its limit, and led inwards when the limit shrinks.

        `limits` (2,) are those now and after this tick. Where the port takes them away, the bend is braked against them
        as they move: it begins to straighten before they reach it.
        """
        now, limit = float(limits[0]), float(limits[1])
        if not (speed.any() or wanted.any()) and math.hypot(*bend) <= limit:
            return bend
        step = self.rate[index] * dt_s
        acceleration = self.configuration.acceleration[index]
        inside = shortened(bend, limit)
        left = max(step - math.dist(bend, inside), 0.0)
        size = math.hypot(*bend)
        if size > 1e-9:
            outward = bend / size
            around = np.array([-outward[1], outward[0]])
            most = min(limit - now, 0.0) / dt_s + braking_speed(now - size, acceleration, dt_s)
            turning = TURNING_1_S * limit * limit / size
            out, turn = float(wanted @ outward), float(wanted @ around)
            wanted = min(out, most) * outward + min(max(turn, -turning), turning) * around
            velocity = speed + shortened(wanted - speed, acceleration * dt_s)
            velocity = velocity - max(float(velocity @ outward) - most, 0.0) * outward
        else:
            velocity = speed + shortened(wanted - speed, acceleration * dt_s)
        end = shortened(bend + velocity * dt_s, limit)
        return reached(inside, end, bend, step) if left else inside


def unbending_feed(description: RobotDescription) -> float:
    """Fastest retraction [m/s]: the port takes κ_max times the feed rate off a fully bent section, no faster than it
    may unbend. Infinite where nothing bends by itself."""
    curvature = [description.sections[i].max_curvature_1_m for i in description.active_sections]
    return math.radians(description.teleop.bend_rate_deg_s) / max(curvature) if curvature else math.inf
