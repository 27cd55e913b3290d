"""What a robot's MuJoCo model is made of: elastic joints, intervals between vertebrae, and the numbers all of it goes by."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cobra.description import RobotDescription

Kind = Literal["default", "ideal"]
Action = Literal["bend_x", "bend_y", "torsion", "slide"]
Indices = NDArray[np.intp]

STEP_S = 0.002
"""Longest integration step."""
STEP_DAMPING_S = 0.004
"""Damping per stiffness of every spring. As the damping is implicit, half a step is stable at any stiffness; four times
that keeps tendons that go slack and taut from chattering."""
SETTLING_S = 0.1
"""Further damping per bending stiffness, so that the body settles and does not swing: friction in joints and holes."""
YIELD_RATIO = 2.5
"""A tendon yields at this multiple of its maximum tension: no command makes forces that no drive can hold."""
HAND = "hand"
"""The actuator in place of a feed drive, where somebody feeds the robot."""
PASSIVE = -1
"""In place of a section's index for what belongs to the passive body."""


@dataclass(frozen=True, slots=True)
class Spring:
    """An elastic joint: what it does, in which section, and the stretch of backbone whose elasticity it carries."""

    name: str
    does: Action
    section: int
    start_m: float
    end_m: float
    stiffness: float
    """Of the whole stretch [N·m/rad or N/m]."""


@dataclass(frozen=True, slots=True)
class Interval:
    """From one vertebra's centre to the next; the gap is what lies between their faces. Arc lengths from the base [m]."""

    section: int
    start_m: float
    end_m: float
    gap: tuple[float, float]

    def along_gap(self, fraction: float) -> float:
        return self.gap[0] + fraction * (self.gap[1] - self.gap[0])


def intervals(description: RobotDescription) -> Iterator[Interval]:
    """The intervals between the vertebrae, base first; the base itself is a plate like the first section's vertebrae."""
    start, face = 0.0, description.sections[0].vertebra_thickness_m / 2
    for i, section in enumerate(description.sections):
        base, pitch, half = start, section.length_m / section.vertebrae, section.vertebra_thickness_m / 2
        for k in range(1, section.vertebrae + 1):
            end = base + k * pitch
            yield Interval(i, start, end, (start + face, end - half))
            start, face = end, half


def piece_name(tendon: str, section: int) -> str:
    """Of the piece of a tendon within a section, and of what pulls it."""
    return f"{tendon} in {section}"
