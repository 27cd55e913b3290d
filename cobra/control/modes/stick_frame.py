"""Sticks as the driver sees the robot: what is right and up on the screen is right and up on the stick.

The view is the fixed one from behind the port, that of the robot's base (which the twist turns), or the tip camera's.
"""

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cobra.kinematics.backbone import Backbone

Floats = NDArray[np.float64]
StickFrame = Literal["world", "base", "tip"]

LOOKING_BACK = 0.05
"""Below this a frame looks back along the view, where what is right of one is right of the other has no answer."""


def view_of(frame: StickFrame, ends: Floats) -> Floats:
    """The view's axes (3, 3) in the port frame: right, down, ahead. `ends` are `Backbone.section_ends` (n + 1, 4, 4)."""
    return np.eye(3) if frame == "world" else ends[0 if frame == "base" else -1, :3, :3]


def bend_direction(backbone: Backbone, q: Floats, frame: StickFrame, section: int, stick: Floats) -> Floats:
    """The stick (2,) in the frame of a section's base, where its bend vector stands.

    Of the rotation from the view to that frame only the part about the line of sight counts (its swing-twist
    decomposition): sections bend without turning about themselves, so that right stays right however far it is bent.
    """
    ends = backbone.section_ends(q)
    turn = view_of(frame, ends).T @ ends[section, :3, :3]
    sine, cosine = turn[1, 0] - turn[0, 1], turn[0, 0] + turn[1, 1]
    size = math.hypot(sine, cosine)
    if size < LOOKING_BACK:
        return stick
    c, s = cosine / size, sine / size
    return np.array([c * stick[0] + s * stick[1], c * stick[1] - s * stick[0]])
