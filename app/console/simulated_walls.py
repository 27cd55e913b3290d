"""What surrounds a simulated robot, in the 3D view: walls, where they press and how hard, and how far away they are.

This is the simulation's own knowledge, and the label says so: no sensor of the robot measures it.
"""

from typing import Final, Literal

import numpy as np
import viser

from app.console import appearance
from app.console.meshes import Floats, Indices, lathe, single
from cobra.description import RobotDescription
from cobra.messages import Touch, Walls

PLACES = 24
"""Contacts that are shown; of more, the strongest."""
LENGTH_PER_N = 5.0
"""Of a force's line, in radii of the body."""
LONGEST = 14.0
MARK = 0.32
"""Radius of a contact's mark, of the body's radius."""
NEAR = 4.0
"""Within so many radii of the body the clearance is told."""

_Side = Literal["front", "back"]
_COATS: Final[tuple[tuple[_Side, float], ...]] = (("back", appearance.WALL_FAR), ("front", appearance.WALL_NEAR))


class SimulatedWalls:
    """`start` draws the walls, `update` what touches. All places are sent as often as they change, in three messages."""

    def __init__(self, server: viser.ViserServer, description: RobotDescription, walls: Walls) -> None:
        self._server = server
        self._radius = description.backbone.diameter_m / 2
        self._walls = walls
        self._shown = False

    def start(self) -> None:
        """Draw the walls; nothing touches yet."""
        scene = self._server.scene
        vertices = np.frombuffer(self._walls.vertices, dtype="<f4").reshape(-1, 3)
        faces = np.frombuffer(self._walls.faces, dtype="<u4").reshape(-1, 3)
        clear, solid = np.split(faces, [self._walls.solid_from])
        scene.add_frame("/walls", show_axes=False)
        if len(solid):
            scene.add_mesh_simple("/walls/solid", *_used(vertices, solid), color=appearance.BLADE, side="double")
        # Two coats: a wall between the eye and the robot is a breath, the one behind it a surface.
        for side, opacity in _COATS:
            if len(clear):
                scene.add_mesh_simple(
                    f"/walls/clear {side}",
                    *_used(vertices, clear),
                    color=appearance.WALL,
                    opacity=opacity,
                    side=side,
                    cast_shadow=False,
                    receive_shadow=False,
                )
        away = np.zeros((PLACES, 3))
        mark = _ball(MARK * self._radius)
        self._marks = scene.add_batched_meshes_simple(
            "/walls/contacts",
            *mark,
            batched_wxyzs=np.tile([1.0, 0.0, 0.0, 0.0], (PLACES, 1)),
            batched_positions=away,
            batched_colors=appearance.linear(appearance.CONTACT),
            lod="off",
            cast_shadow=False,
            visible=False,
        )
        self._forces = scene.add_line_segments(
            "/walls/forces",
            np.zeros((PLACES, 2, 3)),
            np.tile(appearance.linear(np.array(appearance.CONTACT)), (PLACES, 2, 1)),
            thickness=0.22 * self._radius,
            visible=False,
        )
        self._shape: viser.LineSegmentsHandle | None = None
        self._label = scene.add_label("/walls/clearance", "", font_screen_scale=0.95, visible=False)

    def update(self, touch: Touch | None) -> None:
        """Show what touches, or that nothing does."""
        points = np.array(touch.contact_points if touch else (), dtype=float).reshape(-1, 3)
        forces = np.array(touch.contact_forces if touch else (), dtype=float).reshape(-1, 3)
        size = np.linalg.norm(forces, axis=1)
        strongest = np.argsort(-size)[:PLACES]
        points, forces, size = points[strongest], forces[strongest], size[strongest]
        touches = bool(len(points))
        with self._server.atomic():
            self._draw_shape(touch)
            if touches:
                # Always the same number: those that are not needed lie where the first one is.
                places = points[np.minimum(np.arange(PLACES), len(points) - 1)]
                length = self._radius * np.minimum(LENGTH_PER_N * size, LONGEST)
                starts = points - forces * (length / np.maximum(size, 1e-9))[:, None]
                starts = starts[np.minimum(np.arange(PLACES), len(points) - 1)]
                self._marks.batched_positions = single(places)
                self._forces.points = single(np.stack([starts, places], axis=1))
            if touches != self._shown:
                self._marks.visible = self._forces.visible = self._shown = touches
            self._tell(touch, float(np.linalg.norm(forces.sum(axis=0))) if touches else 0.0)

    def _draw_shape(self, touch: Touch | None) -> None:
        """The body's true axis: it comes out of the drawn robot where walls bend what the motors do not feel."""
        if touch is None or not touch.vertebrae:
            return
        axis = np.array((*touch.passive, *touch.vertebrae))
        axis[:, 2] = np.maximum(axis[:, 2], 0.0)
        points = single(np.stack([axis[:-1], axis[1:]], axis=1))
        if self._shape is not None and self._shape.points.shape == points.shape:
            self._shape.points = points
            return
        self._shape = self._server.scene.add_line_segments(
            "/walls/shape", points, appearance.linear(appearance.SIMULATED), thickness=0.35 * self._radius
        )

    def _tell(self, touch: Touch | None, pressed_N: float) -> None:
        near = touch is not None and touch.clearance_m < NEAR * self._radius and len(touch.clearance_points) == 2
        if touch is not None and near:
            self._label.position = np.array(touch.clearance_points[1])
            text = f"simulated: {1e3 * max(touch.clearance_m, 0.0):.1f} mm to the wall"
            if pressed_N >= 0.05:
                text = f"simulated: the walls press with {pressed_N:.1f} N"
            if text != self._label.text:
                self._label.text = text
        if self._label.visible != near:
            self._label.visible = near


def _used(vertices: Floats, faces: Indices) -> tuple[Floats, Indices]:
    """Only the vertices that these faces use, and the faces counted anew."""
    used, counted = np.unique(faces, return_inverse=True)
    return vertices[used], counted.reshape(-1, 3).astype(np.uint32)


def _ball(radius: float) -> tuple[Floats, Indices]:
    angle = np.linspace(0.0, np.pi, 9)
    return lathe(tuple((-radius * np.cos(a), radius * np.sin(a)) for a in angle), 16)
