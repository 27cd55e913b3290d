"""What a robot loses on the way from the motor to the tip, drawn by seed: the twin is never the robot that the controller knows."""

from typing import Any, Final, Literal

import numpy as np
from msgspec.structs import replace

from cobra.description import RobotDescription, Section

Losses = Literal["seeded", "nominal", "off"]

SPREAD: Final = 0.3
"""Each number is drawn within ±30 % of the description's."""
WIDEST_ROUTING: Final = 0.95
"""Of the body's radius: holes must stay inside it."""


def with_losses(description: RobotDescription, losses: Losses, seed: int) -> RobotDescription:
    """The robot that the twin really is: as described, without friction and lost motion, or drawn by `seed`."""
    match losses:
        case "nominal":
            return description
        case "off":
            return _lossless(description)
        case "seeded":
            return _drawn(description, np.random.default_rng([seed, 0xC0B8A]))


def _lossless(d: RobotDescription) -> RobotDescription:
    """Without friction, backlash and spool effects. Tendons still stretch."""
    return replace(
        d,
        tendon=replace(d.tendon, hole_friction=0.0, conduit_friction=0.0) if d.tendon else None,
        motors=tuple(replace(motor, backlash_deg=0.0) for motor in d.motors),
        drives=tuple(replace(drive, spool_runout_m=0.0, winds_over=False) for drive in d.drives),
    )


def _drawn(d: RobotDescription, rng: np.random.Generator) -> RobotDescription:
    def vary(part: Any, *names: str) -> Any:
        return replace(part, **{name: getattr(part, name) * rng.uniform(1 - SPREAD, 1 + SPREAD) for name in names})

    def vary_section(section: Section) -> Section:
        section = vary(section, "bending_stiffness_Nm2", "torsional_stiffness_Nm2")
        if section.routing is None:
            return section
        routing = vary(section.routing, "radius_m")
        radius = min(routing.radius_m, WIDEST_ROUTING * d.backbone.diameter_m / 2)
        return replace(section, routing=replace(routing, radius_m=radius))

    return replace(
        d,
        sections=tuple(vary_section(section) for section in d.sections),
        tendon=vary(d.tendon, "axial_stiffness_N", "hole_friction", "conduit_friction") if d.tendon else None,
        motors=tuple(vary(motor, "backlash_deg", "back_drive_torque_Nm") for motor in d.motors),
        drives=tuple(vary(drive, "spool_runout_m") for drive in d.drives),
    )
