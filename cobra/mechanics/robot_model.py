"""What a calibration may adjust: the parameters of a tendon-driven robot, their nominal values and how far to trust them.

A model is made of effects; each adds a few parameters. All parameters are whitened: x = (value − nominal)/σ, so that the
prior is ½|x|² and one number means the same for a length and for an angle. The σ are widths of what is usual among such
robots, relative to the routing radius or the length; none comes from one robot's recording.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from cobra.description import RobotDescription
from cobra.errors import OperatorError
from cobra.kinematics import section
from cobra.mechanics.tendon_statics import Springs

Floats = NDArray[np.float64]

STIFF = 1e3
"""Tendon stiffness [K₁/r²] where tendons count as inextensible."""
PLAIN = ("base_rotation", "base_position", "marker", "length", "azimuth", "gain", "zero")
ORIENTED = ("marker_rotation",)
EFFECTS: dict[str, tuple[str, ...]] = {
    "elastic one-sided tendons": ("tendon_stiffness", "bending_ratio", "rest_bend"),
    "section hysteresis": ("slip_stiffness", "slip_moment"),
    "tendon creep": ("creep",),
    "vertebrae": ("vertebrae", "play"),
    "routing twist": ("routing_twist",),
    "tendon hardening": ("hardening",),
    "tendon friction": ("friction",),
    "uneven tendons": ("tendon_spread",),
    "clock offset": ("clock",),
}
"""In the order in which they are tried."""
NEEDS_SLACK = "elastic one-sided tendons"


class Block(NamedTuple):
    """Parameters of one kind."""

    name: str
    nominal: Floats
    sigma: float
    free: NDArray[np.bool_]
    labels: tuple[str, ...]
    unit: str
    logarithmic: bool
    without: float | None
    """Value where the parameter's effect is not part of the model; None: the nominal one."""


class Values(NamedTuple):
    """All parameters by name, in SI units; logarithmic ones as they enter, not their logarithms."""

    base_rotation: Floats
    """(3,) rotation vector of the robot's base in the measurement's frame [rad]"""
    base_position: Floats
    """(3,) [m]"""
    marker: Floats
    """(2,) x and y of what is measured, in the tip's frame [m]"""
    marker_rotation: Floats
    """(3,) rotation vector of what is measured, in the tip's frame [rad]"""
    length: Floats
    """(n,) [m]"""
    azimuth: Floats
    """(m,) in the section where the tendon ends [rad]"""
    gain: Floats
    """(m,) true travel per travel given"""
    zero: Floats
    """(m,) wound in beyond just taut on the straight robot, where the travel is 0 [m]"""
    tendon_stiffness: Floats
    """(active sections,) [N/m], on the scale of the first section's described bending stiffness"""
    bending_ratio: Floats
    """(n − 1,) bending stiffness of the later sections per described one, over that of the first"""
    rest_bend: Floats
    """(2n,) [rad]"""
    slip_stiffness: Floats
    """(n,) over the first section's bending stiffness"""
    slip_moment: Floats
    """(n,) over the first section's bending stiffness [rad]"""
    vertebrae: Floats
    """(1,) straight pieces of tendon a section, over the described ones"""
    play: Floats
    """(1,) of the tendons in their holes [m]"""
    hardening: Floats
    """(1,) [1/m]"""
    routing_twist: Floats
    """(n − 1,) by how much tendons that pass on into the next section turn about the backbone [rad]"""
    friction: Floats
    """(1,) share of its tension that a tendon loses in each section that it slides through"""
    creep: Floats
    """(1,) slackening per e-fold of time [m]"""
    tendon_spread: Floats
    """(m,) logarithm of each tendon's stiffness over its section's"""
    clock: Floats
    """(1,) [s]"""


@dataclass(frozen=True)
class Nominal:
    """The described robot in the terms of the model."""

    description: RobotDescription
    radius_m: float
    """Unit of length: routing radius of the first active section."""
    stiffness_Nm: float
    """Unit of moment: K₁ = EI/L of the first section [N·m/rad]."""
    length_m: Floats
    """(n,)"""
    bending: Floats
    """(n,) over the first"""
    ends: NDArray[np.int64]
    """(m,)"""
    group: NDArray[np.int64]
    """(m,) which active section, counted among the active ones"""
    azimuth: Floats
    """(m,)"""
    radius: Floats
    """(m,) over `radius_m`"""
    tendon_stiffness_N_m: Floats
    """(active sections,)"""
    vertebrae: Floats
    """(n,)"""


