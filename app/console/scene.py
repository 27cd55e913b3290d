"""The robot in 3D, live: measured backbone, vertebrae, tendons coloured by tension, tip, commanded ghost and trail.

A frame costs at most `MESSAGES_PER_FRAME` messages, whatever the number of vertebrae and tendons: viser's cost is per
message and client. Nothing here moves the robot.
"""

from collections import deque

import msgspec
import numpy as np
import viser

from app.console import appearance
from app.console.body import Body, Pose
from app.console.detail import FULL, Detail
from app.console.meshes import Floats, lathe, single
from app.console.motion_view import PATH, TARGET, WORKSPACE
from app.console.surroundings import add_surroundings, first_camera, introducer_length_m, up_direction
from cobra.description import RobotDescription
from cobra.kinematics.configuration import FEED, TWIST
from cobra.messages import Drives, Rigidity, RobotState, tensions_of

MESSAGES_PER_FRAME = 8
TRAIL_S = 20.0
GHOST_SCALE = 0.97
"""A hair thinner than the measured tube: it shows only where command and measurement differ."""

Parts = dict[str, tuple[str, str]]
LATER = frozenset(field.name for field in msgspec.structs.fields(Drives) if not field.required)
"""Of a state's drives what older recordings do not have."""

PARTS: Parts = {
    "ghost": ("/ghost", "commanded"),
    "tendons": ("/tendons", "tendons"),
    "vertebrae": ("/vertebrae", "vertebrae"),
    "trail": ("/trail", "tip's path"),
    "frame": ("/frame", "tip frame"),
    "path": (PATH, "remembered path"),
    "target": (TARGET, "shape to go to"),
}
"""What a viewer may hide → its node and its name for people."""
EXTRA_PARTS: Parts = {
    "workspace": (WORKSPACE, "reach of this mode"),
    "predicted": ("/predicted", "predicted under gravity"),
    "twin": ("/twin", "the twin itself: drag to push"),
}
"""What a viewer sees only when it wants to, on robots that have it."""


class BadStateError(ValueError):
    """A state that cannot be drawn. The message says what is wrong with it."""


