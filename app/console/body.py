"""The robot's body as the 3D view draws it: rings, vertebrae and tendons at a configuration q.

All shapes come from one call of the kinematics; this file only says where on the body something is.
"""

from dataclasses import dataclass

import numpy as np

from app.console.detail import FULL, Detail
from app.console.meshes import Floats, Indices, quaternions, sweep, sweep_faces, unit_circle
from cobra.description import RobotDescription, Section
from cobra.kinematics.backbone import Backbone
from cobra.kinematics.configuration import FEED

CAP_LENGTH = 1.0 / 32.0
"""Of the rounded tip, in sections."""
TENDON_WIDTH = 2.0
"""Tendons are drawn this much thicker than they are: 0.36 mm is less than a pixel."""
VERTEBRA_FILL = 0.38
"""Share of the pitch that a drawn vertebra takes, less than it really does, so that the tendons can be seen."""
COLLAR_FILL = 0.6
HEAD_LENGTH = 2.2
"""In radii of the body."""


@dataclass(frozen=True, slots=True)
class Pose:
    """Everything that moves with the measured configuration, in the frame of the entry port."""

    tube: Floats
    """(rings · sides, 3) vertices of the backbone's tube [m]."""
    vertebrae: Floats
    """(vertebrae, 3) centres, base first, then the collar that ends each section; the last one is the head [m]."""
    vertebrae_wxyz: Floats
    """(vertebrae, 4)"""
    tendons: Floats
    """(segments, 2, 3) ends of all segments of all tendons [m]."""
    tip_position: Floats
    """(3,) [m]"""
    tip_rotation: Floats
    """(3, 3): the tip camera's frame, x right, y down, z ahead."""


