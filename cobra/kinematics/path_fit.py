"""Laying the backbone on a path: all bends together (default), or section after section (the baseline)."""

from typing import NamedTuple

import numpy as np

from cobra.description import RobotDescription
from cobra.kinematics import kernels
from cobra.kinematics.backbone import Backbone
from cobra.kinematics.configuration import FEED, Configuration, Floats
from cobra.kinematics.tip_path import SPACING_M, TipPath

POINTS = 24
"""Places along the exposed body at which the distance from the path counts: 8 a section for COBRA."""
ITERATIONS = 3
"""Gauss-Newton steps a fit; from the last tick's solution one or two suffice."""


class Fit(NamedTuple):
    """A shape laid on a path."""

    q: Floats
    """(size,)"""
    distances_m: Floats
    """(POINTS,) from the path, evenly along the exposed body, the last at the tip."""
    iterations: int


class PathFit:
    """Fits for one robot. Twist, feed, lengths and passive sections are taken from q; every bend keeps its limit."""

    def __init__(self, description: RobotDescription) -> None:
        configuration = self._configuration = Configuration(description)
        self._backbone = Backbone(description)
        self._rest = configuration.rest()
        self._layout = np.array(
            [
                (bend.start, -1 if at is None else at)
                for bend, at in zip(configuration.bends, configuration.lengths, strict=True)
            ],
            dtype=np.int64,
        )
        self._free = np.array([section.active for section in description.sections])
        self._lengths_m = np.array([section.length_m for section in description.sections])
        self._active_length_m = description.active_length_m
        self._max_curvature = self._backbone.max_curvature_1_m.copy()

    def warm_up(self) -> None:
        """Compile now, and not while driving."""
        path = TipPath(np.linspace([0.0, 0.0, 0.0], [0.0, 0.0, SPACING_M], 2))
        self.joint(self._rest, path)
        self.sequential(self._rest, path)
        self.distances(self._rest, path)
        self.bent(self._rest, np.zeros(2), 0, path.extended(float(self._rest[FEED])))

    def joint(self, q: Floats, path: TipPath, iterations: int = ITERATIONS) -> Fit:
        """All bends at once: the least Σ w |cross-track|² along the exposed body, from the bends in q (MODEL 5).

        The tip weighs as much as all POINTS together: it stays where it leads, at next to no cost for the body. This
        finds the optimum next to q; far from any path, begin with `sequential`.
        """
        return Fit(
            *kernels.fit_path(
                _own(q),
                self._layout,
                self._free,
                self._lengths_m,
                self._active_length_m,
                self._max_curvature,
                path.points,
                SPACING_M,
                POINTS,
                iterations,
            )
        )

    def sequential(self, q: Floats, path: TipPath) -> Floats:
        """Base to tip, each section's end put on the path by one arc: q (size,). The baseline to beat."""
        return kernels.sequential_fit(
            _own(q),
            self._layout,
            self._free,
            self._lengths_m,
            self._active_length_m,
            self._max_curvature,
            path.points,
            SPACING_M,
        )

    def distances(self, q: Floats, path: TipPath, count: int = POINTS) -> Floats:
        """Distance of the exposed body from the path (count,) [m], evenly along it, the last at the tip."""
        return kernels.distances_to_path(
            _own(q), self._layout, self._lengths_m, self._active_length_m, path.points, SPACING_M, count
        )

    def bent(self, q: Floats, bends: Floats, section: int, path: TipPath) -> TipPath:
        """The path up to the tip of q after one section is bent to `bends` (2,): it moves as the body that lies on it."""
        layout, robot = self._layout, (self._layout, self._lengths_m, self._active_length_m)
        before, after = _own(q), _own(q)
        after[layout[section, 0] : layout[section, 0] + 2] = bends
        tip, length = float(q[FEED]), float(self._configuration.section_lengths(q).sum())
        first = path.samples(tip - float(self._backbone.exposed_lengths(q)[section:].sum()))
        s = np.arange(first, path.samples(tip), dtype=np.float64) * SPACING_M + length - tip
        points = path.cut(tip).points
        points[first : first + len(s)] += kernels.positions_at(after, *robot, s) - kernels.positions_at(
            before, *robot, s
        )
        return TipPath(points)


def _own(q: Floats) -> Floats:
    """A copy: numba would compile anew, for seconds, for an array that is read-only or not contiguous."""
    return np.array(q, dtype=np.float64)
