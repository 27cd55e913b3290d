"""What each viewer chooses for itself: which parts are shown, whose eyes the camera is, what the plot draws.

All of it belongs to one client of viser, so nobody changes another's view.
"""

import viser

from app.console.panels import Panels
from app.console.plots import History, add_plot
from app.console.scene import PARTS, Scene
from app.console.surroundings import FOV_RAD, first_camera, up_direction
from cobra.description import RobotDescription

FREE, TIP = "free", "from the tip"
TIP_FOV_RAD = 1.3
NARROW_PX = 1000
"""A 3D view narrower than this starts with its panel folded."""


class ClientView:
    """The choices of one client, inside the shared panels."""

    def __init__(
        self, client: viser.ClientHandle, description: RobotDescription, scene: Scene, panels: Panels, history: History
    ) -> None:
        self._client = client
        self._description = description
        self._scene = scene
        self._panels = panels
        self._history = history
        self._wanted = dict.fromkeys(PARTS, True)
        self._hidden: dict[str, viser.SceneNodeHandle] = {}
        self._tip_view = False

    def start(self) -> None:
        """Build the client's controls. Not while another client's are being built: they share the tabs."""
        length, camera, gui = self._description.active_length_m, self._client.camera, self._client.gui
        camera.min_orbit_distance, camera.max_orbit_distance = 0.05 * length, 8.0 * length
        if camera.image_width < NARROW_PX:
            gui.main_panel.minimize()
        with self._panels.view_tab:
            mode = gui.add_dropdown("camera", (FREE, TIP))
            mode.on_update(lambda _: self._look_from_tip(mode.value == TIP))
            for part, (_, label) in PARTS.items():
                box = gui.add_checkbox(label, True)
                box.on_update(lambda event, part=part: self._want(part, event.target.value))
        with self._panels.plot_tab:
            titles = [channel.title for channel in self._history.channels]
            self._choice = gui.add_dropdown("last 20 s", titles)
            self._choice.on_update(lambda _: self._choose())
            self._shown = self._history.channels[0]
            self._plot = add_plot(gui, self._history, self._shown)

    def follow(self) -> None:
        """Keep the camera on the tip, when the client asked for it. Call it after each frame."""
        if not self._tip_view:
            return
        camera, position, rotation = self._client.camera, self._scene.tip_position, self._scene.tip_rotation
        with self._client.atomic():
            camera.position = position
            camera.look_at = position + 0.3 * self._description.active_length_m * rotation[:, 2]
            camera.up_direction = -rotation[:, 1]

    def update_plot(self) -> None:
        """Send the chosen channel's newest samples."""
        self._plot.data = self._history.data(self._shown)

    def _choose(self) -> None:
        chosen = next(channel for channel in self._history.channels if channel.title == self._choice.value)
        if chosen is self._shown:
            return
        old = self._plot
        self._shown, self._plot = chosen, add_plot(self._client.gui, self._history, chosen)
        old.remove()

    def _look_from_tip(self, wanted: bool) -> None:
        camera = self._client.camera
        self._tip_view = wanted
        camera.fov = TIP_FOV_RAD if wanted else FOV_RAD
        self._show("frame")
        if not wanted:
            with self._client.atomic():
                camera.position, look_at = first_camera(self._description)
                camera.look_at = look_at
                camera.up_direction = up_direction(self._description)

    def _want(self, part: str, wanted: bool) -> None:
        self._wanted[part] = wanted
        self._show(part)

    def _show(self, part: str) -> None:
        """Show or hide a part for this client only: an empty node of its own under the same name covers the shared one.

        From the tip the frame drawn there would be in the way.
        """
        visible = self._wanted[part] and not (part == "frame" and self._tip_view)
        if not visible and part not in self._hidden:
            self._hidden[part] = self._client.scene.add_frame(PARTS[part][0], show_axes=False, visible=False)
        elif visible and part in self._hidden:
            self._hidden.pop(part).remove()
