"""The whole backbone: base frame with twist and feed, sections bent over their exposed lengths, tip and its Jacobian.

Port frame: origin in the middle of the entry port, +z into the workspace, +x right, +y down. What is behind the port
(z < 0) is straight; b_i is the bend that section i makes over the length it has outside.

This is the plain reference in NumPy; `compiled.py` has the same for the control loop.
"""

from typing import NamedTuple

import numpy as np

from cobra.description import RobotDescription
from cobra.kinematics import section
from cobra.kinematics.configuration import FEED, TWIST, Configuration, Floats

EXPOSURE_TOLERANCE_M = 1e-9
"""A section is taken as wholly outside or inside when it is nearer to that: 0.3 m and 3 × 0.1 m differ by rounding."""


class Shape(NamedTuple):
    """Poses along a backbone in the port frame."""

    positions: Floats
    """(count, 3) [m]."""
    rotations: Floats
    """(count, 3, 3); the third column is the tangent."""


class Backbone:
    """Forward kinematics of one robot (C-1 … C-3, MODEL 2)."""

    def __init__(self, description: RobotDescription) -> None:
        self.configuration = Configuration(description)
        self.active_length_m = description.active_length_m
        self.max_curvature_1_m = np.array([s.max_curvature_1_m for s in description.sections])

    def exposed_lengths(self, q: Floats) -> Floats:
        """ℓ_e: length of each section beyond the port (..., n) [m] at q (..., size)."""
        lengths = self.configuration.section_lengths(q)
        starts = np.cumsum(lengths, axis=-1) - lengths
        inside = (self.active_length_m - q[..., FEED])[..., None] - starts
        inside = np.where(inside < EXPOSURE_TOLERANCE_M, 0.0, inside)
        exposed = lengths - inside
        return np.where(exposed < EXPOSURE_TOLERANCE_M, 0.0, exposed)

    def bend_limits(self, q: Floats) -> Floats:
        """Largest |b_i| = κ_max,i ℓ_e,i of each section (..., n) [rad]: 0 while it is inside."""
        return self.max_curvature_1_m * self.exposed_lengths(q)

    def base(self, q: Floats) -> Floats:
        """Base of the active segment, Rz(φ₀) Trans(0, 0, ℓ₀ − L_active): (..., 4, 4)."""
        cos, sin = np.cos(q[..., TWIST]), np.sin(q[..., TWIST])
        out = np.zeros((*q.shape[:-1], 4, 4))
        out[..., 0, 0], out[..., 0, 1] = cos, -sin
        out[..., 1, 0], out[..., 1, 1] = sin, cos
        out[..., 2, 2] = out[..., 3, 3] = 1.0
        out[..., 2, 3] = q[..., FEED] - self.active_length_m
        return out

    def section_ends(self, q: Floats) -> Floats:
        """The base and the end of each section, base first: (..., n + 1, 4, 4)."""
        lengths, exposed, bends = self._sections(q)
        steps = section.transform(bends, exposed)
        steps[..., 2, 3] += lengths - exposed
        poses = [self.base(q)]
        for i in range(lengths.shape[-1]):
            poses.append(poses[-1] @ steps[..., i, :, :])
        return np.stack(poses, axis=-3)

    def tip(self, q: Floats) -> Floats:
        """Pose of the tip, which is also the tip camera's frame: (..., 4, 4)."""
        return self.section_ends(q)[..., -1, :, :]

    def length(self, q: Floats) -> float:
        """Length of the active segment from its base to the tip [m]."""
        return float(self.configuration.section_lengths(q).sum())

    def points(self, q: Floats, count: int = 61) -> Shape:
        """`count` poses, evenly by arc length from the base of the active segment to the tip."""
        return self.poses_at(q, np.linspace(0.0, self.length(q), count))

    def poses_at(self, q: Floats, arc_lengths_m: Floats) -> Shape:
        """Poses at arc lengths from the base of the active segment [m].

        Negative ones lie on the passive body behind it, those beyond the tip on its tangent.
        """
        s = np.asarray(arc_lengths_m, dtype=float)
        lengths, exposed, bends = self._sections(q)
        ends = self.section_ends(q)
        starts = np.cumsum(lengths) - lengths
        index = np.clip(np.searchsorted(starts, s, side="right") - 1, 0, len(lengths) - 1)
        along = s - starts[index]
        inside = (lengths - exposed)[index]
        arc = np.clip(along - inside, 0.0, exposed[index])
        straight = np.minimum(along, inside)
        beyond = np.maximum(along - lengths[index], 0.0)
        share = np.divide(arc, exposed[index], out=np.zeros_like(arc), where=exposed[index] > 0.0)
        bend = share[:, None] * bends[index]
        local = section.translation(bend, arc)
        local[:, 2] += straight
        turned = section.rotation(bend)
        local += turned[:, :, 2] * beyond[:, None]
        start_rotations = ends[index, :3, :3]
        positions = ends[index, :3, 3] + np.einsum("nij,nj->ni", start_rotations, local)
        return Shape(positions, start_rotations @ turned)

    def tip_jacobian(self, q: Floats) -> Floats:
        """Tip velocity per rate of q in the port frame: (6, size), linear [m] above angular [rad].

        The feed's column goes through the exposed length: while the port is within section i, the inside stays where it
        is and the arc grows, ∂t_i/∂ℓ. There is a kink where a section enters; exactly there the value is that for
        feeding in, whose direction is the port's axis.
        """
        lengths, exposed, bends = self._sections(q)
        ends = self.section_ends(q)
        tip = ends[-1, :3, 3]
        out = np.zeros((6, self.configuration.size))
        out[:3, TWIST] = -tip[1], tip[0], 0.0
        out[5, TWIST] = 1.0
        out[2, FEED] = 1.0
        local = section.jacobian(bends, exposed)
        frames = ends[:-1, :3, :3]
        turned = frames @ local.rotation
        moved = frames @ local.translation
        moved[:, :, :2] += np.cross(turned, (tip - ends[1:, :3, 3])[:, :, None], axis=1)
        entering = None
        for i, bend in enumerate(self.configuration.bends):
            if exposed[i] > 0.0:
                out[:3, bend] = moved[i, :, :2]
                out[3:, bend] = turned[i]
            along = moved[i, :, 2]
            if 0.0 < exposed[i] < lengths[i]:
                entering = i
                out[:3, FEED] = along
            index = self.configuration.lengths[i]
            if index is not None:
                out[:3, index] = along
        if entering is not None:
            # A section that grows inside pushes the one in the port out.
            for index in self.configuration.lengths[:entering]:
                if index is not None:
                    out[:3, index] = out[:3, FEED]
        return out

    def _sections(self, q: Floats) -> tuple[Floats, Floats, Floats]:
        """Lengths (..., n), exposed lengths (..., n), and bends (..., n, 2) with none inside the introducer."""
        lengths = self.configuration.section_lengths(q)
        exposed = self.exposed_lengths(q)
        bends = np.stack([q[..., bend] for bend in self.configuration.bends], axis=-2)
        return lengths, exposed, np.where(exposed[..., None] > 0.0, bends, 0.0)


def in_tip_frame(tip: Floats, jacobian: Floats) -> Floats:
    """A Jacobian or a twist (6, …) of the port frame, expressed in the tip camera's frame (4, 4)."""
    turn = tip[:3, :3].T
    return np.concatenate([turn @ jacobian[:3], turn @ jacobian[3:]])
