"""The description of a robot, as types: everything that differs between robots. `loading.py` reads it from TOML.

Units stand in the keys. The file speaks degrees where people do; the properties that code uses speak radians.
"""

import math
from functools import cached_property
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

Positive = Annotated[float, Meta(gt=0)]
NonNegative = Annotated[float, Meta(ge=0)]
Name = Annotated[str, Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$", max_length=40)]
Range = tuple[float, float]
Vector = tuple[float, float, float]
Protocol = Literal["rmd-v1", "rmd-v3", "cia402"]


class _Part(msgspec.Struct, frozen=True, forbid_unknown_fields=True, dict=True):
    """Base of every table of a description: an unknown key is an error, not a silent default."""


class Backbone(_Part, frozen=True, kw_only=True):
    """The whole body, from the actuation pack to the tip."""

    total_length_m: Positive
    diameter_m: Positive
    mass_per_length_kg_m: Positive
    passive_bending_stiffness_Nm2: Positive | None = None
    """Of the body behind the sections; by default four times the first section's."""
    gravity_m_s2: Vector = (0.0, 9.81, 0.0)
    """In the fixed frame of the entry port (x right, y down, z forward)."""


class Routing(_Part, frozen=True, kw_only=True):
    """The tendons that end at a section, and where their holes are."""

    names: Annotated[tuple[Name, ...], Meta(min_length=3)]
    azimuths_deg: tuple[float, ...]
    """From +x towards +y: E = 0, S = 90, W = 180, N = 270."""
    radius_m: Positive


class ChamberDynamics(_Part, frozen=True, kw_only=True):
    """What the motion of a chain of chambers takes besides stiffness and mass (MODEL 4)."""

    guider_inertia_bend_kgm2: Positive
    """J_θ, about the guider's diameters."""
    guider_inertia_twist_kgm2: Positive
    """J_φ, about its axis."""
    damping_bend_Nms: NonNegative
    """Of one chamber, as the others."""
    damping_twist_Nms: NonNegative
    damping_axial_Ns_m: NonNegative


class Elongation(_Part, frozen=True, kw_only=True):
    """A section whose backbone can change its length: a chamber before each vertebra (SRC-Bot's guiders).

    Pulled together to the locked length the guiders catch in each other's slots, and the section is rigid.
    """

    range_m: Range
    """Of the whole section."""
    stiffness_N_m: Positive
    """Of one chamber, S-38."""
    rate_m_s: Positive
    acceleration_m_s2: Positive
    locked_length_m: Positive
    """Of one chamber: its guiders touch."""
    unlocked_length_m: Positive
    """Of one chamber: the slots let go."""
    lock_bend_deg: NonNegative = 2.0
    """Of one chamber: bent further, its guiders touch without catching."""
    dynamics: ChamberDynamics | None = None
    """For a plant made of the equations of motion; without it there is only the MuJoCo twin."""


class Section(_Part, frozen=True, kw_only=True):
    """One section of constant curvature. Without a routing it is passive: elastic, bent only by what acts on it."""

    name: Name
    length_m: Positive
    max_bend_deg: Positive
    vertebrae: Annotated[int, Meta(ge=2, le=60)]
    vertebra_thickness_m: Positive
    bending_stiffness_Nm2: Positive
    torsional_stiffness_Nm2: Positive
    routing: Routing | None = None
    elongation: Elongation | None = None

    @property
    def active(self) -> bool:
        return self.routing is not None

    @property
    def max_bend_rad(self) -> float:
        return math.radians(self.max_bend_deg)

    @property
    def locked_length_m(self) -> float | None:
        """Length of the whole section when all its guiders touch [m]; None when it cannot change its length."""
        return self.vertebrae * self.elongation.locked_length_m if self.elongation else None

    @property
    def max_curvature_1_m(self) -> float:
        """κ_max: the bend limit over the whole length [1/m]."""
        return self.max_bend_rad / self.length_m


class Twist(_Part, frozen=True, kw_only=True):
    """Rotation of the base about the backbone."""

    range_deg: Range
    rate_deg_s: Positive
    acceleration_deg_s2: Positive

    @property
    def range_rad(self) -> Range:
        return (math.radians(self.range_deg[0]), math.radians(self.range_deg[1]))


class Feed(_Part, frozen=True, kw_only=True):
    """Exposed backbone length beyond the entry port."""

    range_m: Range
    start_m: NonNegative
    rate_m_s: Positive
    acceleration_m_s2: Positive


class Tendon(_Part, frozen=True, kw_only=True):
    """The tendons' material and the tensions they may carry."""

    axial_stiffness_N: Positive
    """EA."""
    conduit_length_m: NonNegative
    """Free length between the drive and the base of the active segment."""
    diameter_m: Positive
    pretension_N: Positive
    min_tension_N: NonNegative
    max_tension_N: Positive
    hole_friction: NonNegative = 0.0
    """Coulomb's μ between tendon and vertebrae: a section bent by θ takes the factor exp(−μ θ) of the tension."""
    conduit_friction: NonNegative = 0.0
    """μ between tendon and conduit."""
    conduit_bend_deg: NonNegative = 0.0
    """All the bends between the drive and the active segment together, whatever their direction."""

    dither_share: Annotated[float, Meta(gt=0, le=0.8)] = 0.4
    """Homing: the tendons are pulled to and fro by so much of the pretension, until friction favours none."""
    dither_cycles: Annotated[int, Meta(ge=0, le=20)] = 5
    """How often; 0 leaves that out. Where nothing rubs along the tendons, it is left out too."""

    @property
    def conduit_bend_rad(self) -> float:
        return math.radians(self.conduit_bend_deg)

    @property
    def youngs_modulus_Pa(self) -> float:
        """EA over the cross-section."""
        return self.axial_stiffness_N / (math.pi * self.diameter_m**2 / 4)


class Compensation(_Part, frozen=True, kw_only=True):
    """Stretch, friction and lost motion of the tendons taken out of what the drives are told."""

    enabled: bool = True
    parameters: str = ""
    """File that `cobra-teleop identify friction` wrote, beside this one; without one the description's numbers are taken."""
    admittance_rad_s_Nm: NonNegative = 0.0
    """The robot gives way when it is pushed, while it is driven: how fast a section bends per moment from outside. 0 holds against it."""
    admittance_from_Nm: NonNegative = 0.016
    """What is less may be the tendons' friction and no push."""


class Motor(_Part, frozen=True, kw_only=True):
    """A type of drive: protocol, gear, scales and limits, all at the output shaft unless said otherwise."""

    name: Name
    protocol: Protocol
    gear_ratio: Positive
    torque_constant_Nm_A: Positive
    current_per_count_A: Positive
    encoder_bits: Annotated[int, Meta(ge=8, le=24)]
    max_speed_rad_s: Positive
    max_acceleration_rad_s2: Positive
    max_current_A: Positive
    back_drive_torque_Nm: NonNegative
    backlash_deg: NonNegative = 0.0
    """Lost motion on a reversal between the encoder and what is driven, at the output shaft; the load is felt throughout."""
    max_temperature_C: Positive
    min_voltage_V: Positive
    max_voltage_V: Positive


class Drive(_Part, frozen=True, kw_only=True):
    """One motor and what it moves: a tendon by name, the twist, or the feed."""

    name: Name
    moves: Literal["tendon", "twist", "feed"]
    tendon: str | None = None
    motor: Name
    bus: Name
    address: Annotated[int, Meta(ge=1, le=127)]
    spool_radius_m: Positive | None = None
    """Tendon and feed: metres per radian of the output shaft."""
    reduction: Positive | None = None
    """Twist: turns of the output shaft for a turn of the robot."""
    spool_runout_m: NonNegative = 0.0
    """Eccentricity of the spool: travel errs by up to this much, once a turn."""
    winds_over: bool = False
    """The tendon winds up on top of itself: the spool's radius grows by the tendon's diameter with every turn."""
    direction: Literal[1, -1] = 1
    """+1: a positive angle pays the tendon out, feeds in, or twists to the right."""
    travel_range: Range
    """Allowed travel from the reference: m of tendon paid out (wound in is negative), m of feed, degrees of twist."""

    @property
    def travel_per_rad(self) -> float:
        """Travel of the driven part per radian of the output shaft, signed: m/rad, or rad/rad for the twist."""
        scale = 1.0 / self.reduction if self.reduction is not None else self.spool_radius_m or 0.0
        return self.direction * scale

    @property
    def travel_limits(self) -> Range:
        """travel_range in m or rad."""
        low, high = self.travel_range
        return (math.radians(low), math.radians(high)) if self.moves == "twist" else (low, high)


class LoadCell(_Part, frozen=True, kw_only=True):
    """A load cell that measures one tendon's tension beside its drive and sends it on the bus by itself."""

    tendon: Name
    bus: Name
    frame_id: Annotated[int, Meta(ge=1, le=0x7FF)]
    """Standard CAN identifier. Several cells may share a frame, at different bytes."""
    byte_offset: Annotated[int, Meta(ge=0, le=7)] = 0
    type: Literal["i16le", "i16be", "u16le", "u16be", "i32le", "i32be", "f32le", "f32be"] = "i16le"
    scale_N: Positive
    """Newtons per count; 1 for a float in newtons."""
    rate_Hz: Annotated[float, Meta(gt=0, le=1000)]
    noise_N: NonNegative = 0.0
    """Standard deviation of a reading."""
    bias_N: NonNegative = 0.0
    """Largest offset of a reading; taring takes it off."""
    limit_N: Positive | None = None
    """A reading from here on is saturated; without it, one at the end of its type."""

    @property
    def size(self) -> int:
        """Bytes of its reading."""
        return 2 if "16" in self.type else 4


class Bus(_Part, frozen=True, kw_only=True):
    """One CAN channel, as python-can opens it."""

    name: Name
    interface: str
    channel: str
    bitrate: Annotated[int, Meta(ge=10_000, le=1_000_000)] = 1_000_000
    options: dict[str, Any] = {}


Weights = tuple[NonNegative, NonNegative, NonNegative]


class TipDrive(_Part, frozen=True, kw_only=True):
    """Tip mode. Weights: how much right, down and ahead count when not everything can be had; 0 leaves one free."""

    speed_m_s: Positive | None = None
    """Of the tip under a full stick; by default half of what the whole active segment would sweep as one stiff link."""
    place_weights: Weights = (1.0, 1.0, 1.0)
    """Of the tip's place, in shares of `speed_m_s`."""
    view_weights: Weights | None = None
    """Of turning about the same axes, in shares of the twist's rate; by default only the roll, where a drive twists."""


class Teleop(_Part, frozen=True, kw_only=True):
    """How fast the sticks drive, and the steps of the speed switch."""

    bend_rate_deg_s: Positive
    bend_acceleration_deg_s2: Positive
    speed_levels: Annotated[tuple[Annotated[float, Meta(gt=0, le=1)], ...], Meta(min_length=1)] = (0.25, 0.5, 1.0)
    loop_rate_Hz: Annotated[float, Meta(ge=10, le=1000)] = 100.0
    tip: TipDrive = TipDrive()
    final_action: Literal["hold", "slack", "off"] = "hold"
    """What an orphaned robot does after 60 s: stay on hold, pay the tendons out, or switch the drives off."""


class Provenance(_Part, frozen=True, kw_only=True):
    """Where numbers come from. Every number not listed here is assumed."""

    source: str = ""
    given: dict[str, str] = {}
    """Key path → where it is stated."""


class RobotDescription(_Part, frozen=True, kw_only=True):
    """A robot, complete: load it with `cobra.loading.load_description`."""

    name: Name
    title: str
    summary: str = ""
    serial: str = ""
    """Of this very robot, where there are several alike: a calibration of another serial is not used."""
    backbone: Backbone
    sections: Annotated[tuple[Section, ...], Meta(min_length=1)]
    tendon: Tendon | None = None
    compensation: Compensation | None = None
    twist: Twist | None = None
    feed: Feed | None = None
    hand_fed: bool = False
    """Somebody pushes it in and pulls it out by hand, and tells the exposed length. Else, without `feed`, it is fixed."""
    motors: Annotated[tuple[Motor, ...], Meta(min_length=1)]
    drives: Annotated[tuple[Drive, ...], Meta(min_length=1)]
    load_cells: tuple[LoadCell, ...] = ()
    buses: Annotated[tuple[Bus, ...], Meta(min_length=1)]
    teleop: Teleop
    provenance: Provenance = Provenance()

    @cached_property
    def active_length_m(self) -> float:
        """L_active: the sections together, active and passive [m]."""
        return sum(section.length_m for section in self.sections)

    @cached_property
    def active_sections(self) -> tuple[int, ...]:
        """Indices of the sections that have tendons of their own."""
        return tuple(i for i, section in enumerate(self.sections) if section.active)

    @cached_property
    def tendon_names(self) -> tuple[str, ...]:
        """All tendons, base section first, in the order of their sections' routings."""
        return tuple(name for section in self.sections if section.routing for name in section.routing.names)

    @cached_property
    def tendon_section(self) -> tuple[int, ...]:
        """For each tendon the index of the section in which it ends."""
        return tuple(i for i, section in enumerate(self.sections) if section.routing for _ in section.routing.names)

    @cached_property
    def tendon_drives(self) -> tuple[int, ...]:
        """For each tendon the index of the drive that pulls it."""
        index = {drive.tendon: i for i, drive in enumerate(self.drives) if drive.moves == "tendon"}
        return tuple(index[name] for name in self.tendon_names)

    @cached_property
    def twist_drive(self) -> int | None:
        return next((i for i, drive in enumerate(self.drives) if drive.moves == "twist"), None)

    @cached_property
    def feed_drive(self) -> int | None:
        return next((i for i, drive in enumerate(self.drives) if drive.moves == "feed"), None)

    def motor_of(self, drive: Drive) -> Motor:
        return next(motor for motor in self.motors if motor.name == drive.motor)
