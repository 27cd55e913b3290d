"""The live 3D view and its panels, fed from recordings: the same scene, and a second robot over it for comparison."""

import math
from collections.abc import Callable

import numpy as np
import viser

from app.console.body import Body
from app.console.meshes import Floats, single
from app.console.surroundings import introducer_length_m
from app.console.viewer import Viewer
from app.recording.player import Player
from cobra.description import RobotDescription
from cobra.messages import RobotState

OTHER_COLOR = (236, 110, 173)
"""Unlike everything else in the scene."""


class ReplayViewer(Viewer):
    """Draws what the player shows. Nothing grows old in it: a recording that is paused is no lost robot."""

    def __init__(self, description: RobotDescription, player: Player, other: RobotDescription | None) -> None:
        super().__init__(description, player.state, stale_s=math.inf)
        self._player = player
        self._other_description = other
        self._overlay: Overlay | None = None
        self._jumps = 0

    def open(self) -> None:
        super().open()
        if self._other_description is not None:
            self._overlay = Overlay(self._running(), self._other_description)

    def step(self) -> None:
        if self._player.jumps != self._jumps:
            self._jumps = self._player.jumps
            self.forget()
        if self._overlay is not None:
            overlay = self._overlay
            self._counted("other recording", lambda: overlay.update(self._player.other_state()))
        super().step()


class Overlay:
    """The other recording's robot, as a translucent tube."""

    def __init__(self, server: viser.ViserServer, description: RobotDescription) -> None:
        self._body = Body(description, introducer_length_m(description))
        q = self._body.backbone.configuration.rest()
        self._tube = server.scene.add_mesh_simple(
            "/other",
            self._body.tube(q, 1.02),
            self._body.tube_faces,
            color=OTHER_COLOR,
            opacity=0.55,
            cast_shadow=False,
            receive_shadow=False,
            visible=False,
        )

    def update(self, state: RobotState | None) -> None:
        """Draw it, or hide it while there is nothing to show."""
        q = None if state is None else shape_of(state, self._body.backbone.configuration.size)
        self._tube.visible = q is not None
        if q is not None:
            self._tube.vertices = single(self._body.tube(q, 1.02))


def shape_of(state: RobotState, size: int) -> Floats | None:
    """The measured q (size,), or None while it is not known."""
    q = np.array(state.measured, dtype=float)
    return q if len(q) == size and np.isfinite(q).all() else None


def tip_finder(description: RobotDescription) -> Callable[[RobotState | None], Floats | None]:
    """Where the measured tip is in a state: (3,) [m] in the frame of the entry port."""
    backbone = Body(description, introducer_length_m(description)).backbone

    def tip(state: RobotState | None) -> Floats | None:
        q = None if state is None else shape_of(state, backbone.configuration.size)
        return None if q is None else backbone.tip(q)[:3, 3]

    return tip
