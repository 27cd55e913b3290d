"""Robots for the calibration's tests: described as a user would, without knowing their true parameters."""

from cobra.description import (
    Backbone,
    Bus,
    Drive,
    Motor,
    RobotDescription,
    Routing,
    Section,
    Teleop,
    Tendon,
)


def described(
    name: str,
    *,
    lengths_m: tuple[float, ...],
    azimuths_deg: tuple[tuple[float, ...], ...],
    radius_m: float,
    bending_stiffness_Nm2: float,
    axial_stiffness_N: float,
    conduit_length_m: float,
    vertebrae: int = 6,
) -> RobotDescription:
    """A robot with one routing a section; whatever the calibration does not use is plausible."""
    sections = tuple(
        Section(
            name=f"s{i + 1}",
            length_m=length,
            max_bend_deg=120.0,
            vertebrae=vertebrae,
            vertebra_thickness_m=0.003,
            bending_stiffness_Nm2=bending_stiffness_Nm2,
            torsional_stiffness_Nm2=0.01,
            routing=Routing(
                names=tuple(f"t{i + 1}{j + 1}" for j in range(len(azimuths))), azimuths_deg=azimuths, radius_m=radius_m
            ),
        )
        for i, (length, azimuths) in enumerate(zip(lengths_m, azimuths_deg, strict=True))
    )
    tendons = [tendon for section in sections if section.routing for tendon in section.routing.names]
    return RobotDescription(
        name=name,
        title=name,
        backbone=Backbone(total_length_m=1.0, diameter_m=3.0 * radius_m, mass_per_length_kg_m=0.02),
        sections=sections,
        tendon=Tendon(
            axial_stiffness_N=axial_stiffness_N,
            conduit_length_m=conduit_length_m,
            diameter_m=0.0003,
            pretension_N=2.0,
            min_tension_N=0.2,
            max_tension_N=60.0,
        ),
        motors=(
            Motor(
                name="servo",
                protocol="rmd-v1",
                gear_ratio=9.0,
                torque_constant_Nm_A=0.25,
                current_per_count_A=0.002,
                encoder_bits=14,
                max_speed_rad_s=8.0,
                max_acceleration_rad_s2=80.0,
                max_current_A=4.0,
                back_drive_torque_Nm=0.02,
                max_temperature_C=80.0,
                min_voltage_V=20.0,
                max_voltage_V=52.0,
            ),
        ),
        drives=tuple(
            Drive(
                name=tendon,
                moves="tendon",
                tendon=tendon,
                motor="servo",
                bus="main",
                address=i + 1,
                spool_radius_m=0.01,
                travel_range=(-0.05, 0.05),
            )
            for i, tendon in enumerate(tendons)
        ),
        buses=(Bus(name="main", interface="virtual", channel="calibration"),),
        teleop=Teleop(bend_rate_deg_s=30.0, bend_acceleration_deg_s2=120.0),
    )
