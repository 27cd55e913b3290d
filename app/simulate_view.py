"""A simulated motion in the 3D scene, with a time slider: it only replays, and moves no robot."""

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import rich
import viser
from viser import _messages

from app.console import appearance
from app.console.meshes import lathe, quaternions, sweep, sweep_faces, unit_circle
from cobra.mechanics.chain import Floats, backbone_frames
from cobra.mechanics.dynamics import Motion
from cobra.mechanics.measured import Measured

HOST = "127.0.0.1"
PIECES = 12
"""Rings of the drawn tube to a chamber."""
SIDES = 24
FOV_RAD = 0.7
RATE_HZ = 30.0
SPEEDS = (0.1, 0.25, 0.5, 1.0, 2.0)
CHAMBER_SHARE, GUIDER_SHARE = 0.62, 1.18
"""Radii of the drawn chambers and guiders, in radii of the cables' circle."""
NEWTON_M = 0.03
"""An arrow of this length is a newton."""


@dataclass(frozen=True)
class Drawing:
    """Everything that is drawn of one moment."""

    tube: Floats
    """(rings · sides, 3)"""
    guiders: Floats
    """(n + 1, 3)"""
    guiders_wxyz: Floats
    """(n + 1, 4)"""
    cables: Floats
    """(cables · n, 2, 3)"""
    tensions: Floats
    """(cables · n,) [N]"""
    loads: Floats
    """(n, 2, 3) from the tail of each force's arrow to its guider."""


def draw(motion: Motion, moment_s: float) -> Drawing:
    """The recorded moment nearest to a time."""
    row = int(np.abs(motion.time_s - moment_s).argmin())
    p = motion.parameters
    radius = 0.5 * p.cable_circle_diameter_m
    along = backbone_frames(motion.q[row], PIECES)
    rings = np.full(len(along), CHAMBER_SHARE * radius)
    frames = motion.frames[row]
    azimuths = np.radians(p.cable_azimuths_deg)
    holes = radius * np.stack([np.cos(azimuths), np.sin(azimuths), np.zeros_like(azimuths)], axis=-1)
    # (n + 1, cables, 3) → segments from guider to guider.
    points = np.einsum("nij,kj->nki", frames[:, :3, :3], holes) + frames[:, None, :3, 3]
    cables = np.stack([points[:-1], points[1:]], axis=2).swapaxes(0, 1).reshape(-1, 2, 3)
    heads = frames[1:, :3, 3]
    return Drawing(
        sweep(along[:, :3, 3], along[:, :3, :3], rings, unit_circle(SIDES)),
        frames[:, :3, 3],
        quaternions(frames[:, :3, :3]),
        cables,
        np.repeat(motion.tensions_N[row], p.segments),
        np.stack([heads - NEWTON_M * motion.loads_N[row], heads], axis=1),
    )


