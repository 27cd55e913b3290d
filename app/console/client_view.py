"""What each viewer chooses for itself: which parts are shown, whose eyes the camera is, what the plot draws.

All of it belongs to one client of viser, so nobody changes another's view.
"""

import math
import threading
from collections.abc import Callable

import numpy as np
import viser

from app.console.meshes import Floats
from app.console.panels import Panels
from app.console.plots import History, add_plot
from app.console.scene import EXTRA_PARTS, PARTS, Parts, Scene
from app.console.surroundings import FOV_RAD, first_camera, up_direction
from cobra.control.modes.stick_frame import StickFrame
from cobra.description import RobotDescription

STICKS, FREE, TIP = "as the sticks are seen", "free", "from the tip"
BASE_STEP_RAD = 0.02
"""The view by the base turns with the twist in steps of this."""
AHEAD_STEP_M = 0.005
"""It goes along with the feed in steps of this,"""
FILLED = 1.15
"""from so many active lengths beyond the port on."""
TIP_FOV_RAD = 1.3
NARROW_PX = 1000
"""A 3D view narrower than this starts with its panel folded."""


class ClientView:
    """The choices of one client, inside the shared panels."""

    def __init__(
        self,
        client: viser.ClientHandle,
        description: RobotDescription,
        scene: Scene,
        panels: Panels,
        history: History,
        parts: Parts = PARTS,
        sticks: Callable[[], StickFrame] = lambda: "world",
        *,
        tip_only: bool = False,
        plain: bool = False,
        plot: bool = True,
        looks_only: bool = False,
    ) -> None:
        """`sticks` tells by which view the driver's sticks go; `tip_only`: the camera rides on the tip for good;
        `plain`: no shadows, which take four fifths of the time where a picture is drawn in software;
        `plot`: with a live plot;
        `looks_only`: nothing of this client's reaches us but its camera, so it gets no controls."""
        self._sticks = sticks
        self._follows = not tip_only
        self._camera: tuple[str, float] = (FREE, 0.0)
        self._ahead_m = 0.0
        """How far the view stands along the port's axis."""
        self._tip_only = tip_only
        self._plain = plain
        self._looks_only = looks_only
        self._plots = plot
        self._plot: viser.GuiUplotHandle | None = None
        self._client = client
        self._description = description
        self._scene = scene
        self._panels = panels
        self._history = history
        self._parts = parts
        self._wanted = {part: part not in EXTRA_PARTS for part in parts}
        self._hidden: dict[str, viser.SceneNodeHandle] = {}
        self._tip_view = False
        self._changing = threading.Lock()

    def start(self) -> None:
        """Build the client's controls. Not while another client's are being built: they share the tabs."""
        length, camera, gui = self._description.active_length_m, self._client.camera, self._client.gui
        if self._plain:
            self._client.scene.configure_default_lights(cast_shadow=False)
        camera.min_orbit_distance, camera.max_orbit_distance = 0.05 * length, 8.0 * length
        if camera.image_width < NARROW_PX or self._tip_only:
            gui.main_panel.minimize()
        if self._tip_only:
            self._choose_camera(TIP)
        if self._tip_only or self._looks_only:
            for part in self._parts:
                self._show(part)
            return
        with self._panels.view_tab:
            mode = gui.add_dropdown("camera", (STICKS, FREE, TIP))
            mode.on_update(lambda _: self._choose_camera(mode.value))
            for part, (_, label) in self._parts.items():
                box = gui.add_checkbox(label, self._wanted[part])
                box.on_update(self._box_changed(part))
                self._show(part)
        if not self._plots:
            return
        with self._panels.plot_tab:
            titles = [channel.title for channel in self._history.channels]
            self._choice = gui.add_dropdown("last 20 s", titles)
            self._choice.on_update(lambda _: self._choose())
            self._shown = self._history.channels[0]
            # A container of its own: the tab is every client's, and may be entered by one at a time only.
            self._frame = gui.add_folder(None)
            with self._frame:
                self._plot = add_plot(gui, self._history, self._shown)

    def shows(self, part: str) -> bool:
        """Whether this client wants to see a part."""
        return self._wanted.get(part, False)

    def update(self, plot: bool) -> None:
        """After each frame: keep the camera where it is to be, and with `plot` send the newest samples."""
        with self._changing:
            if self._follows:
                self._follow_sticks()
                self._follow_feed()
            if self._tip_view:
                rotation = self._scene.tip_rotation
                ahead = 0.3 * self._description.active_length_m * rotation[:, 2]
                self._look(self._scene.tip_position, self._scene.tip_position + ahead, -rotation[:, 1])
            if plot and self._plot is not None:
                self._plot.data = self._history.data(self._shown)

    def _follow_sticks(self) -> None:
        """What is up on the stick is to be up on the screen: the camera goes where the sticks are seen from."""
        frame = self._sticks()
        twist = round(self._scene.twist_rad / BASE_STEP_RAD) * BASE_STEP_RAD if frame == "base" else 0.0
        wanted = (TIP if frame == "tip" else FREE, twist)
        if wanted != self._camera:
            self._set_camera(*wanted)

    def _follow_feed(self) -> None:
        """What is fed must not leave the picture: the view goes along, from wherever somebody has turned it to."""
        ahead = max(self._scene.exposed_m - FILLED * self._description.active_length_m, 0.0)
        step = ahead - self._ahead_m
        if self._tip_view or abs(step) < AHEAD_STEP_M:
            return
        self._ahead_m, camera, way = ahead, self._client.camera, np.array([0.0, 0.0, step])
        self._look(camera.position + way, camera.look_at + way, camera.up_direction)

    def _choose(self) -> None:
        with self._changing:
            chosen = next(channel for channel in self._history.channels if channel.title == self._choice.value)
            if chosen is not self._shown and self._plot is not None:
                self._plot.remove()
                with self._frame:
                    self._shown, self._plot = chosen, add_plot(self._client.gui, self._history, chosen)

    def _choose_camera(self, mode: str) -> None:
        with self._changing:
            self._follows = mode == STICKS
            if not self._follows:
                self._set_camera(mode, 0.0)

    def _set_camera(self, mode: str, twist_rad: float) -> None:
        """From the tip from now on; or from the first camera, turned about the port's axis, and free from there."""
        self._camera = (mode, twist_rad)
        self._tip_view = mode == TIP
        self._client.camera.fov = TIP_FOV_RAD if self._tip_view else FOV_RAD
        self._show("frame")
        if not self._tip_view:
            c, s = math.cos(twist_rad), math.sin(twist_rad)
            turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
            along = np.array([0.0, 0.0, self._ahead_m])
            position, look_at = (point + along for point in first_camera(self._description))
            self._look(turn @ position, turn @ look_at, turn @ up_direction(self._description))

    def _look(self, position: Floats, look_at: Floats, up: Floats) -> None:
        with self._client.atomic():
            self._client.camera.position = position
            self._client.camera.look_at = look_at
            self._client.camera.up_direction = up

    def _box_changed(self, part: str) -> Callable[[viser.GuiEvent[viser.GuiCheckboxHandle]], None]:
        return lambda event: self._want(part, event.target.value)

    def _want(self, part: str, wanted: bool) -> None:
        with self._changing:
            self._wanted[part] = wanted
            self._show(part)

    def _show(self, part: str) -> None:
        """Show or hide a part for this client only: an empty node of its own under the same name covers the shared one.

        From the tip the frame drawn there would be in the way.
        """
        visible = self._wanted[part] and not (part == "frame" and self._tip_view)
        if not visible and part not in self._hidden:
            self._hidden[part] = self._client.scene.add_frame(self._parts[part][0], show_axes=False, visible=False)
        elif visible and part in self._hidden:
            self._hidden.pop(part).remove()
