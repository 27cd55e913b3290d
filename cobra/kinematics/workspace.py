"""Where the tip can go: a cloud of places, from the entries of q that may vary and their limits."""

from collections.abc import Sequence

import numpy as np

from cobra.description import RobotDescription
from cobra.kinematics.backbone import Backbone
from cobra.kinematics.configuration import Configuration, Floats

SEED = 1
"""Always the same cloud for the same robot and shape, so that it does not flicker."""


def reachable_tips(
    description: RobotDescription, q: Floats, sections: Sequence[int], entries: Sequence[int], count: int
) -> Floats:
    """Places of the tip (count, 3) [m] in the port frame, from random shapes inside every limit.

    Args:
        description: the robot.
        q: what does not vary (size,).
        sections: indices of the sections whose bends vary, evenly over the disc that is allowed at that feed.
        entries: further entries of q (twist, feed, lengths) that vary, evenly over their range.
        count: how many.
    """
    layout, backbone = Configuration(description), Backbone(description)
    rng = np.random.default_rng(SEED)
    shapes = np.tile(q, (count, 1))
    for index in entries:
        shapes[:, index] = rng.uniform(layout.low[index], layout.high[index], count)
    limits = backbone.bend_limits(shapes)
    for section in sections:
        angle, share = rng.uniform(0.0, 2.0 * np.pi, count), np.sqrt(rng.uniform(0.0, 1.0, count))
        size = limits[:, section] * share
        shapes[:, layout.bends[section]] = size[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return backbone.tip(shapes)[:, :3, 3]