def nominal(description: RobotDescription) -> Nominal:
    """The described robot in the terms of the model.

    Raises:
        OperatorError: the robot has no tendons, or a section that changes its length.
    """
    if description.tendon is None or not description.active_sections:
        raise OperatorError(f"{description.name}: has no tendons to calibrate")
    for part in description.sections:
        if part.elongation is not None:
            raise OperatorError(
                f"{description.name}: section {part.name} changes its length; that cannot be calibrated"
            )
    sections = description.sections
    routed = [(i, part.routing) for i, part in enumerate(sections) if part.routing is not None]
    lengths = np.array([part.length_m for part in sections])
    bending = np.array([part.bending_stiffness_Nm2 for part in sections]) / lengths
    free = np.array([description.tendon.conduit_length_m + lengths[: i + 1].sum() for i, _ in routed])
    radius = routed[0][1].radius_m
    return Nominal(
        description=description,
        radius_m=radius,
        stiffness_Nm=float(bending[0]),
        length_m=lengths,
        bending=bending / bending[0],
        ends=np.array([i for i, routing in routed for _ in routing.names], dtype=np.int64),
        group=np.array([j for j, (_, routing) in enumerate(routed) for _ in routing.names], dtype=np.int64),
        azimuth=np.radians([a for _, routing in routed for a in routing.azimuths_deg]),
        radius=np.array([routing.radius_m / radius for _, routing in routed for _ in routing.names]),
        tendon_stiffness_N_m=description.tendon.axial_stiffness_N / free,
        vertebrae=np.array([float(part.vertebrae) for part in sections]),
    )


def blocks(robot: Nominal) -> dict[str, Block]:
    """All parameters of a robot, with their nominal values and widths."""
    n, m = len(robot.length_m), len(robot.ends)
    r, length = robot.radius_m, float(robot.length_m.sum())
    sections = [part.name for part in robot.description.sections]
    tendons = robot.description.tendon_names
    active = [sections[i] for i in robot.description.active_sections]
    xyz = ("x", "y", "z")
    planes = [f"{name} {axis}" for name in sections for axis in "xy"]

    def make(
        name: str,
        nominal: Any,
        sigma: float,
        labels: Iterable[str],
        unit: str,
        *,
        log: bool = False,
        held: int = 0,
        without: float | None = None,
    ) -> Block:
        values = np.atleast_1d(np.asarray(nominal, dtype=np.float64))
        free = np.arange(len(values)) >= held
        return Block(name, np.log(values) if log else values, sigma, free, tuple(labels), unit, log, without)

    made = [
        make("base_rotation", np.zeros(3), 1.0, xyz, "rad"),
        make("base_position", np.zeros(3), 0.2 * length, xyz, "m"),
        make("marker", np.zeros(2), 0.03 * length, "xy", "m"),
        make("marker_rotation", np.zeros(3), 1.0, xyz, "rad"),
        make("length", robot.length_m, 0.01 * length, sections, "m"),
        # The first is held: turning all tendons is turning the base.
        make("azimuth", robot.azimuth, 0.35, tendons, "rad", held=1),
        make("gain", np.ones(m), 0.1, tendons, ""),
        make("zero", np.zeros(m), 0.2 * r, tendons, "m"),
        make("tendon_stiffness", robot.tendon_stiffness_N_m, 1.5, active, "N/m", log=True),
        make("bending_ratio", np.ones(n - 1), 0.5, sections[1:], "", log=True),
        make("rest_bend", np.zeros(2 * n), 0.2, planes, "rad"),
        make("slip_stiffness", np.full(n, 0.5), 1.5, sections, "K1", log=True, without=0.0),
        make("slip_moment", np.full(n, 0.05), 1.5, sections, "K1 rad", log=True, without=0.0),
        make("vertebrae", [1.0], 0.35, ["all"], "", log=True, without=math.inf),
        make("play", [0.0], 0.1 * r, ["all"], "m"),
        make("hardening", [0.5 / r], 1.5, ["all"], "1/m", log=True, without=0.0),
        make("routing_twist", np.zeros(n - 1), 0.15, sections[1:], "rad"),
        make("friction", [0.03], 1.5, ["all"], "", log=True, without=0.0),
        make("creep", [0.0], 0.02 * r, ["all"], "m"),
        make("tendon_spread", np.zeros(m), 0.3, tendons, ""),
        make("clock", [0.0], 0.2, ["all"], "s"),
    ]
    return {block.name: block for block in made}


