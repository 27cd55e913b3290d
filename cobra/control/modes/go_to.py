"""Hold-to-run towards a shape: straighten the robot, or go to a saved pose. The sticks do nothing here."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cobra.control.modes.joint_rates import JointRates
from cobra.description import RobotDescription
from cobra.kinematics.configuration import FEED, TWIST, Configuration
from cobra.kinematics.ramps import braking_speed
from cobra.messages import Intent, ModeReport

Floats = NDArray[np.float64]
Target = Callable[[str, Floats], Floats | None]
"""(name of the pose, q now) → where to go (size,), or None when there is no such pose."""

THERE_RAD, THERE_M = 1e-4, 1e-5
"""Nearer is there."""


class GoToMode:
    """Moves every entry of q on a straight line to the target, all arriving together; see `Mode`."""

    def __init__(self, description: RobotDescription, target: Target, unknown: str) -> None:
        """`unknown` says what to do when there is nothing to go to."""
        self._rates = JointRates(description)
        self._layout = self._rates.configuration
        self._target = target
        self._unknown = unknown
        self._name = ""
        self.q: Floats = self._layout.rest()
        self.velocity: Floats = np.zeros_like(self.q)

    def warm_up(self) -> None:
        """Nothing here is compiled."""

    def aim(self, name: str) -> None:
        """Choose the pose to go to."""
        self._name = name

    def reset(self, q: Floats) -> None:
        self.q, self.velocity = self._rates.inside(q), np.zeros_like(q)

    def propose(self, intent: Intent | None, dt_s: float, fed_m: float | None = None) -> tuple[Floats, Floats]:
        target = self._goal()
        wanted = np.zeros_like(self.q)
        if intent is not None and target is not None:
            wanted = self._wanted(target - self.q, intent.speed, dt_s)
        q = self._rates.step(self.q, self.velocity, wanted, dt_s, fed_m)
        return q, (q - self.q) / dt_s

    def take(self, q: Floats, velocity: Floats) -> None:
        self.q, self.velocity = q, velocity

    def report(self) -> ModeReport:
        target = self._goal()
        if target is None:
            return ModeReport(words=(self._unknown,))
        return ModeReport(words=(to_go(self._layout, target - self.q),), target=tuple(target.tolist()))

    def _goal(self) -> Floats | None:
        """The target inside the limits; what no drive moves stays as it is."""
        target = self._target(self._name, self.q)
        if target is None:
            return None
        return self._rates.inside(np.where(self._layout.rate > 0.0, target, self.q))

    def _wanted(self, way: Floats, speed: float, dt_s: float) -> Floats:
        """Rates (size,) along the way: so fast that the slowest entry goes at its rate, and all can stop at the end."""
        sizes = np.abs(way)
        for bend in self._layout.bends:
            sizes[bend] = math.hypot(*way[bend])
        moves = (sizes > 1e-12) & (self._rates.rate > 0.0)
        if not moves.any():
            return np.zeros_like(way)
        per_second = speed * float(np.min(self._rates.rate[moves] / sizes[moves]))
        for i in np.flatnonzero(moves):
            braking = braking_speed(float(sizes[i]), float(self._layout.acceleration[i]), dt_s)
            per_second = min(per_second, braking / float(sizes[i]))
        return np.where(moves, way * per_second, 0.0)


def straight(description: RobotDescription) -> Target:
    """All sections straight; twist, feed and lengths stay."""
    layout = Configuration(description)

    def target(name: str, q: Floats) -> Floats:
        out = q.copy()
        for i in description.active_sections:
            out[layout.bends[i]] = 0.0
        return out

    return target


def to_go(layout: Configuration, way: Floats) -> str:
    """What is left of the way, in words."""
    bend = max((math.hypot(*way[where]) for where in layout.bends), default=0.0)
    metres = [abs(way[i]) for i in (FEED, *(i for i in layout.lengths if i is not None))]
    parts = []
    if bend > THERE_RAD:
        parts.append(f"{math.degrees(bend):.0f}° of bend")
    if abs(way[TWIST]) > THERE_RAD:
        parts.append(f"{math.degrees(abs(way[TWIST])):.0f}° of twist")
    if max(metres) > THERE_M:
        parts.append(f"{max(metres) * 1e3:.0f} mm")
    return f"to go: {', '.join(parts)}" if parts else "it is there"
