"""A robot description as a MuJoCo model: a chain of vertebrae on elastic joints, with tendons through their holes.

Every interval between two vertebrae bends in the middle of its gap by a universal joint of stiffness EI/pitch, where a
polygon follows an arc best, up to where the vertebrae meet. The order of the joint's two axes alternates along the
chain: a series of universal joints all alike would twist the body when it bends between its axes. A chamber that can
change its length has two such joints at the Gauss points of its gap, and between them a slide of stiffness K and a
torsion hinge of stiffness GJ/pitch (S-38). Other sections have one torsion hinge each, inside their middle vertebra.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import accumulate
from typing import Any, Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from cobra.description import Drive, RobotDescription, Tendon
from cobra.simulation.contacts import add_skin, add_walls
from cobra.simulation.environments import Environment
from cobra.simulation.plant import Floats

Kind = Literal["default", "ideal"]
Action = Literal["bend_x", "bend_y", "torsion", "slide"]
Indices = NDArray[np.intp]

STEP_S = 0.002
"""Longest integration step."""
STEP_DAMPING_S = 0.004
"""Damping per stiffness of every spring. As the damping is implicit, half a step is stable at any stiffness; four times
that keeps tendons that go slack and taut from chattering."""
SETTLING_S = 0.1
"""Further damping per bending stiffness, so that the body settles and does not swing: friction in joints and holes."""
ARMATURE_SHARE = 0.04
"""What the armature of the joints adds to the inertia of the body bending evenly, ρ L³/20. A thin vertebra has so
little inertia of its own that its stop could not hold it."""
TOUCHING_ARMATURE_SHARE = 0.2
"""With walls around: what weighs more is held by a wall sooner, and it is still 25 ms beside a settling time of 100 ms."""
STOP_SOLREF = (0.004, 1.0)
STOP_SOLIMP = (0.95, 0.99, 0.01, 0.5, 2.0)
"""Stiff stops where the vertebrae meet: MuJoCo's time constant and damping ratio, and its impedance."""
IDEAL_RATIO = 150.0
"""Stiffness of an ideal tendon against the bending stiffness of its section, k r₀² = ratio · EI/ℓ."""
YIELD_RATIO = 2.5
"""A tendon yields at this multiple of its maximum tension: no command makes forces that no drive can hold."""
FEED_STIFFNESS_N_m = 2e5
TWIST_STIFFNESS_Nm_rad = 500.0
HAND_REACH = 3.0
"""Where walls may bend it, a robot that is fed by hand comes out by so many lengths of its active segment at most."""
PASSIVE_LINKS = 6
"""Of the passive body for the active segment's length, where walls may bend it."""
PASSIVE_STIFFNESS = 4.0
"""Of the passive body against the first section, where the description does not say."""
HAND = "hand"
"""The actuator in place of a feed drive, where somebody feeds the robot."""
PASSIVE = -1
"""In place of a section's index for what belongs to the passive body."""
GAUSS = (0.5 - math.sqrt(3) / 6, 0.5 + math.sqrt(3) / 6)


@dataclass(frozen=True, slots=True)
class Spring:
    """An elastic joint: what it does, in which section, and the stretch of backbone whose elasticity it carries."""

    name: str
    does: Action
    section: int
    start_m: float
    end_m: float
    stiffness: float
    """Of the whole stretch [N·m/rad or N/m]."""


