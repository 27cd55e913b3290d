"""The exposed length of a robot that somebody feeds by hand: told as a number, or by a measuring device.

What slides into the port must be straight, so a new length may ask the tendons to move. It is therefore taken in
slowly, and only while the driver holds the dead-man; from one told to the one in use the operator sees both.
"""

import math
from typing import Literal

from cobra.control.modes.joint_rates import unbending_feed
from cobra.description import RobotDescription
from cobra.kinematics.ramps import approached, braking_speed
from cobra.messages import HandFeedReport

FASTEST_M_S = 0.03
"""A hand may be faster; the bends that the port straightens are not."""
RAMP_S = 0.25
MEASURED_FOR_S = 1.0
"""A measuring device that was silent for longer is not believed any more; the last length stays in use."""


class HandFeed:
    """Where the exposed length is on its way from what was used to what was told."""

    def __init__(self, description: RobotDescription) -> None:
        self.offered = description.hand_fed
        self._most_m = description.backbone.total_length_m
        self._rate = min(FASTEST_M_S, unbending_feed(description))
        self._acceleration = self._rate / RAMP_S
        self._told_m: float | None = None
        self._speed = 0.0
        self._measured_s = -math.inf

    def tell(self, length_m: float) -> str:
        """Take a length told by a person; returns why it is refused, or an empty string."""
        if refusal := self._refusal(length_m):
            return refusal
        self._told_m, self._measured_s = length_m, -math.inf
        return ""

    def measured(self, length_m: float, now_s: float) -> str:
        """Take a length from a measuring device; returns why it is refused, or an empty string."""
        if refusal := self._refusal(length_m):
            return refusal
        self._told_m, self._measured_s = length_m, now_s
        return ""

    def begin(self, used_m: float) -> float:
        """At rest, with nothing held: the length to begin with is the one told last."""
        self._speed = 0.0
        return used_m if self._told_m is None else self._told_m

    def next(self, used_m: float, moving: bool, dt_s: float) -> float | None:
        """The length to use in the next tick, or None for a robot with a drive for it."""
        if not self.offered:
            return None
        way = (self._told_m - used_m) if self._told_m is not None and moving else 0.0
        most = braking_speed(abs(way), self._acceleration, dt_s)
        wanted = math.copysign(min(most, self._rate), way) if way else 0.0
        self._speed = approached(self._speed, wanted, self._acceleration * dt_s)
        if way and self._speed * way > 0.0:
            self._speed = math.copysign(min(abs(self._speed), most), way)
        return min(max(used_m + self._speed * dt_s, 0.0), self._most_m)

    def report(self, used_m: float, now_s: float) -> HandFeedReport | None:
        if not self.offered:
            return None
        told = used_m if self._told_m is None else self._told_m
        age = now_s - self._measured_s
        source: Literal["number", "measured", "silent"] = (
            "number" if math.isinf(age) else "measured" if age <= MEASURED_FOR_S else "silent"
        )
        return HandFeedReport(told_m=told, used_m=used_m, source=source)

    def _refusal(self, length_m: float) -> str:
        if not self.offered:
            return "this robot is not fed by hand (hand_fed in its description): nobody tells it its length"
        if not math.isfinite(length_m) or not 0.0 <= length_m <= self._most_m:
            return f"{length_m * 1e3:.0f} mm: the exposed length must lie between 0 and {self._most_m * 1e3:.0f} mm"
        return ""
