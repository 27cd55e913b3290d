"""Between motor shafts and what they move: angle ↔ travel, current ↔ load."""

import numpy as np
from numpy.typing import NDArray

from cobra.description import RobotDescription

Floats = NDArray[np.float64]


class Transmission:
    """Spools, wheels and gears of all drives, in the description's order.

    Travel is m of tendon paid out, m of feed, rad of twist. Where travel 0 is on the multi-turn angle is not known before
    homing: `refer` sets it.
    """

    def __init__(self, description: RobotDescription) -> None:
        drives = description.drives
        self.travel_per_rad = np.array([drive.travel_per_rad for drive in drives])
        torque_constant = np.array([description.motor_of(drive).torque_constant_Nm_A for drive in drives])
        # A motor that holds a tendon pulls it in: its force along the travel is minus the tension.
        sign = np.array([-1.0 if drive.moves == "tendon" else 1.0 for drive in drives])
        self.load_per_A: Floats = sign * torque_constant / self.travel_per_rad
        # A bench drives single motors of a robot, without cells.
        self._tendons = np.array(description.tendon_drives if description.load_cells else (), dtype=np.intp)
        self._offset = np.zeros(len(drives))
        self.references = 0
        """How often travel 0 was found anew."""

    def refer(self, angle: Floats, travel: Floats) -> None:
        """From now on the shafts' `angle` [rad] means `travel`."""
        self._offset = travel - angle * self.travel_per_rad
        self.references += 1

    def travel(self, angle: Floats) -> Floats:
        return angle * self.travel_per_rad + self._offset

    def angle(self, travel: Floats) -> Floats:
        """Shaft angles [rad] for a travel."""
        return (travel - self._offset) / self.travel_per_rad

    def load(self, current: Floats) -> Floats:
        """Tendon tension or feed force [N], twist torque [N·m], from motor current [A]; friction is not taken off."""
        return current * self.load_per_A

    def loads(self, current: Floats, cells_N: Floats, *, of_one_kind: bool = False) -> Floats:
        """Load of each drive: of a tendon what its load cell measures, else from motor current.

        Args:
            current: of all motors [A].
            cells_N: (m,) what the tendons' cells measure, NaN where nothing that can be believed; or empty.
            of_one_kind: for who compares tendons with each other: cells count where every tendon has one. A current has
                its gear's friction in it.
        """
        loads = self.load(current)
        known = np.isfinite(cells_N)
        if np.all(known) if of_one_kind else np.any(known):
            loads[self._tendons[known]] = cells_N[known]
        return loads


MOVING_M_S = 5e-5
"""Slower than this a drive may stand."""


def without_gear_friction(before_N: Floats, load_N: Floats, speed_m_s: Floats, friction_N: Floats) -> Floats:
    """(m,) tension of tendons at their spools from the load that the motors' currents tell.

    The gear's friction adds to it while the drive winds in and takes from it while it pays out; at rest it hides what it
    can, so the tension from before stays as far as it may. Paying out is a positive speed.
    """
    held = np.clip(before_N, load_N - friction_N, load_N + friction_N)
    turning = np.abs(speed_m_s) > MOVING_M_S
    return np.maximum(np.where(turning, load_N + friction_N * np.sign(speed_m_s), held), 0.0)
