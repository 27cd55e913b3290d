"""From a robot's description to the numbers of its equations of motion, for robots that are a chain of chambers."""

from cobra.description import RobotDescription
from cobra.errors import OperatorError
from cobra.mechanics.chain import SrcBotParameters


def is_chain(description: RobotDescription) -> bool:
    """Whether the robot is a chain of chambers whose equations of motion are known."""
    return not _reasons(description)


def parameters_of(description: RobotDescription) -> SrcBotParameters:
    """The numbers of a robot that is a chain of equal chambers on a base that stands still.

    Raises:
        OperatorError: it is another kind of robot, or what the motion takes is not described.
    """
    if reasons := _reasons(description):
        raise OperatorError(f"{description.name}: has no equations of motion: {reasons[0]}")
    section, tendon = description.sections[0], description.tendon
    assert section.routing
    assert section.elongation
    assert section.elongation.dynamics
    assert tendon
    elongation, dynamics = section.elongation, section.elongation.dynamics
    pitch = section.length_m / section.vertebrae
    return SrcBotParameters(
        segments=section.vertebrae,
        rest_length_m=pitch,
        cable_circle_diameter_m=2.0 * section.routing.radius_m,
        cable_azimuths_deg=section.routing.azimuths_deg,
        bending_stiffness_Nm2=section.bending_stiffness_Nm2,
        torsional_stiffness_Nm2=section.torsional_stiffness_Nm2,
        axial_stiffness_N_m=elongation.stiffness_N_m,
        guider_mass_kg=description.backbone.mass_per_length_kg_m * pitch,
        guider_inertia_bend_kgm2=dynamics.guider_inertia_bend_kgm2,
        guider_inertia_twist_kgm2=dynamics.guider_inertia_twist_kgm2,
        damping_bend_Nms=dynamics.damping_bend_Nms,
        damping_twist_Nms=dynamics.damping_twist_Nms,
        damping_axial_Ns_m=dynamics.damping_axial_Ns_m,
        # η of S-36 and a capstan's μ agree to first order in the bend.
        friction=tendon.hole_friction,
        cable_stiffness_N_m=tendon.axial_stiffness_N / (tendon.conduit_length_m + section.length_m),
        locked_length_m=elongation.locked_length_m,
        unlocked_length_m=elongation.unlocked_length_m,
        lock_bend_deg=elongation.lock_bend_deg,
        gravity_m_s2=description.backbone.gravity_m_s2,
    )


def _reasons(description: RobotDescription) -> list[str]:
    d = description
    out = []
    if len(d.sections) != 1 or d.sections[0].elongation is None:
        out.append("only a robot of one section whose chambers change their length has them, as src-bot")
    elif d.sections[0].routing is None or d.tendon is None:
        out.append("it has no tendons")
    elif d.sections[0].elongation.dynamics is None:
        out.append("sections[0].elongation.dynamics is missing: inertias and damping must be given")
    if d.twist or d.feed or d.hand_fed:
        out.append("its base must stand still: without [twist], [feed] and hand_fed")
    return out
