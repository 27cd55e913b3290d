"""What the mode of motion adds to the 3D view: the path that the body follows, the shape it goes to, and its reach."""

import numpy as np
import viser

from app.console import appearance
from app.console.body import Body
from app.console.meshes import Floats, single
from cobra.description import RobotDescription
from cobra.kinematics.configuration import FEED, TWIST, Configuration
from cobra.kinematics.workspace import reachable_tips
from cobra.messages import PATH_POINTS, RobotState

PATH, TARGET, WORKSPACE = "/path", "/target", "/workspace"
CLOUD = 4000
"""Points of the workspace."""
STEPS = np.array([0.02, 0.005, 0.05])
"""The cloud is made anew when twist [rad], feed [m] or a bend [rad] has changed by so much."""


class MotionView:
    """Drawn beside the robot in one viser server. `start()` builds it, `update()` draws a state."""

    def __init__(self, server: viser.ViserServer, description: RobotDescription, body: Body) -> None:
        self._server = server
        self._description = description
        self._body = body
        self._path: tuple[float, ...] = ()
        self._target: tuple[float, ...] = ()
        self._reach: tuple[object, ...] = ()

    def start(self) -> None:
        scene, radius = self._server.scene, self._body.radius_m
        segments = PATH_POINTS - 1
        self._line = scene.add_line_segments(
            PATH,
            np.zeros((segments, 2, 3), np.float32),
            np.tile(appearance.linear(np.array(appearance.PATH)), (segments, 2, 1)),
            thickness=0.3 * radius,
            visible=False,
        )
        rest = self._body.backbone.configuration.rest()
        self._ghost = scene.add_mesh_simple(
            TARGET,
            self._body.tube(rest, 1.0),
            self._body.tube_faces,
            color=appearance.TARGET,
            opacity=0.3,
            cast_shadow=False,
            receive_shadow=False,
            visible=False,
        )
        self._cloud = scene.add_point_cloud(
            WORKSPACE,
            np.zeros((CLOUD, 3), np.float32),
            np.zeros((CLOUD, 3), np.uint8),
            point_size=0.12 * radius,
            point_shape="circle",
            visible=False,
        )

    def update(self, state: RobotState, reach: bool) -> None:
        """Draw what changed; `reach`: somebody looks at the workspace."""
        doing = state.motion.doing
        points = doing.path.points if doing.path else ()
        if points != self._path:
            self._draw_path(points)
        if doing.target != self._target:
            self._draw_target(doing.target)
        if reach and state.commanded:
            self._draw_reach(state)

    def _draw_path(self, points: tuple[float, ...]) -> None:
        self._path = points
        self._line.visible = len(points) >= 6  # two points
        if self._line.visible:
            places = np.array(points).reshape(-1, 3)
            # Always the same number, so that the colours are sent once.
            places = np.concatenate([places, np.repeat(places[-1:], PATH_POINTS - len(places), axis=0)])
            self._line.points = single(np.stack([places[:-1], places[1:]], axis=1))

    def _draw_target(self, target: tuple[float, ...]) -> None:
        self._target = target
        self._ghost.visible = bool(target)
        if target:
            self._ghost.vertices = single(self._body.tube(np.array(target), 1.0))

    def _draw_reach(self, state: RobotState) -> None:
        q = np.array(state.commanded)
        sections, entries = moved_by(state.mode, self._description)
        stays = q.copy()
        for section in sections:
            stays[self._body.backbone.configuration.bends[section]] = 0.0
        stays[list(entries)] = 0.0
        steps = np.concatenate([STEPS[:2], np.full(len(q) - 2, STEPS[2])])
        wanted = (state.mode, *np.round(stays / steps).tolist())
        if wanted == self._reach:
            return
        self._reach = wanted
        self._cloud.visible = bool(sections or entries)
        if self._cloud.visible:
            tips = reachable_tips(self._description, q, sections, entries, CLOUD)
            self._cloud.points = single(tips)
            self._cloud.colors = _by_distance(tips)


def moved_by(mode: str, description: RobotDescription) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Which sections' bends and which other entries of q a mode moves: what its reach is made of.

    Section mode: all bends, at the twist and feed there are; a robot without any is twisted and fed. Tip mode:
    everything. Tip following: the leading section, for the body stays on its path. Going to a shape has no reach.
    """
    active = description.active_sections
    units = ((TWIST, description.twist), (FEED, description.feed))
    lengths = tuple(i for i in Configuration(description).lengths if i is not None)
    driven = (*(index for index, unit in units if unit), *lengths)
    if mode == "tip" or (mode == "section" and not active):
        return active, driven
    if mode == "section":
        return active, lengths
    return (active[-1:], ()) if mode == "following" else ((), ())


def _by_distance(places: Floats) -> appearance.Colors:
    """Colours from near the port to far from it."""
    far = np.linalg.norm(places, axis=1)
    share = (far - far.min()) / max(float(np.ptp(far)), 1e-9)
    near, away = (np.array(color, dtype=float) for color in (appearance.REACH_NEAR, appearance.REACH_FAR))
    return appearance.linear(near + share[:, None] * (away - near))
