"""Recordings on disk, for the calibration's tests: a synthetic one, and where the real one is."""

import csv
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cobra.description import RobotDescription
from tests.calibration_robots import described
from tests.tendon_robots import TendonRobot, Told, recording, two_sections

AZIMUTHS_DEG = ((0.0, 90.0, 180.0, 270.0), (20.0, 140.0, 260.0))
INTERVAL_S = 0.5
REAL_ROBOT = Path(__file__).parents[1] / "docs" / "opencr-v4"


def nominal_robot() -> RobotDescription:
    """The two-section robot as its builder believes it to be."""
    return described(
        "two",
        lengths_m=(0.30, 0.25),
        azimuths_deg=AZIMUTHS_DEG,
        radius_m=0.02,
        bending_stiffness_Nm2=0.3,
        axial_stiffness_N=5000.0,
        conduit_length_m=0.3,
    )


def told(robot: TendonRobot, rng: np.random.Generator, samples: int, *, paid_out: float = 1.15) -> Told:
    return recording(robot, np.radians(sum(AZIMUTHS_DEG, ())), rng, samples, paid_out=paid_out)


def write_conventional(path: Path, seen: Told) -> None:
    """With columns named as the program names things: tendons in mm, paid out positive."""
    tendons = nominal_robot().tendon_names
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["time_s", "motion", *(f"{name}_mm" for name in tendons), "tip_x_mm", "tip_y_mm", "tip_z_mm"])
        for i, motion in enumerate(seen.motion):
            numbers = [*(-1e3 * seen.wound_m[i]), *(1e3 * seen.tip_m[i])]
            writer.writerow([f"{INTERVAL_S * i:.3f}", motion, *(f"{number:.5f}" for number in numbers)])


def taut(samples: int) -> Told:
    """What a robot with stiff tendons did whose tendons never hang slack: constant curvature is nearly right."""
    rng = np.random.default_rng(9)
    robot = two_sections(rng)
    return told(
        replace(robot, stiffness_N_m=20.0 * robot.stiffness_N_m, taut_m=np.full(7, 2e-4)), rng, samples, paid_out=1.0
    )


def synthetic(samples: int, seed: int = 5) -> tuple[TendonRobot, Told]:
    """A robot and what it did."""
    rng = np.random.default_rng(seed)
    robot = two_sections(rng)
    return robot, told(robot, rng, samples)


def real_recording() -> Path:
    """Folder of the opencr-v4 recording; skips the test where it is absent."""
    given = os.environ.get("COBRA_TELEOP_DATA")
    folder = Path(given) if given else Path(__file__).parents[2] / "shared" / "data"
    folder = folder / "opencr-v4"
    if not (folder / "train.csv").exists():
        pytest.skip(f"no recording in {folder}; set COBRA_TELEOP_DATA to the folder that holds opencr-v4")
    return folder
