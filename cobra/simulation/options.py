"""How a robot is simulated: what the options of the simulated drives say together."""

from dataclasses import dataclass, fields
from typing import Any, Final, Literal, get_args

from msgspec.structs import replace

from cobra.description import Compensation, RobotDescription
from cobra.errors import OperatorError
from cobra.mechanics.described import parameters_of
from cobra.simulation.losses import Losses, with_losses

TwinKind = Literal["default", "ideal", "dynamics", "none"]
ENVIRONMENTS: Final = ("free", "straight-pipe", "bent-pipe", "engine-stage")
"""Worlds that are made to a robot's measure."""
MESH_ENDINGS: Final = (".stl", ".obj", ".glb")
NOWHERE_ELSE: Final = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
MAX_PAYLOAD: Final = 2.0
"""Of the active segment's own mass: more would fold it."""


class SimulationError(OperatorError):
    """Options that cannot be. The message names the option, what was given, and what is allowed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Simulation:
    """What is simulated, and where."""

    twin: TwinKind = "default"
    losses: Losses = "off"
    """Of the default twin."""
    seed: int = 0
    """Of the losses, the drives' positions at power-up and the tendons' slack."""
    world: str = "free"
    """One of `ENVIRONMENTS`, or a mesh file."""
    world_scale: float = 1.0
    """Metres per unit of the mesh file."""
    world_pose: tuple[float, ...] = NOWHERE_ELSE
    """Of the mesh file, in the frame of the port: x, y, z [m], and turns about x, y, z [degrees]."""
    payload_kg: float = 0.0
    """At the tip, and unknown to the robot's controller."""
    gravity_m_s2: tuple[float, ...] | None = None
    """As the robot is really mounted; as described by default."""

    def __post_init__(self) -> None:
        for name, kinds in (("twin", TwinKind), ("losses", Losses)):
            if getattr(self, name) not in get_args(kinds):
                raise SimulationError(f"{name} = {getattr(self, name)!r}: must be one of {', '.join(get_args(kinds))}")
        if self.world not in ENVIRONMENTS and not self.world.lower().endswith(MESH_ENDINGS):
            raise SimulationError(
                f"world = {self.world!r}: must be one of {', '.join(ENVIRONMENTS)}, or a mesh file ending in "
                f"{', '.join(MESH_ENDINGS)}"
            )
        if self.twin == "dynamics" and (self.world != "free" or self.payload_kg):
            raise SimulationError(
                "twin = 'dynamics': the equations of motion know no walls and no payload; leave out world and payload, "
                "or take the default twin"
            )
        if self.gravity_m_s2 is not None and not (
            len(self.gravity_m_s2) == 3 and sum(g * g for g in self.gravity_m_s2) < 20.0**2
        ):
            raise SimulationError(f"gravity = {self.gravity_m_s2}: must be three numbers, together less than 20 m/s²")

    def bus_options(self) -> dict[str, Any]:
        """What to open simulated drives with, for this simulation."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def true(self, description: RobotDescription) -> RobotDescription:
        """The robot that is simulated, where its drivers believe in `description`.

        Raises:
            SimulationError: the payload is none that the robot could carry.
        """
        own = description.backbone.mass_per_length_kg_m * description.active_length_m
        if not 0.0 <= self.payload_kg <= MAX_PAYLOAD * own:
            raise SimulationError(
                f"payload = {self.payload_kg:g} kg: must be 0 to {MAX_PAYLOAD * own:.3g} kg, "
                f"{MAX_PAYLOAD:g} times the weight of the active segment"
            )
        if self.twin == "dynamics":
            try:
                parameters_of(description)
            except OperatorError as error:
                raise SimulationError(f"twin = 'dynamics': {error}") from None
        # The ideal twin is ideal, and without a twin there is nothing to lose.
        true = with_losses(description, self.losses if self.twin == "default" else "off", self.seed)
        if self.gravity_m_s2 is None:
            return true
        return replace(true, backbone=replace(true.backbone, gravity_m_s2=self.gravity_m_s2))

    def told(self, description: RobotDescription) -> RobotDescription:
        """The robot that its drivers believe in: they know how it is mounted, and of losses that are switched off."""
        if self.losses == "off" or self.twin != "default":
            description = with_losses(description, "off", self.seed)
        if self.twin in ("ideal", "none"):
            description = replace(description, compensation=Compensation(enabled=False))
        if self.gravity_m_s2 is None:
            return description
        return replace(description, backbone=replace(description.backbone, gravity_m_s2=self.gravity_m_s2))


AS_DESCRIBED: Final = Simulation()
"""What is simulated where nothing else is said."""
