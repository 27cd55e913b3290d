"""The calibration in force: the drives' zeros as homing found them, the losses that are compensated, the load cells."""

from dataclasses import fields

import numpy as np

from cobra.control.drivetrain import Drivetrain
from cobra.control.tendon_control import TendonControl
from cobra.mechanics.losses import Losses
from cobra.messages import Calibration, CellScale, DriveCalibration
from cobra.motors.calibration import Calibration as Kept


def calibration_of(
    stamp_s: float, homed: bool, drivetrain: Drivetrain, tendons: TendonControl, kept: Kept | None
) -> Calibration:
    """What the robot goes by from `stamp_s` on [s, robot's clock]; `kept`: what commissioning found out."""
    kept = kept or Kept(robot=drivetrain.description.name)
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
        version=kept.version,
        serial=kept.serial,
        date=kept.date,
        by=kept.by,
        cells={name: CellScale(gain=cell.gain, offset_N=cell.offset_N) for name, cell in kept.cells.items()},
    )


def _numbers(losses: Losses) -> dict[str, float | tuple[float, ...]]:
    values = {field.name: getattr(losses, field.name) for field in fields(Losses)}
    return {name: float(value) if np.ndim(value) == 0 else tuple(value.tolist()) for name, value in values.items()}