@dataclass(frozen=True)
class Chain:
    """The compiled model and where in it things are. `n` springs, `m` tendons."""

    model: mujoco.MjModel
    springs: tuple[Spring, ...]
    joints: Indices
    """(n,) joint of each spring. Every joint has one degree of freedom, so this is its index in `qpos` and `qvel` too."""
    vertebra_sites: Indices
    """Centres of the vertebrae, base first, without the plate at the base."""
    vertebra_bodies: Indices
    passive_sites: Indices
    """Ends of the passive body's links, base first; none in free space."""
    tip_site: int
    tendon_stiffness: Floats
    """(m,) k [N/m], m as `RobotDescription.tendon_names`."""
    tendon_rest: Floats
    """(m,) length of each tendon's path along the straight robot [m]."""
    drive_actuators: Indices
    """(drives,) actuator of each drive; −1 for a tendon that is made of pieces."""
    hand_actuator: int
    """Of the hand that feeds the robot; −1 where none does."""
    longest_m: float
    """Exposed length beyond which the hand cannot feed, for want of a body [m]."""
    pieces: Indices | None
    """(m, sections) actuator that pulls each tendon within each section, −1 beyond its end; None without friction."""
    piece_tendons: Indices | None
    """(m, sections) MuJoCo's tendon of each piece, −1 beyond its end."""


@dataclass(frozen=True, slots=True)
class _Interval:
    """From one vertebra's centre to the next; the gap is what lies between their faces. Arc lengths from the base [m]."""

    section: int
    start_m: float
    end_m: float
    gap: tuple[float, float]

    def along_gap(self, fraction: float) -> float:
        return self.gap[0] + fraction * (self.gap[1] - self.gap[0])


def intervals(description: RobotDescription) -> Iterator[_Interval]:
    """The intervals between the vertebrae, base first; the base itself is a plate like the first section's vertebrae."""
    start, face = 0.0, description.sections[0].vertebra_thickness_m / 2
    for i, section in enumerate(description.sections):
        base, pitch, half = start, section.length_m / section.vertebrae, section.vertebra_thickness_m / 2
        for k in range(1, section.vertebrae + 1):
            end = base + k * pitch
            yield _Interval(i, start, end, (start + face, end - half))
            start, face = end, half


def build_chain(
    description: RobotDescription, kind: Kind, payload_kg: float = 0.0, environment: Environment | None = None
) -> Chain:
    """Generate and compile the model of a robot, and of the walls around it.

    `kind` "default" has the description's tendons and gravity, "ideal" stiff tendons and no gravity.
    """
    builder = _Builder(description, kind, payload_kg, environment)
    spec = builder.build()
    model = spec.compile()
    joints = np.array([model.joint(spring.name).id for spring in builder.springs], dtype=np.intp)
    names = [f"vertebra {k}" for k in range(1, builder.vertebra + 1)]
    sections = range(len(description.sections))

    def found(kind: mujoco.mjtObj, name: str) -> int:
        return mujoco.mj_name2id(model, kind, name)

    def pieces(kind: mujoco.mjtObj) -> Indices:
        rows = [[found(kind, piece_name(name, i)) for i in sections] for name in description.tendon_names]
        return np.array(rows, dtype=np.intp)

    sites = np.array([model.site(name).id for name in names], dtype=np.intp)
    return Chain(
        model=model,
        springs=tuple(builder.springs),
        joints=joints,
        vertebra_sites=sites,
        vertebra_bodies=np.asarray(model.site_bodyid[sites], dtype=np.intp),
        passive_sites=np.array(
            [i for i in range(model.nsite) if model.site(i).name.startswith("passive ")], dtype=np.intp
        ),
        tip_site=model.site("tip").id,
        tendon_stiffness=np.array([builder.tendon_stiffness(name) for name in description.tendon_names]),
        tendon_rest=np.array([builder.rest_length(model, name) for name in description.tendon_names]),
        drive_actuators=np.array(
            [found(mujoco.mjtObj.mjOBJ_ACTUATOR, f"drive {drive.name}") for drive in description.drives], dtype=np.intp
        ),
        hand_actuator=found(mujoco.mjtObj.mjOBJ_ACTUATOR, HAND),
        longest_m=builder.longest_m,
        pieces=pieces(mujoco.mjtObj.mjOBJ_ACTUATOR) if builder.frictional else None,
        piece_tendons=pieces(mujoco.mjtObj.mjOBJ_TENDON) if builder.frictional else None,
    )