class Body:
    """What is drawn of one robot, and where it is at q."""

    def __init__(self, description: RobotDescription, hidden_length_m: float, detail: Detail = FULL) -> None:
        """`hidden_length_m`: how much of the body is drawn behind the entry port."""
        self._detail = detail
        self.description = description
        self.backbone = Backbone(description)
        self.hidden_length_m = hidden_length_m
        self.radius_m = description.backbone.diameter_m / 2.0
        self.tendon_width_m = TENDON_WIDTH * description.tendon.diameter_m if description.tendon else 0.0
        routed = [section.routing.radius_m for section in description.sections if section.routing]
        # The tendons lie on the drawn tube, at the radius at which they run.
        self.tube_radius_m = min([self.radius_m, *(radius - 0.5 * self.tendon_width_m for radius in routed)])
        self.sections = len(description.sections)
        self._rings = np.linspace(0.0, self.sections, self.sections * detail.rings + 1)
        last = description.sections[-1]
        self._head_length_m = min(HEAD_LENGTH * self.radius_m, 0.5 * last.length_m, last.length_m / last.vertebrae)
        self._vertebrae = self._vertebra_places()
        # A full-width sleeve behind the active segment, a doubled ring for its crisp edge, and a rounded cap at the tip.
        rounding = np.linspace(0.0, np.pi / 2.0, detail.cap_rings)
        self._cap = CAP_LENGTH * (1.0 - np.sin(rounding))
        self._radii = np.concatenate(
            [
                [self.radius_m, self.radius_m, self.radius_m, self.tube_radius_m],
                np.full(len(self._rings) - 1, self.tube_radius_m),
                self.tube_radius_m * np.cos(rounding),
            ]
        )
        self._circle = unit_circle(detail.sides)
        self._segment_rings, self._offsets, self.segment_tendon = self._tendon_segments()
        self._segment_places = (self._segment_rings[:, 0] + 0.5) / detail.rings
        """(segments,) in sections from the base."""

    @property
    def tube_faces(self) -> Indices:
        """Triangles of `Pose.tube` and of `tube`."""
        return sweep_faces(len(self._radii), self._detail.sides)

    @property
    def vertebra_sizes(self) -> Floats:
        """(vertebrae, 3): radius across, twice, and length along each vertebra and collar [m]."""
        pitch = np.array([section.length_m / section.vertebrae for section in self.description.sections])
        vertebrae = np.repeat(VERTEBRA_FILL * pitch, [self._drawn(section) for section in self.description.sections])
        radius = np.concatenate([np.full(len(vertebrae), self.radius_m), np.full(self.sections, 1.04 * self.radius_m)])
        collars = np.concatenate([COLLAR_FILL * pitch[:-1], [self._head_length_m]])
        return np.stack([radius, radius, np.concatenate([vertebrae, collars])], axis=1)

    def pose(self, q: Floats) -> Pose:
        """The body at q (size,)."""
        tube, rings, vertebrae = self._arc_lengths(q)
        shape = self.backbone.poses_at(q, np.concatenate([tube, rings, vertebrae, [self.backbone.length(q)]]))
        on_tube, on_rings, rest = np.split(np.arange(len(shape.positions)), np.cumsum([len(tube), len(rings)]))
        ends = on_rings[self._segment_rings]
        return Pose(
            tube=sweep(shape.positions[on_tube], shape.rotations[on_tube], self._radii, self._circle),
            vertebrae=shape.positions[rest[:-1]],
            vertebrae_wxyz=quaternions(shape.rotations[rest[:-1]]),
            tendons=shape.positions[ends] + np.einsum("snij,sj->sni", shape.rotations[ends], self._offsets),
            tip_position=shape.positions[rest[-1]],
            tip_rotation=shape.rotations[rest[-1]],
        )

    def tube(self, q: Floats, scale: float) -> Floats:
        """Vertices (rings · sides, 3) of the tube alone, with all radii scaled: the ghost of the commanded shape."""
        shape = self.backbone.poses_at(q, self._arc_lengths(q)[0])
        return sweep(shape.positions, shape.rotations, scale * self._radii, self._circle)

    def tensions_along(self, profile: Floats) -> Floats:
        """Tension of each segment (segments,) [N], of profiles (m, n + 1) [N] at the port and the end of each section."""
        section = self._segment_places.astype(np.int64)
        share = self._segment_places - section
        before, after = profile[self.segment_tendon, section], profile[self.segment_tendon, section + 1]
        out: Floats = before + share * (after - before)
        return out

    def _arc_lengths(self, q: Floats) -> tuple[Floats, Floats, Floats]:
        """Arc lengths of the tube's rings, of those between which the tendons run, and of the vertebrae [m].

        What would lie further back than is drawn is gathered at the back end, out of sight.
        """
        ends = np.concatenate([[0.0], np.cumsum(self.backbone.configuration.section_lengths(q))])
        back = self.backbone.active_length_m - q[FEED] - self.hidden_length_m
        places = np.arange(self.sections + 1)
        rings = np.interp(self._rings, places, ends)
        cap = np.interp(self.sections - self._cap, places, ends)
        tube = np.concatenate([[min(back, 0.0), 0.0, 0.0, 0.0], rings[:-1], cap])
        vertebrae = np.interp(self._vertebrae, places, ends)
        return np.maximum(tube, back), np.maximum(rings, back), np.maximum(vertebrae, back)

    def _drawn(self, section: Section) -> int:
        """How many vertebrae of a section are drawn."""
        return section.vertebrae if self._detail.vertebrae else 0

    def _vertebra_places(self) -> Floats:
        """Places of the vertebrae and then of the collars, in sections from the base."""
        # Guiders stand at the ends of their chambers; other vertebrae are drawn in the middle of their pitch.
        middles = [
            i + (np.arange(self._drawn(s)) + (1.0 if s.elongation else 0.5)) / s.vertebrae
            for i, s in enumerate(self.description.sections)
        ]
        head = self.sections - 0.5 * self._head_length_m / self.description.sections[-1].length_m
        return np.concatenate([*middles, np.arange(1.0, self.sections), [head]])

    def _tendon_segments(self) -> tuple[Indices, Floats, Indices]:
        """For each segment its two rings (segments, 2), its offset in their frames (segments, 3), and its tendon."""
        rings, offsets, tendons = [], [], []
        tendon = 0
        for i, section in enumerate(self.description.sections):
            if section.routing is None:
                continue
            starts = np.arange((i + 1) * self._detail.rings)
            for azimuth in np.radians(section.routing.azimuths_deg):
                rings.append(np.stack([starts, starts + 1], axis=1))
                offset = section.routing.radius_m * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
                offsets.append(np.tile(offset, (len(starts), 1)))
                tendons.append(np.full(len(starts), tendon))
                tendon += 1
        if not rings:
            return np.zeros((0, 2), np.uint32), np.zeros((0, 3)), np.zeros(0, np.uint32)
        return (
            np.concatenate(rings).astype(np.uint32),
            np.concatenate(offsets),
            np.concatenate(tendons).astype(np.uint32),
        )
