"""Tip following: steer the leading section and feed; the body stays on the path that the tip has passed.

Feeding appends to the path, straight on from its end. Steering bends the leading section and with it the path under
it, as the body moves, and forgets what lies ahead. Retracting replays. Every tick all bends are fitted together.
"""

import math
from typing import NamedTuple

import numpy as np

from cobra.description import RobotDescription
from cobra.kinematics.backbone import Backbone
from cobra.kinematics.configuration import FEED, Configuration, Floats
from cobra.kinematics.path_fit import PathFit
from cobra.kinematics.ramps import approached, braking_speed, reached, shortened
from cobra.kinematics.tip_path import TipPath

PREVIEW_M = 0.002
"""At least so far ahead of the tip the shape is computed, to feed no faster than the bends can follow."""
FOLLOWING_SHARE = 0.5
"""Of the bends' speed that feeding may ask for: the rest is for their acceleration, which the preview does not know."""
SHARPEST_PATH = 0.9
"""How sharply steering may bend the path, of what the sections can: the rest is for what arcs cannot follow."""


class Proposal(NamedTuple):
    """A step that is proposed and not yet taken."""

    q: Floats
    fitted: Floats
    """(size,) the bends laid on the path."""
    aim: Floats
    """(size,) on the way there, no faster than the bends may go."""
    turning: Floats
    """(2,) the steering rate [rad/s]."""
    turn_rad: Floats
    """(2,) what it turns in this tick."""