def piece_name(tendon: str, section: int) -> str:
    """Of the piece of a tendon within a section, and of what pulls it."""
    return f"{tendon} in {section}"


class _Builder:
    """Walks along the robot and adds bodies, joints and holes to a specification."""

    def __init__(
        self, description: RobotDescription, kind: Kind, payload_kg: float, environment: Environment | None
    ) -> None:
        self.description = description
        self.environment = environment
        self.payload_kg = payload_kg
        self.kind = kind
        self.springs: list[Spring] = []
        self.vertebra = 0
        self._universal_joints = 0
        self._spec = mujoco.MjSpec()
        self._spans: list[tuple[Any, float, float | None]] = []  # body, origin, centre of its vertebra
        self._holes: dict[str, list[tuple[str, int]]] = {name: [] for name in description.tendon_names}
        """Of each tendon, in order: site, and section in which it lies."""
        tendon = description.tendon
        self.frictional = (
            kind == "default"
            and tendon is not None
            and (tendon.hole_friction > 0.0 or tendon.conduit_friction * tendon.conduit_bend_deg > 0.0)
        )
        self._section_starts = [0.0, *accumulate(s.length_m for s in description.sections)]
        joints = sum(s.vertebrae * (2 if s.elongation else 1) for s in description.sections)
        inertia = description.backbone.mass_per_length_kg_m * description.active_length_m**3 / 20
        share = TOUCHING_ARMATURE_SHARE if environment is not None else ARMATURE_SHARE
        self._armature = share * joints * inertia
        self._path_ends = {
            name: self._section_starts[i + 1]
            for name, i in zip(description.tendon_names, description.tendon_section, strict=True)
        }

    def build(self) -> Any:
        self._set_options()
        self._add_base()
        for interval in intervals(self.description):
            self._add_interval(interval)
        self._body.add_site(name="tip", pos=self._at(self.description.active_length_m))
        self._add_masses()
        self._add_tendons()
        for drive in self.description.drives:
            self._add_drive(drive)
        if self.description.hand_fed:
            self._add_servo(HAND, "feed", mujoco.mjtTrn.mjTRN_JOINT, FEED_STIFFNESS_N_m)
        if self.environment is not None:
            self._add_skins()
            add_walls(self._spec, self.environment)
        return self._spec

    def tendon_stiffness(self, name: str) -> float:
        """k of a tendon [N/m]: EA over conduit and path, or stiff against the backbone for the ideal twin."""
        d = self.description
        section = d.sections[d.tendon_section[d.tendon_names.index(name)]]
        if self.kind == "ideal" and section.routing:
            return IDEAL_RATIO * section.bending_stiffness_Nm2 / section.length_m / section.routing.radius_m**2
        return self._tendon.axial_stiffness_N / (self._tendon.conduit_length_m + self._path_ends[name])

    def rest_length(self, model: mujoco.MjModel, name: str) -> float:
        """Of a tendon's path along the straight robot [m]."""
        return float(sum(model.tendon_length0[model.tendon(part).id] for part, _ in self._parts(name)))

    @property
    def longest_m(self) -> float:
        """Exposed length with all of the modelled body outside; in free space the whole robot's [m]."""
        d = self.description
        return d.backbone.total_length_m if self.environment is None else d.active_length_m + self._passive_m

    @property
    def _tendon(self) -> Tendon:
        tendon = self.description.tendon
        if tendon is None:
            raise ValueError(f"{self.description.name}: has tendons, but does not say what they are made of")
        return tendon

    def _set_options(self) -> None:
        option = self._spec.option
        option.timestep = STEP_S
        option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        option.gravity = self.description.backbone.gravity_m_s2 if self.kind == "default" else (0.0, 0.0, 0.0)
        # A bad state must be seen and mended by the twin, not silently replaced by the initial one.
        option.disableflags = mujoco.mjtDisableBit.mjDSBL_AUTORESET
        if self.environment is None:
            option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        self._spec.compiler.autolimits = False
        self._spec.compiler.degree = False

    @property
    def _passive_m(self) -> float:
        """How much of the passive body can come out of the port. In free space it is straight: then none is modelled."""
        d = self.description
        if self.environment is None:
            return 0.0
        by_hand = min(d.backbone.total_length_m, HAND_REACH * d.active_length_m) if d.hand_fed else 0.0
        return max((d.feed.range_m[1] if d.feed else by_hand) - d.active_length_m, 0.0)

    def _add_base(self) -> None:
        d, passive = self.description, self._passive_m
        slides = d.feed is not None or d.hand_fed
        start = (-d.active_length_m if slides else 0.0) - passive
        base = self._spec.worldbody.add_body(name="base", pos=(0.0, 0.0, start))
        if slides:
            base.add_joint(name="feed", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(0.0, 0.0, 1.0))
        if d.twist:
            base.add_joint(name="twist", type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0.0, 0.0, 1.0))
        self._body, self._origin = base, -passive
        self._spans.append((base, -passive, None))
        self._add_passive_body(passive)
        self._add_holes(d.sections[0].vertebra_thickness_m / 2, 0)

    def _add_passive_body(self, length_m: float) -> None:
        """Links between the base and the active segment, with the elasticity of the passive body in between."""
        d = self.description
        links = math.ceil(PASSIVE_LINKS * length_m / d.active_length_m)
        own = d.backbone.passive_bending_stiffness_Nm2
        stiffness = own or PASSIVE_STIFFNESS * d.sections[0].bending_stiffness_Nm2
        for k in range(links):
            stretch = (-length_m + k * length_m / links, -length_m + (k + 1) * length_m / links)
            self._add_body(sum(stretch) / 2)
            for axis in ("bend_x", "bend_y") if k % 2 else ("bend_y", "bend_x"):
                self._add_spring(axis, PASSIVE, stretch, stiffness * links / length_m, math.pi / 4)
            self._body.add_site(name=f"passive {k}", pos=self._at(stretch[1]))

    def _add_interval(self, interval: _Interval) -> None:
        section = self.description.sections[interval.section]
        pitch = interval.end_m - interval.start_m
        torsion = section.torsional_stiffness_Nm2
        if section.elongation:
            middle = (interval.start_m + interval.end_m) / 2
            self._add_bend(interval, GAUSS[0], (interval.start_m, middle))
            self._add_body(interval.along_gap(0.5))
            stretch = (interval.start_m, interval.end_m)
            self._add_spring("slide", interval.section, stretch, section.elongation.stiffness_N_m)
            self._add_spring("torsion", interval.section, stretch, torsion / pitch)
            self._add_bend(interval, GAUSS[1], (middle, interval.end_m))
        else:
            self._add_bend(interval, 0.5, (interval.start_m, interval.end_m))
        self.vertebra += 1
        centre = interval.end_m
        self._spans[-1] = (self._body, self._origin, centre)
        half = section.vertebra_thickness_m / 2
        self._add_holes(centre - half, interval.section)
        if not section.elongation and self._is_middle(interval):
            self._add_body(centre, centre)
            whole = self._section_stretch(interval.section)
            self._add_spring("torsion", interval.section, whole, torsion / section.length_m)
        self._body.add_site(name=f"vertebra {self.vertebra}", pos=self._at(centre))
        self._add_holes(centre + half, interval.section)

    def _section_stretch(self, section: int) -> tuple[float, float]:
        return self._section_starts[section], self._section_starts[section + 1]

    def _is_middle(self, interval: _Interval) -> bool:
        start, end = self._section_stretch(interval.section)
        return interval.start_m < (start + end) / 2 - 1e-9 <= interval.end_m

    def _add_bend(self, interval: _Interval, fraction: float, stretch: tuple[float, float]) -> None:
        self._add_body(interval.along_gap(fraction))
        stiffness = self.description.sections[interval.section].bending_stiffness_Nm2 / (stretch[1] - stretch[0])
        axes: tuple[Action, Action] = ("bend_x", "bend_y")
        for axis in axes if self._universal_joints % 2 else axes[::-1]:
            self._add_spring(axis, interval.section, stretch, stiffness, self._stop(interval))
        self._universal_joints += 1

    def _stop(self, interval: _Interval) -> float:
        """Where the rims of two vertebrae meet [rad]; on the diagonal of the two axes, where their holes meet."""
        half_gap = (interval.gap[1] - interval.gap[0]) / 2
        radii = [s.routing.radius_m for s in self.description.sections if s.routing]
        rims = 2 * math.atan(half_gap / (self.description.backbone.diameter_m / 2))
        return min([rims, *(math.sqrt(2) * math.atan(half_gap / radius) for radius in radii)])

    def _add_body(self, origin: float, vertebra: float | None = None) -> None:
        self._body = self._body.add_body(name=f"body {len(self._spans)}", pos=(0.0, 0.0, origin - self._origin))
        self._origin = origin
        self._spans.append((self._body, origin, vertebra))

    def _add_spring(
        self, does: Action, section: int, stretch: tuple[float, float], stiffness: float, stop: float | None = None
    ) -> None:
        axis = {"bend_x": (0.0, 1.0, 0.0), "bend_y": (-1.0, 0.0, 0.0)}.get(does, (0.0, 0.0, 1.0))
        spring = Spring(f"{does} {len(self.springs)}", does, section, *stretch, stiffness)
        self._body.add_joint(
            name=spring.name,
            type=mujoco.mjtJoint.mjJNT_SLIDE if does == "slide" else mujoco.mjtJoint.mjJNT_HINGE,
            axis=axis,
            stiffness=stiffness,
            damping=stiffness * (SETTLING_S + STEP_DAMPING_S),
            armature=self._armature if stop is not None else 0.0,
            limited=stop is not None,
            range=(-stop, stop) if stop is not None else (0.0, 0.0),
            solref_limit=STOP_SOLREF,
            solimp_limit=STOP_SOLIMP,
        )
        self.springs.append(spring)

    def _at(self, arc_length_m: float) -> tuple[float, float, float]:
        return (0.0, 0.0, arc_length_m - self._origin)

    def _add_holes(self, face_m: float, at: int) -> None:
        """Sites at one face of the present vertebra, of section `at`, for every tendon that reaches it."""
        for section in self.description.sections:
            routing = section.routing
            if routing is None:
                continue
            for name, azimuth_deg in zip(routing.names, routing.azimuths_deg, strict=True):
                if face_m > self._path_ends[name]:
                    continue
                azimuth = math.radians(azimuth_deg)
                site = f"{name} {len(self._holes[name])}"
                x, y = routing.radius_m * math.cos(azimuth), routing.radius_m * math.sin(azimuth)
                self._body.add_site(name=site, pos=(x, y, face_m - self._origin))
                self._holes[name].append((site, at))

    def _add_masses(self) -> None:
        """Each body weighs what its stretch of backbone weighs; the base carries the passive body behind it."""
        backbone = self.description.backbone
        behind = backbone.total_length_m - self.description.active_length_m - self._passive_m
        ends = [*(origin for _, origin, _ in self._spans[1:]), self.description.active_length_m]
        for i, ((body, origin, centre), end) in enumerate(zip(self._spans, ends, strict=True)):
            length = end - origin + (behind if i == 0 else 0.0)
            mass = backbone.mass_per_length_kg_m * length
            across = mass * (3 * (backbone.diameter_m / 2) ** 2 + length**2) / 12
            body.explicitinertial = True
            body.mass = mass
            body.ipos = (0.0, 0.0, ((origin + end) / 2 if centre is None else centre) - origin)
            body.inertia = (across, across, mass * backbone.diameter_m**2 / 8)
        if self.payload_kg:
            point = self.payload_kg * (backbone.diameter_m / 2) ** 2
            tip = self._at(self.description.active_length_m)
            self._body.add_body(
                name="payload", pos=tip, explicitinertial=True, mass=self.payload_kg, inertia=(point, point, point)
            )

    def _add_skins(self) -> None:
        """A capsule along every body, as far as the next begins; the last one's round end is the tip."""
        radius = self.description.backbone.diameter_m / 2
        tip = self.description.active_length_m - radius
        ends = [*(origin for _, origin, _ in self._spans[1:]), tip]
        for (body, origin, _), end in zip(self._spans, ends, strict=True):
            add_skin(body, 0.0, end - origin, radius)

    def _add_tendons(self) -> None:
        for name in self._holes:
            for part, sites in self._parts(name):
                tendon = self._spec.add_tendon(name=part)
                for site in sites:
                    tendon.wrap_site(site)

    def _parts(self, name: str) -> Iterator[tuple[str, list[str]]]:
        """Name and sites of what a tendon is made of: one part, or one in every section if it rubs."""
        holes = self._holes[name]
        if not self.frictional:
            yield name, [site for site, _ in holes]
            return
        for section in range(holes[-1][1] + 1):
            own = [i for i, (_, at) in enumerate(holes) if at == section]
            # It begins where the section before ends.
            yield piece_name(name, section), [site for site, _ in holes[max(own[0] - 1, 0) : own[-1] + 1]]

    def _add_drive(self, drive: Drive) -> None:
        """A drive sets a length, with stiffness and damping; on a tendon it can only pull.

        What a drive does to a tendon that rubs is for `cables.py` to say: its pieces get forces.
        """
        if drive.moves == "tendon" and self.frictional:
            for part, _ in self._parts(str(drive.tendon)):
                self._spec.add_actuator(
                    name=part,
                    target=part,
                    trntype=mujoco.mjtTrn.mjTRN_TENDON,
                    gaintype=mujoco.mjtGain.mjGAIN_FIXED,
                    gainprm=[1.0, *[0.0] * 9],
                    biastype=mujoco.mjtBias.mjBIAS_AFFINE,
                    biasprm=[0.0] * 10,
                    forcelimited=True,
                    forcerange=(-YIELD_RATIO * self._tendon.max_tension_N, 0.0),
                )
            return
        if drive.moves == "tendon":
            stiffness = self.tendon_stiffness(str(drive.tendon))
            weakest = -YIELD_RATIO * self._tendon.max_tension_N
            self._add_servo(f"drive {drive.name}", drive.tendon, mujoco.mjtTrn.mjTRN_TENDON, stiffness, weakest)
        else:
            stiffness = FEED_STIFFNESS_N_m if drive.moves == "feed" else TWIST_STIFFNESS_Nm_rad
            self._add_servo(f"drive {drive.name}", drive.moves, mujoco.mjtTrn.mjTRN_JOINT, stiffness)

    def _add_servo(
        self, name: str, target: str | None, transmission: Any, stiffness: float, weakest: float | None = None
    ) -> None:
        """What sets a length; with `weakest` it can only pull, by that much [N]."""
        self._spec.add_actuator(
            name=name,
            target=target,
            trntype=transmission,
            gaintype=mujoco.mjtGain.mjGAIN_FIXED,
            gainprm=[stiffness, *[0.0] * 9],
            biastype=mujoco.mjtBias.mjBIAS_AFFINE,
            biasprm=[0.0, -stiffness, -stiffness * STEP_DAMPING_S, *[0.0] * 7],
            forcelimited=weakest is not None,
            forcerange=(weakest or 0.0, 0.0),
        )