class Scene:
    """One robot in one viser server. `start()` builds it, `update()` draws a state, `stop()` takes it away."""

    def __init__(self, server: viser.ViserServer, description: RobotDescription, detail: Detail = FULL) -> None:
        self._detail = detail
        self._server = server
        self._description = description
        self.body = Body(description, introducer_length_m(description), detail)
        self.tip_position, self.tip_rotation = np.zeros(3), np.eye(3)
        """(3,) [m] and (3, 3): where the tip was drawn last."""
        self.twist_rad = 0.0
        """Of the base as it was drawn last."""
        self.exposed_m = 0.0
        """Drawn last: length beyond the port."""
        self._frame = 0
        self._commanded: tuple[float, ...] = ()
        self._trail: deque[tuple[float, Floats]] = deque(maxlen=detail.trail_points)
        self._live: bool | None = None
        self._rigidity: Rigidity = "none"

    def start(self) -> None:
        """Build everything, at the rest configuration and grey: nothing is known yet."""
        add_surroundings(self._server, self._description)
        q = self.body.backbone.configuration.rest()
        pose = self.body.pose(q)
        self._add_robot(pose)
        self._add_frame(pose)
        self._add_overlays(q, pose)
        self._set_live(False, "waiting for the robot")

    def stop(self) -> None:
        """Remove everything that `start` built."""
        self._server.scene.reset()

    def update(self, state: RobotState) -> None:
        """Draw a state.

        Before homing the measured shape is a guess: it is drawn grey, with a notice.

        Raises:
            BadStateError: q has the wrong length or is not finite, or the drives do not match the description.
                Nothing has been drawn then.
        """
        measured = self._checked("measured", state.measured)
        commanded = self._checked("commanded", state.commanded)
        tensions = self._tensions(state)
        # Together, and viser's own thread is woken once.
        with self._server.atomic():
            if measured is not None:
                self._draw(self.body.pose(measured), state.stamp)
                self.twist_rad = float(measured[TWIST])
                self.exposed_m = float(measured[FEED])
            self._ghost.visible = commanded is not None
            due = self._frame % self._detail.ghost_every == 0
            if commanded is not None and due and state.commanded != self._commanded:
                self._ghost.vertices = single(self.body.tube(commanded, GHOST_SCALE))
                self._commanded = state.commanded
            known = state.homed and measured is not None
            if not known:
                self._trail.clear()
            self._set_live(known, "not homed: the shape is not known")
            self._show_rigidity(state.lock.status)
            if known and self._frame % self._detail.slow_every == 0:
                self._color_tendons(tensions)
            if self._frame % self._detail.slow_every == 1:
                self._draw_trail()
        self._frame += 1

    def forget(self) -> None:
        """Begin the tip's path anew."""
        self._trail.clear()

    def show_stale(self, age_s: float) -> None:
        """Grey the robot and say how old its last state is [s]; the next `update` brings it back."""
        self._set_live(False, f"no data for {age_s:.1f} s")

    def _checked(self, name: str, values: tuple[float, ...]) -> Floats | None:
        if not values:
            return None
        size = self.body.backbone.configuration.size
        if len(values) != size:
            raise BadStateError(f"{name}: {len(values)} entries, {size} are needed")
        q = np.array(values, dtype=float)
        if not np.isfinite(q).all():
            raise BadStateError(f"{name}: not finite")
        return q

    def _tensions(self, state: RobotState) -> Floats:
        """Of each drawn segment [N]: it falls along the tendon where that is known."""
        count = len(self._description.drives)
        for name in state.drives.__struct_fields__:
            entries = len(getattr(state.drives, name))
            # A recording of an older version lacks what was added since.
            if entries != count and (entries or name not in LATER):
                raise BadStateError(f"drives.{name}: {entries} entries, {count} are needed")
        profile, m, n = state.tendons.profile, len(self._description.tendon_names), len(self._description.sections)
        if len(profile) == m and all(len(row) == n + 2 for row in profile):
            return self.body.tensions_along(np.array(profile, dtype=float).reshape(m, n + 2)[:, 1:])
        return np.array(tensions_of(self._description, state), dtype=float)[self.body.segment_tendon]

    def _draw(self, pose: Pose, stamp: float) -> None:
        self._tube.vertices = single(pose.tube)
        self._vertebrae.batched_positions = single(pose.vertebrae)
        self._vertebrae.batched_wxyzs = single(pose.vertebrae_wxyz)
        if self._tendons is not None:
            self._tendons.points = single(pose.tendons)
        self._axes.points = single(self._axes_points(pose))
        self._cone.vertices = single(self._cone_vertices(pose))
        self.tip_position, self.tip_rotation = pose.tip_position, pose.tip_rotation
        if self._trail and stamp < self._trail[-1][0]:
            self._trail.clear()  # another run of the robot process
        if not self._trail or stamp - self._trail[-1][0] >= TRAIL_S / self._detail.trail_points:
            self._trail.append((stamp, pose.tip_position))

    def _draw_trail(self) -> None:
        trail = tuple(self._trail)  # somebody may begin it anew meanwhile
        if not trail:
            return
        oldest = trail[-1][0] - TRAIL_S
        places = [place for stamp, place in trail if stamp >= oldest] + [self.tip_position]
        # Always the same number of points, so that their fading colours are sent once.
        places = [places[0]] * (self._detail.trail_points + 1 - len(places)) + places
        points = np.array(places)
        self._trail_lines.points = np.stack([points[:-1], points[1:]], axis=1)

    def _color_tendons(self, tensions: Floats) -> None:
        tendon = self._description.tendon
        if self._tendons is None or tendon is None:
            return
        colors = appearance.linear(appearance.tension_colors(tensions, tendon.max_tension_N))
        self._tendons.colors = np.stack([colors, colors], axis=1)

    def _set_live(self, live: bool, notice: str) -> None:
        """Colours for a known shape, or grey with a notice."""
        if not live:
            self._notice.text = notice
        if live == self._live:
            return
        self._live = live
        self._notice.visible = not live
        self._tube.color = appearance.TUBE if live else appearance.STALE
        self._vertebrae.batched_colors = self._vertebra_colors(live)
        if not live and self._tendons is not None:
            self._color_tendons(np.full(len(self.body.segment_tendon), np.nan))
        self._frame = 0

    def _show_rigidity(self, status: Rigidity) -> None:
        """The guiders of a rigid robot have a colour of their own, and a label says what it is when it is not free."""
        if status == self._rigidity:
            return
        self._rigidity = status
        self._rigid_label.text = status
        self._rigid_label.visible = status not in ("none", "continuum")
        self._vertebrae.batched_colors = self._vertebra_colors(bool(self._live))

    def _vertebra_colors(self, live: bool) -> appearance.Colors:
        colors = np.tile(appearance.VERTEBRA if live else appearance.STALE, (len(self.body.vertebra_sizes), 1))
        if live:
            if self._rigidity == "rigid":
                colors[:] = appearance.RIGID
            colors[-self.body.sections :] = appearance.COLLAR
            colors[-1] = appearance.HEAD
        return appearance.linear(colors)

    def _add_robot(self, pose: Pose) -> None:
        scene = self._server.scene
        self._tube = scene.add_mesh_simple("/tube", pose.tube, self.body.tube_faces, color=appearance.STALE)
        # Of radius 1 and length 1 with rounded edges, scaled to each one's size.
        corner = np.linspace(0.0, np.pi / 2.0, 6)
        edge = [(0.5 - 0.2 * (1.0 - np.sin(a)), 0.86 + 0.14 * np.cos(a)) for a in corner]
        vertebra = ((-0.5, 0.5), *((-z, r) for z, r in reversed(edge)), *edge, (0.5, 0.5))
        self._vertebrae = scene.add_batched_meshes_simple(
            PARTS["vertebrae"][0],
            *lathe(vertebra, 32),
            batched_wxyzs=pose.vertebrae_wxyz,
            batched_positions=pose.vertebrae,
            batched_scales=self.body.vertebra_sizes,
            batched_colors=self._vertebra_colors(False),
            lod="off",
        )
        self._tendons: viser.LineSegmentsHandle | None = None
        if len(pose.tendons):
            self._tendons = scene.add_line_segments(
                PARTS["tendons"][0],
                pose.tendons,
                np.zeros(pose.tendons.shape, np.uint8),
                thickness=self.body.tendon_width_m,
            )

    def _add_frame(self, pose: Pose) -> None:
        """The tip camera's frame, and a cone of what it sees. Not as a node that is moved: those run a frame ahead."""
        scene, radius = self._server.scene, self.body.radius_m
        scene.add_frame(PARTS["frame"][0], show_axes=False)
        colors = appearance.linear(np.array(appearance.AXES))
        self._axes = scene.add_line_segments(
            f"{PARTS['frame'][0]}/axes",
            self._axes_points(pose),
            np.stack([colors, colors], axis=1),
            thickness=0.2 * radius,
        )
        self._unit_cone, faces = lathe(
            ((0.3 * radius, 0.4 * radius), (9.0 * radius, 4.5 * radius)), self._detail.cone_sides
        )
        self._cone = scene.add_mesh_simple(
            f"{PARTS['frame'][0]}/cone",
            self._cone_vertices(pose),
            faces,
            color=appearance.VIEW_CONE,
            opacity=0.16,
            side="double",
            cast_shadow=False,
            receive_shadow=False,
        )

    def _axes_points(self, pose: Pose) -> Floats:
        ends = pose.tip_position + 3.0 * self.body.radius_m * pose.tip_rotation.T
        return np.stack([np.broadcast_to(pose.tip_position, (3, 3)), ends], axis=1)

    def _cone_vertices(self, pose: Pose) -> Floats:
        return pose.tip_position + self._unit_cone @ pose.tip_rotation.T

    def _add_overlays(self, q: Floats, pose: Pose) -> None:
        """What is drawn about the robot: the commanded shape, the trail, and the notice."""
        scene = self._server.scene
        self._ghost = scene.add_mesh_simple(
            PARTS["ghost"][0],
            self.body.tube(q, GHOST_SCALE),
            self.body.tube_faces,
            color=appearance.GHOST,
            opacity=0.42,
            cast_shadow=False,
            receive_shadow=False,
            visible=False,
        )
        colors = appearance.linear(appearance.fading(appearance.TRAIL, self._detail.trail_points + 1))
        self._trail_lines = scene.add_line_segments(
            PARTS["trail"][0],
            np.tile(pose.tip_position, (self._detail.trail_points, 2, 1)),
            np.stack([colors[:-1], colors[1:]], axis=1),
            thickness=0.22 * self.body.radius_m,
        )
        _, look_at = first_camera(self._description)
        self._rigid_label = scene.add_label(
            "/rigidity",
            "",
            position=np.array([2.5 * self.body.radius_m, 0.0, 0.12 * self._description.active_length_m]),
            font_screen_scale=1.2,
            anchor="center-left",
            visible=False,
        )
        self._notice = scene.add_label(
            "/notice",
            "",
            position=look_at - 0.3 * self._description.active_length_m * up_direction(self._description),
            font_screen_scale=1.4,
            anchor="center-center",
            visible=False,
        )