class TipFollowing:
    """Holds the commanded q, its velocity and the path.

    `propose` computes the next q without taking it, so that later limits may still scale the step; `take` accepts it.
    """

    def __init__(self, description: RobotDescription) -> None:
        if not description.active_sections:
            raise ValueError(f"{description.name}: tip following needs a section with tendons; this robot has none")
        self.configuration = layout = Configuration(description)
        self.fit = PathFit(description)
        self._backbone = Backbone(description)
        self._active = description.active_sections
        self.leading = self._active[-1]
        """Index of the section that steers."""
        self._bend_rate = np.array([layout.rate[bend.start] for bend in layout.bends])
        self._bend_acceleration = np.array([layout.acceleration[bend.start] for bend in layout.bends])
        curvature = self._backbone.max_curvature_1_m[list(self._active)]
        self._sharpest_1_m = SHARPEST_PATH * float(curvature.min())
        # The port takes κ_max times the feed rate off a fully bent section: no faster than it may unbend.
        self._retract_m_s = min(layout.rate[FEED], float((self._bend_rate[list(self._active)] / curvature).min()))
        self.reset(layout.rest())

    def warm_up(self) -> None:
        """Compile now, and not while driving."""
        self.fit.warm_up()

    def reset(self, q: Floats) -> None:
        """Start at rest at q. The path is where the body lies now, so that nothing moves."""
        self.q: Floats = np.array(q, dtype=np.float64)
        self.velocity: Floats = np.zeros_like(self.q)
        self.path = TipPath.along(self._backbone, self.q)
        self.deviation_m = 0.0
        """Largest distance of the exposed body from the path now."""
        self.deviation_max_m = 0.0
        """The largest since `reset`."""
        self._fitted = self._aim = self.q.copy()
        self._turning: Floats = np.zeros(2)
        self._proposed = Proposal(self.q, self._fitted, self._aim, self._turning, self._turning)

    @property
    def beyond_m(self) -> float:
        """How much of the passive body is outside [m]: it follows the path only where the surroundings guide it."""
        return max(0.0, float(self.q[FEED]) - self._backbone.active_length_m)

    def propose(
        self, steer_rad_s: Floats, feed_m_s: float, dt_s: float, hand_fed_m: float | None = None
    ) -> tuple[Floats, Floats]:
        """The next q and its velocity after one tick; zero rates ramp every motion to rest.

        Args:
            steer_rad_s: rate at which the tip is to turn to its right and down (2,), as the leading bend vector does.
            feed_m_s: wanted feed rate; negative retracts.
            dt_s: duration of the tick.
            hand_fed_m: the exposed length, for a robot that is fed by hand.
        """
        layout = self.configuration
        q = self.q.copy()
        by_hand = 0.0 if hand_fed_m is None else self._followed((hand_fed_m - float(q[FEED])) / dt_s, dt_s)
        fed = float(q[FEED]) + (by_hand or self._feed(feed_m_s, dt_s)) * dt_s
        q[FEED] = np.clip(fed, layout.low[FEED], layout.high[FEED])
        path, fitted, turning = self.path, self._fitted, self._turned(np.asarray(steer_rad_s, dtype=np.float64), dt_s)
        if turning.any():
            path, fitted = self._steered(turning * dt_s)
        path = path.extended(float(q[FEED]))
        if turning.any() or q[FEED] != self.q[FEED]:
            fitted = fitted.copy()
            fitted[FEED] = q[FEED]
            fitted = self.fit.joint(fitted, path).q
        aim = self._towards(fitted, dt_s)
        limits = self._backbone.bend_limits(q)
        for i in self._active:
            where = layout.bends[i]
            # Beside the fit's own motion, make up for what the limits kept back, as fast as it can be stopped again.
            lag = self._aim[where] - self.q[where]
            catch_up = braking_speed(float(np.hypot(*lag)), self._bend_acceleration[i], dt_s)
            rate = (aim - self._aim)[where] / dt_s + shortened(lag / dt_s, catch_up)
            missing = shortened(rate, self._bend_rate[i]) - self.velocity[where]
            velocity = self.velocity[where] + shortened(missing, self._bend_acceleration[i] * dt_s)
            # What slides into the port is straightened there; the rest of the rate is for the bend's own motion.
            straightened = shortened(q[where], float(limits[i]))
            end = shortened(q[where] + velocity * dt_s, float(limits[i]))
            q[where] = reached(straightened, end, self.q[where], self._bend_rate[i] * dt_s)
        self._proposed = Proposal(q, fitted, aim, turning, turning * dt_s)
        return q, (q - self.q) / dt_s

    def brake(self, dt_s: float, hand_fed_m: float | None = None) -> tuple[Floats, Floats]:
        """The next q and its velocity when nobody drives: every motion ramps to rest, whatever the fit still asks for.

        What lies off the path then stays there until somebody drives again.
        """
        layout, velocity = self.configuration, self.velocity
        q = self.q.copy()
        feed = float(velocity[FEED])
        change = math.copysign(min(abs(feed), float(layout.acceleration[FEED]) * dt_s), feed)
        fed = q[FEED] + (feed - change) * dt_s if hand_fed_m is None else hand_fed_m
        q[FEED] = np.clip(fed, layout.low[FEED], layout.high[FEED])
        limits = self._backbone.bend_limits(q)
        for i in self._active:
            where = layout.bends[i]
            slower = velocity[where] - shortened(velocity[where], self._bend_acceleration[i] * dt_s)
            straightened = shortened(q[where], float(limits[i]))
            end = shortened(q[where] + slower * dt_s, float(limits[i]))
            q[where] = reached(straightened, end, self.q[where], self._bend_rate[i] * dt_s)
        self._proposed = Proposal(q, q, q, np.zeros(2), np.zeros(2))
        return q, (q - self.q) / dt_s

    def take(self, q: Floats, velocity: Floats) -> None:
        """Make a proposed step, or the part of it that was allowed, the commanded one, and remember the path."""
        proposed, way = self._proposed, self._proposed.q - self.q
        squared = float(way @ way)  # of denormal steps this is zero, though they are not
        share = min(max(float((q - self.q) @ way) / squared, 0.0), 1.0) if squared > 0.0 else 1.0
        if proposed.turn_rad.any():
            self.path, _ = self._steered(share * proposed.turn_rad)
        self.path = self.path.extended(float(q[FEED]))
        self._fitted = self._fitted + share * (proposed.fitted - self._fitted)
        self._aim = self._aim + share * (proposed.aim - self._aim)
        self._turning = share * proposed.turning
        self.q, self.velocity = q, velocity
        self.deviation_m = float(self.fit.distances(q, self.path).max())
        self.deviation_max_m = max(self.deviation_max_m, self.deviation_m)

    def _turned(self, steer: Floats, dt_s: float) -> Floats:
        """The steering rate of this tick (2,): ramped, and able to stop where the path gets too sharp."""
        rate, acceleration = self._bend_rate[self.leading], self._bend_acceleration[self.leading]
        turning = self._turning + shortened(shortened(steer, rate) - self._turning, acceleration * dt_s)
        if not turning.any():
            return turning
        tip = float(self.q[FEED])
        leading_m = float(self._backbone.exposed_lengths(self.q)[self.leading :].sum())
        now = self.path.sharpness(tip - leading_m)
        if self._steered(turning * dt_s)[0].sharpness(tip - leading_m) <= now:
            return turning
        return shortened(turning, braking_speed((self._sharpest_1_m - now) * leading_m, acceleration, dt_s))

    def _steered(self, turn_rad: Floats) -> tuple[TipPath, Floats]:
        """The path bent by the leading section, without what lay ahead of the tip, and the shape bent as much."""
        path, where = self.path, self.configuration.bends[self.leading]
        fitted = self._fitted.copy()
        limit = float(self._backbone.bend_limits(fitted)[self.leading])
        fitted[where] = shortened(fitted[where] + turn_rad, limit)
        return self.fit.bent(self._fitted, fitted[where], self.leading, path), fitted

    def _towards(self, fitted: Floats, dt_s: float) -> Floats:
        """All bends moved towards the fit by one common share of the way, so that none is faster than it may be.

        Between two shapes the distance from the path falls evenly only if the bends, which make up for each other, keep
        step.
        """
        way = fitted - self._aim
        ticks = max(
            float(np.hypot(*way[self.configuration.bends[i]])) / (self._bend_rate[i] * dt_s) for i in self._active
        )
        return fitted if ticks <= 1.0 else self._aim + way / ticks

    def _feed(self, wanted: float, dt_s: float) -> float:
        """The feed rate of this tick: ramped, able to stop at its limits, and no faster than the bends can follow."""
        layout = self.configuration
        limit, acceleration, now = layout.rate[FEED], layout.acceleration[FEED], float(self.velocity[FEED])
        if limit == 0.0:
            return 0.0
        wanted = self._followed(float(np.clip(wanted, -self._retract_m_s, limit)), dt_s)
        high = braking_speed(layout.high[FEED] - self.q[FEED], acceleration, dt_s)
        low = -braking_speed(self.q[FEED] - layout.low[FEED], acceleration, dt_s)
        return float(np.clip(approached(now, wanted, acceleration * dt_s), low, high))

    def _followed(self, wanted: float, dt_s: float) -> float:
        """A feed rate, no faster than the bends can follow."""
        if not wanted:
            return 0.0
        layout, now = self.configuration, float(self.velocity[FEED])
        acceleration = layout.acceleration[FEED]
        stopping = now * now / (2.0 * acceleration) if acceleration else 0.0
        ahead = np.sign(wanted) * max(PREVIEW_M, stopping + abs(now) * dt_s)
        there = self._fitted.copy()
        there[FEED] = np.clip(there[FEED] + ahead, layout.low[FEED], layout.high[FEED])
        bends = self.fit.joint(there, self.path).q - self.q
        needed_s = max(float(np.hypot(*bends[layout.bends[i]])) / self._bend_rate[i] for i in self._active)
        fastest = FOLLOWING_SHARE * abs(ahead) / needed_s if needed_s > 0.0 else abs(wanted)
        return float(np.clip(wanted, -fastest, fastest))