@dataclass(frozen=True)
class RobotModel:
    """A robot with a choice of effects, as a function of whitened parameters x (size,)."""

    robot: Nominal
    blocks: dict[str, Block]
    effects: tuple[str, ...]
    oriented: bool
    """The tip's orientation is measured too."""

    @property
    def slack(self) -> bool:
        return NEEDS_SLACK in self.effects

    @cached_property
    def free(self) -> tuple[Block, ...]:
        """Blocks that the model adjusts, in the order of x."""
        names = [*PLAIN, *(ORIENTED if self.oriented else ()), *(n for e in self.effects for n in EFFECTS[e])]
        return tuple(self.blocks[name] for name in names)

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """What each entry of x stands for."""
        return tuple(
            f"{block.name}[{label}]"
            for block in self.free
            for label, free in zip(block.labels, block.free, strict=True)
            if free
        )

    @property
    def size(self) -> int:
        return len(self.labels)

    def with_effects(self, effects: Iterable[str]) -> "RobotModel":
        return replace(self, effects=tuple(effects))

    def carry(self, x: Floats, other: "RobotModel") -> Floats:
        """Parameters of this model in those of another one; what this one lacks is nominal."""
        known = dict(zip(self.labels, x, strict=True))
        return np.array([known.get(label, 0.0) for label in other.labels])

    def values(self, x: Floats) -> Values:
        """All parameters in SI units."""
        out = {}
        adjusted = {block.name for block in self.free}
        at = 0
        for block in self.free:
            value = block.nominal.copy()
            count = int(block.free.sum())
            value[block.free] += block.sigma * x[at : at + count]
            at += count
            out[block.name] = np.exp(value) if block.logarithmic else value
        for block in self.blocks.values():
            if block.name not in adjusted:
                value = np.exp(block.nominal) if block.logarithmic else block.nominal
                out[block.name] = value if block.without is None else np.full_like(value, block.without)
        return Values(**out)

    def springs(self, v: Values) -> Springs:
        """The same in the units of the statics."""
        robot = self.robot
        r, k = robot.radius_m, robot.stiffness_Nm
        n, m = len(robot.length_m), len(robot.ends)
        turned = np.concatenate([np.zeros(1), np.cumsum(v.routing_twist)])
        direction = np.zeros((m, n, 2))
        for t, end in enumerate(robot.ends):
            # A tendon's azimuth is given where it ends; towards the base its holes are turned.
            angle = v.azimuth[t] + turned[end] - turned[: end + 1]
            direction[t, : end + 1, 0] = robot.radius[t] * np.cos(angle)
            direction[t, : end + 1, 1] = robot.radius[t] * np.sin(angle)
        stiffness = v.tendon_stiffness[robot.group] * np.exp(v.tendon_spread) * r * r / k if self.slack else STIFF
        return Springs(
            rest=v.rest_bend,
            bending=robot.bending * np.concatenate([np.ones(1), v.bending_ratio]),
            slip_stiffness=v.slip_stiffness,
            slip_moment=v.slip_moment,
            length=v.length / r,
            chord=1.0 / (24.0 * (robot.vertebrae * v.vertebrae) ** 2),
            direction=direction,
            zero=v.zero / r,
            gain=v.gain,
            stiffness=np.broadcast_to(stiffness, (m,)).astype(np.float64),
            hardening=np.full(m, v.hardening[0] * r),
            play=v.play / r,
            friction=v.friction,
            creep=v.creep / r,
            clock=v.clock,
        )


def poses(v: Values, bends: Floats) -> tuple[Floats, Floats]:
    """Position (..., 3) [m] and rotation (..., 3, 3) of what is measured at the tip, in the measurement's frame."""
    n = len(v.length)
    bends = np.asarray(bends).reshape(*np.shape(bends)[:-1], n, 2)
    turn = Rotation.from_rotvec(v.base_rotation).as_matrix()
    place = np.broadcast_to(v.base_position, (*bends.shape[:-2], 3))
    for i in range(n):
        place = place + (turn @ section.translation(bends[..., i, :], v.length[i])[..., None])[..., 0]
        turn = turn @ section.rotation(bends[..., i, :])
    place = place + turn[..., :2] @ v.marker
    return place, turn @ Rotation.from_rotvec(v.marker_rotation).as_matrix()
