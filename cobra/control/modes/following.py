"""Tip following: steer the leading section and feed; the body stays on the path of the tip, and retracts along it."""

import numpy as np
from numpy.typing import NDArray

from cobra.control.modes.stick_frame import bend_direction
from cobra.description import RobotDescription
from cobra.kinematics.backbone import Backbone
from cobra.kinematics.configuration import FEED
from cobra.kinematics.tip_following import TipFollowing
from cobra.messages import PATH_POINTS, Intent, ModeReport, PathReport

Floats = NDArray[np.float64]

SHOWN_EVERY = 10
"""Ticks between two tellings of the path."""


class FollowingMode:
    """The sticks on `TipFollowing`; see `Mode`."""

    def __init__(self, description: RobotDescription) -> None:
        self._following = TipFollowing(description)
        self._backbone = Backbone(description)
        leading = self._following.configuration.bends[self._following.leading].start
        self._steer_rad_s = float(self._following.configuration.rate[leading])
        self._feed_m_s = float(self._following.configuration.rate[FEED])
        self._shown: tuple[float, ...] = ()
        self._ticks = 0

    @property
    def q(self) -> Floats:
        return self._following.q

    @property
    def velocity(self) -> Floats:
        return self._following.velocity

    def warm_up(self) -> None:
        self._following.warm_up()

    def reset(self, q: Floats) -> None:
        self._following.reset(q)
        self._ticks = 0

    def propose(self, intent: Intent | None, dt_s: float, fed_m: float | None = None) -> tuple[Floats, Floats]:
        if intent is None:
            return self._following.brake(dt_s, fed_m)
        steer = self._steer(intent) * self._steer_rad_s * intent.speed
        feed = intent.feed * self._feed_m_s * intent.speed
        return self._following.propose(steer, feed, dt_s, fed_m)

    def take(self, q: Floats, velocity: Floats) -> None:
        self._following.take(q, velocity)
        self._ticks += 1

    def report(self) -> ModeReport:
        following = self._following
        if self._ticks % SHOWN_EVERY == 0 or not self._shown:
            self._shown = _thinned(following.path.points)
        path = PathReport(
            points=self._shown,
            length_m=following.path.length_m,
            deviation_m=following.deviation_m,
            deviation_max_m=following.deviation_max_m,
        )
        return ModeReport(path=path)

    def _steer(self, intent: Intent) -> Floats:
        stick = np.array(intent.primary)
        if not stick.any():
            return stick
        return bend_direction(self._backbone, self.q, intent.frame, self._following.leading, stick)


def _thinned(points: Floats) -> tuple[float, ...]:
    """Evenly chosen points with both ends, x, y, z after each other, to a tenth of a millimetre."""
    count = min(PATH_POINTS, len(points))
    chosen = points[np.linspace(0, len(points) - 1, count).round().astype(np.int64)]
    return tuple(np.round(chosen, 4).ravel().tolist())
