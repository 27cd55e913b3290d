"""The path of the tip, remembered by arc length from the entry port."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from cobra.kinematics.backbone import Backbone
from cobra.kinematics.configuration import FEED, Floats

SPACING_M = 0.001
"""Between samples: a chord is within 2 µm of an arc at 15/m."""
WINDOW_M = 0.01
"""Over which the path's curvature is measured."""


@dataclass(frozen=True, eq=False)
class TipPath:
    """Where the tip has passed: a polyline from the port on, straight along the axis before it and after its end."""

    points: Floats
    """(count ≥ 2, 3) in the port frame, `SPACING_M` apart; the first is the port [m]."""

    @property
    def length_m(self) -> float:
        return (len(self.points) - 1) * SPACING_M

    @classmethod
    def along(cls, backbone: Backbone, q: Floats) -> Self:
        """The path on which the whole exposed body lies now: from the port along the backbone to the tip."""
        tip = float(q[FEED])
        s = np.arange(cls.samples(tip), dtype=np.float64) * SPACING_M
        return cls(_continued(backbone.poses_at(q, s + backbone.length(q) - tip).positions, 2))

    def extended(self, length_m: float) -> Self:
        """The path, lengthened straight on so that it reaches `length_m`."""
        count = int(np.ceil(length_m / SPACING_M - 1e-9)) + 1
        return self if count <= len(self.points) else type(self)(_continued(self.points, count))

    def cut(self, length_m: float) -> Self:
        """The path without what lies beyond `length_m`."""
        return type(self)(_continued(self.points[: self.samples(length_m)].copy(), 2))

    def sharpness(self, from_m: float) -> float:
        """Largest curvature beyond an arc length [1/m], over `WINDOW_M`."""
        width = round(WINDOW_M / SPACING_M)
        tangents = np.diff(self.points[max(self.samples(from_m) - width, 0) :], axis=0)
        if len(tangents) <= width:
            return 0.0
        sines = np.linalg.norm(np.cross(tangents[:-width], tangents[width:]), axis=1) / SPACING_M**2
        return float(np.arcsin(np.minimum(sines.max(), 1.0))) / WINDOW_M

    @staticmethod
    def samples(length_m: float) -> int:
        """How many samples a path of this length has, with the one at the port."""
        return max(int(np.floor(length_m / SPACING_M + 1e-9)) + 1, 1)


def _continued(points: Floats, count: int) -> Floats:
    """At least `count` points, going straight on (from one point: along the port's axis)."""
    missing = count - len(points)
    if missing <= 0:
        return points
    step = points[-1] - points[-2] if len(points) > 1 else np.array([0.0, 0.0, 1.0])
    steps = np.arange(1, missing + 1)[:, None] * (SPACING_M / np.linalg.norm(step)) * step
    return np.concatenate([points, points[-1] + steps])
