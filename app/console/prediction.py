"""The shape predicted from the motors' measured lengths under gravity and known loads, beside the constant-curvature one.

For robots whose equations of motion are known (MODEL 4): statics of the whole chain, each chamber an arc of its own.
"""

import numpy as np
import viser

from app.console import appearance
from app.console.meshes import Floats, single, sweep, sweep_faces, unit_circle
from cobra.description import RobotDescription
from cobra.kinematics.configuration import Configuration
from cobra.mechanics.chain import backbone_frames
from cobra.mechanics.described import parameters_of
from cobra.mechanics.inverse import BalanceError, inverse_statics
from cobra.messages import RobotState

NODE = "/predicted"
SIDES = 24
PIECES = 6
"""Straight pieces that an arc is drawn with."""


class Prediction:
    """Predicts one robot's shape. Raises OperatorError for a robot that is no such chain (`is_chain`)."""

    def __init__(self, description: RobotDescription) -> None:
        self._parameters = parameters_of(description)
        configuration = Configuration(description)
        length = configuration.lengths[0]
        assert length is not None
        self._bends, self._length = configuration.bends[0], length
        self.count = self._parameters.segments * PIECES + 1

    def frames(self, q: Floats, loads_N: dict[int, Floats]) -> Floats | None:
        """Along the backbone (count, 4, 4) at the measured q, with forces on guiders by index [N]; None when nothing holds it."""
        loads = np.zeros((self._parameters.segments, 3))
        for guider, force in loads_N.items():
            loads[guider] = force
        try:
            posture = inverse_statics(self._parameters, q[self._bends].tolist(), float(q[self._length]), loads)
        except BalanceError:
            return None
        return np.asarray(backbone_frames(posture.q, PIECES))


class PredictedView:
    """The predicted backbone as a sheath around the drawn one in the 3D view."""

    def __init__(self, server: viser.ViserServer, prediction: Prediction, radius_m: float) -> None:
        self._prediction = prediction
        self._radii = np.full(prediction.count, radius_m)
        self._circle = unit_circle(SIDES)
        server.scene.add_frame(NODE, show_axes=False)
        straight = np.tile(np.eye(4), (prediction.count, 1, 1))
        self._sheath = server.scene.add_mesh_simple(
            f"{NODE}/sheath",
            self._vertices(straight),
            sweep_faces(prediction.count, SIDES),
            color=appearance.PREDICTED,
            opacity=0.4,
            side="double",
            cast_shadow=False,
            receive_shadow=False,
            visible=False,
        )

    def update(self, state: RobotState, loads_N: dict[int, Floats]) -> None:
        """Predict from the motors' lengths. A rigid robot does not bend, and one that is not homed is not known."""
        known = state.homed and len(state.measured) > 0 and state.lock.status != "rigid"
        q = np.array(state.measured, dtype=float)
        frames = self._prediction.frames(q, loads_N) if known and np.isfinite(q).all() else None
        self._sheath.visible = frames is not None
        if frames is not None:
            self._sheath.vertices = single(self._vertices(frames))

    def _vertices(self, frames: Floats) -> Floats:
        return sweep(frames[:, :3, 3], frames[:, :3, :3], self._radii, self._circle)