class MotionView:
    """One motion in one viser server. `start()` opens it on loopback, `step()` plays on, `stop()` closes it."""

    def __init__(self, motion: Motion, measured: Measured | None = None, port: int = 0) -> None:
        self.motion, self.measured, self._port = motion, measured, port
        self._server: viser.ViserServer | None = None
        self._shown = -1.0
        self._tube: Any = None
        self.slider: Any = None

    @property
    def port(self) -> int:
        """Where it listens on loopback."""
        return self._running().get_port()

    def start(self) -> None:
        """Open viser and draw the first moment."""
        console = rich.get_console()
        before, console.quiet = console.quiet, True
        try:
            self._server = viser.ViserServer(host=HOST, port=self._port, verbose=False)
        finally:
            console.quiet = before
        for request in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):
            self._server._websock_server.unregister_handler(request)
        self._build(self._server)
        self.show(float(self.motion.time_s[0]))

    def stop(self) -> None:
        """Close viser."""
        if self._server is not None:
            self._server.stop()
            self._server = None

    def step(self, passed_s: float) -> None:
        """Draw what the slider says; while playing, after moving it on by the time that passed. At the end it begins anew."""
        first, last = float(self.motion.time_s[0]), float(self.motion.time_s[-1])
        if self.playing.value:
            moment = float(self.slider.value) + passed_s * float(self.speed.value)
            self.slider.value = first if moment > last else moment
        if self.slider.value != self._shown:
            self.show(float(self.slider.value))

    def show(self, moment_s: float) -> None:
        """Draw a moment."""
        self._shown = moment_s
        now = draw(self.motion, moment_s)
        largest = max(float(self.motion.tensions_N.max()), 1e-9)
        colors = appearance.linear(appearance.tension_colors(now.tensions, largest))
        with self._running().atomic():
            self._tube.vertices = now.tube
            self._guiders.batched_positions, self._guiders.batched_wxyzs = now.guiders, now.guiders_wxyz
            self._cables.points = now.cables
            self._cables.colors = np.repeat(colors[:, None], 2, axis=1)
            self._loads.points = now.loads
            if self._dots is not None:
                self._dots.points = _nearest(self.measured, moment_s, now.guiders)

    def _running(self) -> viser.ViserServer:
        if self._server is None:
            raise RuntimeError("the view has not been started")
        return self._server

    def _build(self, server: viser.ViserServer) -> None:
        p, motion = self.motion.parameters, self.motion
        reach, radius = p.segments * p.rest_length_m, 0.5 * p.cable_circle_diameter_m
        gravity = np.asarray(p.gravity_m_s2)
        up = -gravity / np.linalg.norm(gravity) if np.any(gravity) else np.array([0.0, -1.0, 0.0])
        server.scene.set_up_direction(tuple(up))
        look_at = np.array([0.0, 0.0, 0.5 * reach])
        camera = server.initial_camera
        camera.look_at, camera.fov = look_at, FOV_RAD
        camera.position = look_at + reach * (np.array([0.5, 1.6, 0.0]) + 0.35 * up)
        camera.near, camera.far = 0.02 * reach, 20.0 * reach
        appearance.light(server)
        first = draw(motion, float(motion.time_s[0]))
        scene = server.scene
        faces = sweep_faces(len(first.tube) // SIDES, SIDES)
        scene.add_mesh_simple("/start", first.tube, faces, color=appearance.GHOST, opacity=0.18, cast_shadow=False)
        self._tube = scene.add_mesh_simple("/chambers", first.tube, faces, color=appearance.TUBE)
        thick, rim = 0.18 * p.locked_length_m, GUIDER_SHARE * radius
        disc = (
            (-thick, 0.0),
            (-thick, 0.92 * rim),
            (-0.7 * thick, rim),
            (0.7 * thick, rim),
            (thick, 0.92 * rim),
            (thick, 0.0),
        )
        self._guiders: Any = scene.add_batched_meshes_simple(
            "/guiders",
            *lathe(disc, 48),
            batched_wxyzs=first.guiders_wxyz,
            batched_positions=first.guiders,
            batched_colors=appearance.linear(appearance.VERTEBRA),
            lod="off",
        )
        white = np.full((len(first.cables), 2, 3), 255, np.uint8)
        self._cables: Any = scene.add_line_segments("/cables", first.cables, white, thickness=0.05 * radius)
        red = np.tile(appearance.linear(appearance.AXES[0]), (p.segments, 2, 1))
        self._loads: Any = scene.add_line_segments("/forces", first.loads, red, thickness=0.12 * radius)
        self._dots: Any = None
        if self.measured is not None:
            dots = _nearest(self.measured, float(motion.time_s[0]), first.guiders)
            self._dots = scene.add_point_cloud("/measured", dots, appearance.NOTICE, point_size=0.2 * radius)
        gui = server.gui
        gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False)
        step = float(np.diff(motion.time_s).max())
        begin, end = float(motion.time_s[0]), float(motion.time_s[-1])
        self.slider = gui.add_slider("time [s]", min=begin, max=end, step=min(step, end - begin), initial_value=begin)
        self.playing = gui.add_checkbox("play", initial_value=True)
        self.speed = gui.add_dropdown("speed", [f"{speed:g}" for speed in SPEEDS], initial_value="1")


def show(motion: Motion, measured: Measured | None, port: int) -> None:
    """Play it until Ctrl-C, and say where."""
    view = MotionView(motion, measured, port)
    view.start()
    try:
        print(f"3D view: http://{HOST}:{view.port}   (Ctrl-C ends it)", flush=True)
        before = time.monotonic()
        while True:
            time.sleep(1.0 / RATE_HZ)
            now = time.monotonic()
            view.step(now - before)
            before = now
    except KeyboardInterrupt:
        pass
    finally:
        view.stop()


def _nearest(measured: Measured | None, moment_s: float, guiders: Floats) -> Floats:
    """Measured positions at a time (n, 3); a guider or axis that was not measured stands where it is simulated."""
    if measured is None:
        return guiders[1:]
    row = int(np.abs(measured.time_s - moment_s).argmin())
    return np.where(np.isnan(measured.positions_m[row]), guiders[1:], measured.positions_m[row])
