"""A robot on its equations of motion as the plant behind simulated drives: the paper's dynamics instead of MuJoCo (MODEL 4).

The drives set the cables' lengths; what they bear is what the cables' stretch pulls with.
"""

import math
import threading
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from cobra.description import RobotDescription
from cobra.mechanics.chain import guider_frames
from cobra.mechanics.described import parameters_of
from cobra.mechanics.dynamics import DEFAULT_STEP_S, Bools, Chain, SimulationError
from cobra.mechanics.kernels import layout
from cobra.simulation.plant import Floats, Truth


class _Seen(NamedTuple):
    """One instant of the motion."""

    time_s: float
    q: Floats
    motor_N: Floats
    top_N: Floats
    locked: Bools


class ChainPlant:
    """A `Plant`: `advance` from one thread, `truth` and `push` from any."""

    environment = None

    def __init__(self, description: RobotDescription) -> None:
        """At rest, straight, its cables slack.

        Raises:
            OperatorError: the robot has no equations of motion.
        """
        self.description = description
        self.parameters = parameters_of(description)
        self.chain = Chain(self.parameters)
        self.recoveries = 0
        """How often a motion that blew up was replaced by the last good state, at rest."""
        self._tendons: NDArray[np.intp] = np.array(description.tendon_drives, dtype=np.intp)
        self._straight = self.parameters.segments * self.parameters.rest_length_m
        self._lengths: Floats | None = None
        self._pushes = np.zeros((self.parameters.segments, 3))
        self._lock = threading.Lock()
        self._time_s = 0.0
        self._motor: Floats = np.zeros(len(self._tendons))
        # Compiled now, not while driving.
        self._march(np.full(len(self._tendons), 2.0 * self._straight), DEFAULT_STEP_S)
        self.chain = Chain(self.parameters)
        self._seen = self._look()

    def advance(self, travel: Floats, duration_s: float) -> Floats:
        """Move the drives' ends evenly to `travel` within `duration_s`; see `Plant.advance`.

        Raises:
            ValueError: `travel` is not one finite number a drive, or `duration_s` not finite and ≥ 0.
        """
        target = np.asarray(travel, dtype=np.float64)
        if target.shape != (len(self.description.drives),) or not np.isfinite(target).all():
            raise ValueError(f"travel = {travel}: must be {len(self.description.drives)} finite numbers, one a drive")
        if not (math.isfinite(duration_s) and duration_s >= 0):
            raise ValueError(f"duration_s = {duration_s}: must be finite and not negative")
        lengths = self._straight + target[self._tendons]
        with self._lock:
            if duration_s > 0.0:
                self._march(lengths, duration_s)
            self._lengths = lengths
            self._time_s += duration_s
            self._motor = self._motor_tensions(lengths)
            self._seen = self._look()
        loads = np.zeros(len(target))
        loads[self._tendons] = self._motor
        return loads

    def truth(self) -> Truth:
        """The state after the last `advance`; its shape is made now, by who asks."""
        seen = self._seen
        frames = guider_frames(seen.q)
        tip = frames[-1]
        x, y, z, w = Rotation.from_matrix(tip[:3, :3]).as_quat()
        return Truth(
            time_s=seen.time_s,
            tip_position=tip[:3, 3].copy(),
            tip_wxyz=np.array([w, x, y, z]),
            vertebrae=frames[1:, :3, 3].copy(),
            bends=_total_bend(tip[:3, :3])[None],
            tensions=seen.motor_N,
            tension_profile=np.column_stack([seen.motor_N, seen.motor_N, seen.top_N]),
            locked=tuple(bool(held) for held in seen.locked),
        )

    def push(self, vertebra: int, force: Floats, torque: Floats | None = None) -> None:
        """From now on push at a guider's centre: `force` (3,) [N] in the frame of the port; see `Plant.push`.

        Raises:
            ValueError: a torque, which this model does not know.
        """
        if torque is not None and np.any(torque):
            raise ValueError("the equations of motion take forces on the guiders, no torques")
        with self._lock:
            self._pushes[vertebra] = force

    def feed_by_hand(self, length_m: float) -> None:
        """See `Plant.feed_by_hand`; the base of such a robot stands still."""
        raise ValueError(f"{self.description.name} is not fed by hand")

    def _march(self, lengths: Floats, duration_s: float) -> None:
        start = lengths if self._lengths is None else self._lengths
        commands = np.stack([start, lengths])[None]
        loads = np.stack([self._pushes, self._pushes])[None]
        try:
            self.chain.march(
                layout.LENGTHS, np.array([DEFAULT_STEP_S]), 0.0, np.array([0.0, duration_s]), commands, loads
            )
        except SimulationError:
            # `march` left the state as it was before.
            self.recoveries += 1
            self.chain.v = np.zeros_like(self.chain.v)

    def _motor_tensions(self, lengths: Floats) -> Floats:
        stretch = self.parameters.cable_stiffness_N_m * (self.chain.cable_lengths_m - lengths)
        return np.maximum(stretch, 0.0)

    def _look(self) -> "_Seen":
        return _Seen(self._time_s, self.chain.q, self._motor, self.chain.tensions_N, self.chain.locked)


def _total_bend(rotation: Floats) -> Floats:
    """The bend vector (2,) [rad] of one arc whose end has the tilt of this frame (3, 3)."""
    axis = rotation[:, 2]
    aside = math.hypot(axis[0], axis[1])
    return axis[:2] * (math.atan2(aside, axis[2]) / aside if aside > 0.0 else 1.0)
