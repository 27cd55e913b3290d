"""The shape predicted from the motors' measured lengths under gravity and known loads, beside the constant-curvature one.

For robots whose equations of motion are known (MODEL 4): statics of the whole chain, each chamber an arc of its own.
"""

import numpy as np
import viser

from app.console import appearance
from app.console.meshes import Floats, single
from cobra.description import RobotDescription
from cobra.kinematics.configuration import Configuration
from cobra.mechanics.chain import backbone_frames
from cobra.mechanics.described import is_chain, parameters_of
from cobra.mechanics.inverse import BalanceError, inverse_statics
from cobra.messages import RobotState

NODE = "/predicted"
PIECES = 6
"""Straight pieces that an arc is drawn with."""


class Prediction:
    """Predicts one robot's shape. A robot that is no such chain has none: see `of`."""

    def __init__(self, description: RobotDescription) -> None:
        configuration = Configuration(description)
        length = configuration.lengths[0]
        assert length is not None
        self._bends, self._length = configuration.bends[0], length
        self._parameters = parameters_of(description)
        self.points_count = self._parameters.segments * PIECES + 1

    @classmethod
    def of(cls, description: RobotDescription) -> "Prediction | None":
        return cls(description) if is_chain(description) else None

    def points(self, q: Floats, loads_N: dict[int, Floats]) -> Floats | None:
        """The backbone (points_count, 3) [m] at the measured q, with forces on guiders by index; None when nothing holds it."""
        loads = np.zeros((self._parameters.segments, 3))
        for guider, force in loads_N.items():
            loads[guider] = force
        try:
            posture = inverse_statics(self._parameters, q[self._bends].tolist(), float(q[self._length]), loads)
        except BalanceError:
            return None
        return np.asarray(backbone_frames(posture.q, PIECES)[:, :3, 3])


class PredictedView:
    """The predicted backbone as a line in the 3D view."""

    def __init__(self, server: viser.ViserServer, prediction: Prediction, radius_m: float) -> None:
        self._prediction = prediction
        server.scene.add_frame(NODE, show_axes=False)
        self._line = server.scene.add_line_segments(
            f"{NODE}/line",
            np.zeros((prediction.points_count - 1, 2, 3)),
            appearance.linear(appearance.PREDICTED),
            thickness=0.12 * radius_m,
            visible=False,
        )

    def update(self, state: RobotState, loads_N: dict[int, Floats]) -> None:
        """Predict from the motors' lengths. A rigid robot does not bend, and one that is not homed is not known."""
        known = state.homed and len(state.measured) > 0 and state.lock.status != "rigid"
        q = np.array(state.measured, dtype=float)
        points = self._prediction.points(q, loads_N) if known and np.isfinite(q).all() else None
        self._line.visible = points is not None
        if points is not None:
            self._line.points = single(np.stack([points[:-1], points[1:]], axis=1))
