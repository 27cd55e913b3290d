"""Foxglove's own message types (docs.foxglove.dev, message schemas), so that a recording opens there as it is.

The backbone as a scene, q and the drives as joint states, events as a log. Every field that the published schemas require.
"""

import math
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from app.recording.channels import Level
from cobra.description import RobotDescription
from cobra.kinematics.backbone import Backbone
from cobra.kinematics.configuration import Configuration
from cobra.messages import Event, RobotState

Floats = NDArray[np.float64]

SCENE: Final = "/foxglove/scene"
JOINTS: Final = "/foxglove/joints"
LOG: Final = "/foxglove/log"
FRAME: Final = "entry port"
"""x right, y down, z ahead."""
POINTS_PER_SECTION: Final = 12
LINE_STRIP: Final = 0
SECOND_NS: Final = 1_000_000_000
LEVELS: Final[dict[Level, int]] = {"info": 2, "warning": 3, "alarm": 4, "marker": 2}
DIGITS: Final = 5
"""The scene is for looking at: 10 µm."""


class Time(msgspec.Struct, frozen=True):
    sec: int
    nsec: int

    @classmethod
    def of(cls, ns: int) -> "Time":
        return cls(*divmod(ns, SECOND_NS))


class Point3(msgspec.Struct, frozen=True):
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0


class Quaternion(msgspec.Struct, frozen=True):
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    w: float = 1.0


class Pose(msgspec.Struct, frozen=True):
    position: Point3 = Point3()
    orientation: Quaternion = Quaternion()


class Color(msgspec.Struct, frozen=True):
    r: float
    g: float
    b: float
    a: float = 1.0


class LinePrimitive(msgspec.Struct, frozen=True, kw_only=True):
    type: int = LINE_STRIP
    pose: Pose = Pose()
    thickness: float
    scale_invariant: bool = False
    points: list[Point3]
    color: Color
    colors: tuple[Color, ...] = ()
    indices: tuple[int, ...] = ()


class Unused(msgspec.Struct, frozen=True):
    """Of what we draw none; the published schema wants the empty list."""


class SceneEntity(msgspec.Struct, frozen=True, kw_only=True):
    timestamp: Time
    frame_id: str = FRAME
    id: str
    lifetime: Time = Time(0, 0)
    frame_locked: bool = True
    lines: list[LinePrimitive]
    metadata: tuple[Unused, ...] = ()
    arrows: tuple[Unused, ...] = ()
    cubes: tuple[Unused, ...] = ()
    spheres: tuple[Unused, ...] = ()
    cylinders: tuple[Unused, ...] = ()
    triangles: tuple[Unused, ...] = ()
    texts: tuple[Unused, ...] = ()
    models: tuple[Unused, ...] = ()


class SceneUpdate(msgspec.Struct, frozen=True, kw_only=True):
    entities: list[SceneEntity]
    deletions: tuple[Unused, ...] = ()


class JointState(msgspec.Struct, frozen=True, kw_only=True):
    """What is not known is left out."""

    name: str
    position: float | msgspec.UnsetType = msgspec.UNSET
    velocity: float | msgspec.UnsetType = msgspec.UNSET
    effort: float | msgspec.UnsetType = msgspec.UNSET


class JointStates(msgspec.Struct, frozen=True, kw_only=True):
    timestamp: Time
    joints: list[JointState]


class Log(msgspec.Struct, frozen=True, kw_only=True):
    timestamp: Time
    level: int
    message: str
    name: str
    file: str = ""
    line: int = 0


TYPES: Final[dict[str, tuple[str, type[msgspec.Struct]]]] = {
    SCENE: ("foxglove.SceneUpdate", SceneUpdate),
    JOINTS: ("foxglove.JointStates", JointStates),
    LOG: ("foxglove.Log", Log),
}
"""Topic → the schema's name, by which Foxglove knows it, and its type."""

MEASURED = Color(0.38, 0.8, 0.93)
COMMANDED = Color(0.96, 0.74, 0.31, 0.6)
AXES = (Color(0.9, 0.25, 0.2), Color(0.3, 0.75, 0.3), Color(0.25, 0.45, 0.95))


class FoxgloveView:
    """Turns a robot's states into what Foxglove draws and plots."""

    def __init__(self, description: RobotDescription) -> None:
        self._description = description
        self._layout = Configuration(description)
        self._backbone = Backbone(description)
        n = len(description.sections)
        self._places = np.linspace(0.0, n, n * POINTS_PER_SECTION + 1)
        self._diameter_m = description.backbone.diameter_m

    def scene(self, state: RobotState, time_ns: int) -> SceneUpdate | None:
        """Measured and commanded backbone and the tip's axes; None while no shape is known."""
        measured = self._configuration(state.measured)
        if measured is None:
            return None
        positions, tip, rotation = self._shape(measured)
        lines = [LinePrimitive(thickness=self._diameter_m, points=positions, color=MEASURED)]
        for axis, color in zip(rotation.T, AXES, strict=True):
            ends = _points(np.stack([tip, tip + 2.0 * self._diameter_m * axis]))
            lines.append(LinePrimitive(thickness=0.2 * self._diameter_m, points=ends, color=color))
        commanded = self._configuration(state.commanded)
        if commanded is not None:
            ghost = self._shape(commanded)[0]
            lines.append(LinePrimitive(thickness=0.6 * self._diameter_m, points=ghost, color=COMMANDED))
        return SceneUpdate(entities=[SceneEntity(timestamp=Time.of(time_ns), id="robot", lines=lines)])

    def joints(self, state: RobotState, time_ns: int) -> JointStates:
        """q as measured and commanded, then every drive: travel, velocity and load."""
        joints = [
            JointState(name=f"{kind} {name}", position=_known(value))
            for kind, values in (("measured", state.measured), ("commanded", state.commanded))
            for name, value in zip(self._layout.names, values, strict=False)
        ]
        drives = state.drives
        values = zip(self._description.drives, drives.travel, drives.velocity, drives.load, strict=False)
        joints += [
            JointState(
                name=f"drive {drive.name}", position=_known(travel), velocity=_known(velocity), effort=_known(load)
            )
            for drive, travel, velocity, load in values
        ]
        return JointStates(timestamp=Time.of(time_ns), joints=joints)

    def tip(self, state: RobotState) -> Floats | None:
        """(3,) [m]: where the measured tip is; None while no shape is known."""
        q = self._configuration(state.measured)
        return None if q is None else self._backbone.tip(q)[:3, 3]

    def _configuration(self, values: tuple[float, ...]) -> Floats | None:
        if len(values) != self._layout.size or not all(map(math.isfinite, values)):
            return None
        return np.array(values)

    def _shape(self, q: Floats) -> tuple[list[Point3], Floats, Floats]:
        ends = np.concatenate([[0.0], np.cumsum(self._layout.section_lengths(q))])
        arcs = np.interp(self._places, np.arange(len(ends)), ends)
        shape = self._backbone.poses_at(q, arcs)
        return _points(shape.positions), shape.positions[-1], shape.rotations[-1]


def log_of(event: Event, robot: str, time_ns: int) -> Log:
    """An event as a line of Foxglove's log."""
    return Log(timestamp=Time.of(time_ns), level=LEVELS[event.level], message=event.text, name=robot)


def _known(value: float) -> float | msgspec.UnsetType:
    return value if math.isfinite(value) else msgspec.UNSET


def _points(positions: Floats) -> list[Point3]:
    return [Point3(*place) for place in np.round(positions, DIGITS).tolist()]
