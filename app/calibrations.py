"""Where the calibrations of a robot are kept."""

from app import places
from cobra.description import RobotDescription
from cobra.motors.calibration import CalibrationBook


def calibrations(description: RobotDescription) -> CalibrationBook:
    """The calibrations of a robot, each serial its own."""
    name = f"{description.name}-{description.serial}" if description.serial else description.name
    return CalibrationBook(description, places.data_folder() / "calibration" / name)
