"""Kinematics compiled for the control loop: one configuration a call, about ten microseconds."""

from typing import NamedTuple

import numpy as np

from cobra.description import RobotDescription
from cobra.kinematics import kernels
from cobra.kinematics.configuration import Configuration, Floats
from cobra.kinematics.tendons import TendonMap


class Tick(NamedTuple):
    """What a control tick needs of the kinematics, in the port frame."""

    positions: Floats
    """(count, 3) evenly by arc length from the base of the active segment to the tip [m]."""
    rotations: Floats
    """(count, 3, 3)"""
    tip: Floats
    """(4, 4)"""
    jacobian: Floats
    """(6, size) as `Backbone.tip_jacobian`."""
    tendons: Floats
    """(tendons,) Δl [m] as `TendonMap.lengths`."""


class CompiledKinematics:
    """Backbone, tip Jacobian and tendon map of one robot in one call. Call `warm_up` at start, not while driving."""

    def __init__(self, description: RobotDescription, count: int = 61) -> None:
        configuration = Configuration(description)
        self.count = count
        self.rest = configuration.rest()
        self.layout = np.array(
            [
                (bend.start, -1 if at is None else at)
                for bend, at in zip(configuration.bends, configuration.lengths, strict=True)
            ],
            dtype=np.int64,
        )
        self.lengths_m = np.array([section.length_m for section in description.sections])
        self.active_length_m = description.active_length_m
        self.tendon_matrix = TendonMap(description).matrix.copy()

    def warm_up(self) -> None:
        """Compile (seconds the first time on a machine, then from the cache)."""
        self(self.rest)

    def __call__(self, q: Floats) -> Tick:
        """All of `Tick` at q (size,)."""
        # A copy: numba would compile anew, for seconds, for an array that is read-only or not contiguous.
        own = np.array(q, dtype=np.float64)
        return Tick(
            *kernels.tick(
                own, self.rest, self.layout, self.lengths_m, self.active_length_m, self.tendon_matrix, self.count
            )
        )
