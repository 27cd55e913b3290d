"""What commissioning found out about one robot, kept: the zeros of its drives, tares and gains of its load cells.

Every change is a new version in a file of its own, written whole or not at all; none is ever written over.
"""

import contextlib
import os
import tempfile
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from cobra.description import RobotDescription
from cobra.errors import OperatorError
from cobra.motors.cell_readings import CellCalibration

Floats = NDArray[np.float64]

KEPT: Final = 200
"""Versions; beyond them the oldest go, but never the first."""


class CalibrationError(OperatorError):
    """A calibration cannot be read, kept, or used. The message says which file and why."""


class DriveZero(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Where the travel of one drive is zero, by its multi-turn angle; that angle means nothing once it lost power."""

    where: str
    """Bus and address of the drive that it was found on."""
    travel_per_rad: float
    zero_rad: float
    """Angle of the output shaft at travel 0."""
    spread_m: float | None = None
    """Largest difference between the runs; None where it was homed once."""


class Calibration(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One version."""

    robot: str
    serial: str = ""
    version: int = 0
    """Counts from 1; 0 is not kept yet."""
    date: str = ""
    """UTC, ISO 8601."""
    by: str = ""
    """What was done, in words."""
    drives: dict[str, DriveZero] = {}
    cells: dict[str, CellCalibration] = {}


class CalibrationBook:
    """All versions of one robot's calibration."""

    def __init__(self, description: RobotDescription, folder: Path | None) -> None:
        """`folder` holds them; None keeps the newest in memory only."""
        self._description = description
        self._folder = folder
        self._newest: Calibration | None = None
        self.complaints: tuple[str, ...] = ()
        """Files that could not be used, in words."""

    @property
    def newest(self) -> Calibration | None:
        """The one in use; None before any."""
        return self._newest

    def load(self) -> Calibration | None:
        """Read the newest version that can be used; what is wrong with newer ones stands in `complaints`."""
        self._newest, complaints = None, []
        for path in reversed(self._files()):
            try:
                self._newest = self._read(path)
                break
            except CalibrationError as error:
                complaints.append(str(error))
        self.complaints = tuple(complaints)
        return self._newest

    def history(self) -> list[Calibration]:
        """All versions that can be read, the oldest first."""
        out = []
        for path in self._files():
            with contextlib.suppress(CalibrationError):
                out.append(self._read(path))
        return out

    def keep(
        self,
        by: str,
        *,
        drives: Mapping[str, DriveZero] | None = None,
        cells: Mapping[str, CellCalibration] | None = None,
    ) -> Calibration:
        """Make the next version: what is given replaces what was, the rest stays.

        Raises:
            CalibrationError: it cannot be written.
        """
        before = self._newest or Calibration(robot=self._description.name)
        fresh = Calibration(
            robot=self._description.name,
            serial=self._description.serial,
            version=before.version + 1,
            date=datetime.now(UTC).isoformat(timespec="seconds"),
            by=by,
            drives={**before.drives, **(drives or {})},
            cells={**before.cells, **(cells or {})},
        )
        self._newest = self._write(fresh) if self._folder is not None else fresh
        return self._newest

    def _files(self) -> list[Path]:
        if self._folder is None or not self._folder.is_dir():
            return []
        return sorted(path for path in self._folder.glob("*.json") if path.stem.isdecimal())

    def _read(self, path: Path) -> Calibration:
        try:
            found = msgspec.json.decode(path.read_bytes(), type=Calibration)
        except (OSError, msgspec.MsgspecError) as error:
            raise CalibrationError(f"calibration {path} cannot be read ({error}): move it away") from None
        d = self._description
        if (found.robot, found.serial) != (d.name, d.serial):
            said, here = (
                f"{name}{f' serial {n}' if n else ''}" for name, n in ((found.robot, found.serial), (d.name, d.serial))
            )
            raise CalibrationError(f"calibration {path} is of {said}, this robot is {here}: it is not used")
        return found

    def _write(self, fresh: Calibration) -> Calibration:
        assert self._folder is not None
        try:
            self._folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            while True:
                path = self._folder / f"{fresh.version:05d}.json"
                if _written(path, msgspec.json.format(msgspec.json.encode(fresh), indent=2)):
                    break
                # Another process kept one meanwhile.
                fresh = msgspec.structs.replace(fresh, version=fresh.version + 1)
            files = self._files()
            for old in files[1 : len(files) - KEPT + 1]:
                old.unlink(missing_ok=True)
        except OSError as error:
            raise CalibrationError(f"calibration cannot be kept in {self._folder}: {error.strerror or error}") from None
        return fresh


def _written(path: Path, data: bytes) -> bool:
    """Write a new file whole; False if there is one of this name already."""
    handle, fresh = tempfile.mkstemp(dir=path.parent, prefix=".", suffix=".part")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        try:
            os.link(fresh, path)  # unlike a rename it never replaces another process's file
        except FileExistsError:
            return False
    finally:
        Path(fresh).unlink(missing_ok=True)
    return True


def zeros(
    description: RobotDescription, angle_rad: Floats, travel: Floats, spread_m: Mapping[str, float] | None = None
) -> dict[str, DriveZero]:
    """By drive, from the shafts' angles (drives,) [rad] and the travel that they mean (drives,)."""
    return {
        drive.name: DriveZero(
            where=f"{drive.bus}:{drive.address}",
            travel_per_rad=drive.travel_per_rad,
            zero_rad=float(angle - here / drive.travel_per_rad),
            spread_m=(spread_m or {}).get(drive.name),
        )
        for drive, angle, here in zip(description.drives, angle_rad.tolist(), travel.tolist(), strict=True)
    }


def zero_angles(description: RobotDescription, calibration: Calibration) -> tuple[Floats, str]:
    """Shaft angles (drives,) at travel 0, and why they cannot be used, in words; empty if they can."""
    out = np.full(len(description.drives), np.nan)
    for i, drive in enumerate(description.drives):
        zero = calibration.drives.get(drive.name)
        if zero is None:
            return out, f"the calibration of {calibration.date} knows no zero of drive {drive.name}"
        if zero.where != f"{drive.bus}:{drive.address}" or abs(zero.travel_per_rad - drive.travel_per_rad) > 1e-9:
            return out, f"drive {drive.name} is described otherwise than when it was calibrated"
        out[i] = zero.zero_rad
    return out, ""
