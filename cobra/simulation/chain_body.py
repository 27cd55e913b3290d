"""The body of a robot's MuJoCo model: vertebrae on elastic joints from base to tip, their masses, holes and skin."""

import math
from itertools import accumulate
from typing import Any

import mujoco

from cobra.description import RobotDescription
from cobra.simulation.chain_parts import PASSIVE, SETTLING_S, STEP_DAMPING_S, Action, Interval, Spring, intervals
from cobra.simulation.contacts import add_skin

ARMATURE_SHARE = 0.04
"""What the armature of the joints adds to the inertia of the body bending evenly, ρ L³/20. A thin vertebra has so
little inertia of its own that its stop could not hold it."""
TOUCHING_ARMATURE_SHARE = 0.2
"""With walls around: what weighs more is held by a wall sooner, and it is still 25 ms beside a settling time of 100 ms."""
STOP_SOLREF = (0.004, 1.0)
STOP_SOLIMP = (0.95, 0.99, 0.01, 0.5, 2.0)
"""Stiff stops where the vertebrae meet: MuJoCo's time constant and damping ratio, and its impedance."""
HAND_REACH = 3.0
"""Where walls may bend it, a robot that is fed by hand comes out by so many lengths of its active segment at most."""
PASSIVE_LINKS = 6
"""Of the passive body for the active segment's length, where walls may bend it."""
PASSIVE_STIFFNESS = 4.0
"""Of the passive body against the first section, where the description does not say."""
GAUSS = (0.5 - math.sqrt(3) / 6, 0.5 + math.sqrt(3) / 6)


class ChainBody:
    """Walks along the robot and adds bodies, joints and holes to a specification."""

    def __init__(self, description: RobotDescription, spec: Any, payload_kg: float, walled: bool) -> None:
        """`walled`: with walls around, which the skin touches and the passive body bends between."""
        self.description = description
        self.springs: list[Spring] = []
        self.vertebrae = 0
        self.holes: dict[str, list[tuple[str, int]]] = {name: [] for name in description.tendon_names}
        """Of each tendon, in order: site, and section in which it lies."""
        self._payload_kg = payload_kg
        self._walled = walled
        self._universal_joints = 0
        self._spec = spec
        self._spans: list[tuple[Any, float, float | None]] = []  # body, origin, centre of its vertebra
        self._section_starts = [0.0, *accumulate(s.length_m for s in description.sections)]
        joints = sum(s.vertebrae * (2 if s.elongation else 1) for s in description.sections)
        inertia = description.backbone.mass_per_length_kg_m * description.active_length_m**3 / 20
        self._armature = (TOUCHING_ARMATURE_SHARE if walled else ARMATURE_SHARE) * joints * inertia
        self.path_ends = {
            name: self._section_starts[i + 1]
            for name, i in zip(description.tendon_names, description.tendon_section, strict=True)
        }
        """Of each tendon: arc length where it is fixed [m]."""

    def build(self) -> None:
        """Add all of it."""
        self._add_base()
        for interval in intervals(self.description):
            self._add_interval(interval)
        self._body.add_site(name="tip", pos=self._at(self.description.active_length_m))
        self._add_masses()
        if self._walled:
            self._add_skins()

    @property
    def longest_m(self) -> float:
        """Exposed length with all of the modelled body outside; in free space the whole robot's [m]."""
        d = self.description
        return d.backbone.total_length_m if not self._walled else d.active_length_m + self._passive_m

    @property
    def _passive_m(self) -> float:
        """How much of the passive body can come out of the port. In free space it is straight: then none is modelled."""
        d = self.description
        if not self._walled:
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

    def _add_interval(self, interval: Interval) -> None:
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
        self.vertebrae += 1
        centre = interval.end_m
        self._spans[-1] = (self._body, self._origin, centre)
        half = section.vertebra_thickness_m / 2
        self._add_holes(centre - half, interval.section)
        if not section.elongation and self._is_middle(interval):
            self._add_body(centre, centre)
            whole = self._section_stretch(interval.section)
            self._add_spring("torsion", interval.section, whole, torsion / section.length_m)
        self._body.add_site(name=f"vertebra {self.vertebrae}", pos=self._at(centre))
        self._add_holes(centre + half, interval.section)

    def _section_stretch(self, section: int) -> tuple[float, float]:
        return self._section_starts[section], self._section_starts[section + 1]

    def _is_middle(self, interval: Interval) -> bool:
        start, end = self._section_stretch(interval.section)
        return interval.start_m < (start + end) / 2 - 1e-9 <= interval.end_m

    def _add_bend(self, interval: Interval, fraction: float, stretch: tuple[float, float]) -> None:
        self._add_body(interval.along_gap(fraction))
        stiffness = self.description.sections[interval.section].bending_stiffness_Nm2 / (stretch[1] - stretch[0])
        axes: tuple[Action, Action] = ("bend_x", "bend_y")
        for axis in axes if self._universal_joints % 2 else axes[::-1]:
            self._add_spring(axis, interval.section, stretch, stiffness, self._stop(interval))
        self._universal_joints += 1

    def _stop(self, interval: Interval) -> float:
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
                if face_m > self.path_ends[name]:
                    continue
                azimuth = math.radians(azimuth_deg)
                site = f"{name} {len(self.holes[name])}"
                x, y = routing.radius_m * math.cos(azimuth), routing.radius_m * math.sin(azimuth)
                self._body.add_site(name=site, pos=(x, y, face_m - self._origin))
                self.holes[name].append((site, at))

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
        if self._payload_kg:
            point = self._payload_kg * (backbone.diameter_m / 2) ** 2
            tip = self._at(self.description.active_length_m)
            self._body.add_body(
                name="payload", pos=tip, explicitinertial=True, mass=self._payload_kg, inertia=(point, point, point)
            )

    def _add_skins(self) -> None:
        """A capsule along every body, as far as the next begins; the last one's round end is the tip."""
        radius = self.description.backbone.diameter_m / 2
        tip = self.description.active_length_m - radius
        ends = [*(origin for _, origin, _ in self._spans[1:]), tip]
        for (body, origin, _), end in zip(self._spans, ends, strict=True):
            add_skin(body, 0.0, end - origin, radius)
