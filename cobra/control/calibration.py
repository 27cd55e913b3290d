"""The calibration in force: where homing found the drives' zeros, and the numbers that the tendons are compensated with."""

from dataclasses import fields

import numpy as np

from cobra.control.drivetrain import Drivetrain
from cobra.control.tendon_control import TendonControl
from cobra.mechanics.losses import Losses
from cobra.messages import Calibration, DriveCalibration


def calibration_of(stamp_s: float, homed: bool, drivetrain: Drivetrain, tendons: TendonControl) -> Calibration:
    """What the robot goes by from `stamp_s` on [s, robot's clock]."""
    transmission = drivetrain.transmission
    zero = transmission.angle(np.zeros(len(drivetrain.description.drives)))
    scales = zip(transmission.travel_per_rad.tolist(), transmission.load_per_A.tolist(), zero.tolist(), strict=True)
    identified = tendons.identified if tendons.available else None
    return Calibration(
        stamp=stamp_s,
        homed=homed,
        drives={
            drive.name: DriveCalibration(travel_per_rad=travel, load_per_A=load, zero_rad=angle if homed else None)
            for drive, (travel, load, angle) in zip(drivetrain.description.drives, scales, strict=True)
        },
        source=identified.source if identified else "",
        losses=_numbers(identified.losses) if identified else {},
        deviation=_numbers(identified.deviation) if identified else {},
    )


def _numbers(losses: Losses) -> dict[str, float | tuple[float, ...]]:
    values = {field.name: getattr(losses, field.name) for field in fields(Losses)}
    return {name: float(value) if np.ndim(value) == 0 else tuple(value.tolist()) for name, value in values.items()}
