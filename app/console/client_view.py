"""What each viewer chooses for itself: which parts are shown, whose eyes the camera is, what the plot draws.

All of it belongs to one client of viser, so nobody changes another's view.
"""

import threading
from collections.abc import Callable

import viser

from app.console.meshes import Floats
from app.console.panels import Panels
from app.console.plots import History, add_plot
from app.console.scene import EXTRA_PARTS, PARTS, Parts, Scene
from app.console.surroundings import FOV_RAD, first_camera, up_direction
from cobra.description import RobotDescription

FREE, TIP = "free", "from the tip"
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
    ) -> None:
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
        camera.min_orbit_distance, camera.max_orbit_distance = 0.05 * length, 8.0 * length
        if camera.image_width < NARROW_PX:
            gui.main_panel.minimize()
        with self._panels.view_tab:
            mode = gui.add_dropdown("camera", (FREE, TIP))
            mode.on_update(lambda _: self._look_from_tip(mode.value == TIP))
            for part, (_, label) in self._parts.items():
                box = gui.add_checkbox(label, self._wanted[part])
                box.on_update(self._box_changed(part))
                self._show(part)
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
        """After each frame: keep the camera on the tip, if so chosen, and with `plot` send the newest samples."""
        with self._changing:
            if self._tip_view:
                rotation = self._scene.tip_rotation
                ahead = 0.3 * self._description.active_length_m * rotation[:, 2]
                self._look(self._scene.tip_position, self._scene.tip_position + ahead, -rotation[:, 1])
            if plot:
                self._plot.data = self._history.data(self._shown)

    def _choose(self) -> None:
        with self._changing:
            chosen = next(channel for channel in self._history.channels if channel.title == self._choice.value)
            if chosen is not self._shown:
                self._plot.remove()
                with self._frame:
                    self._shown, self._plot = chosen, add_plot(self._client.gui, self._history, chosen)

    def _look_from_tip(self, wanted: bool) -> None:
        with self._changing:
            self._tip_view = wanted
            self._client.camera.fov = TIP_FOV_RAD if wanted else FOV_RAD
            self._show("frame")
            if not wanted:
                self._look(*first_camera(self._description), up_direction(self._description))

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
