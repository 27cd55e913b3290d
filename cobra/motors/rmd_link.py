"""One RMD drive as its bus sees it: what it speaks, the requests that are sent again and again, and what is wrong with it."""

import math

from cobra.description import Drive, Motor
from cobra.motors.drive_limits import beyond_limits
from cobra.motors.rmd import DIALECTS, RMD_V1, RMD_V3, WATCHDOG_ALARM, Dialect, Request, fault_words
from cobra.motors.rmd_channel import Outgoing, outgoing, reply_key


class RmdLink:
    """Requests are built once; a setpoint's bytes are written into its message in every tick."""

    def __init__(self, drive: Drive, motor: Motor) -> None:
        self.name = drive.name
        self.address = drive.address
        self.motor = motor
        self.dialect: Dialect = DIALECTS[motor.protocol]
        self.coarse = self.dialect is RMD_V3
        self.shaft_ratio = 1.0 if self.coarse else motor.gear_ratio
        """Turns of the shaft that the dialect speaks of, for one of the output shaft."""
        limit_dps = math.degrees(motor.max_speed_rad_s) * self.shaft_ratio
        # 0 would mean "no limit" in v3.
        self.speed_limit_dps = min(65535, max(1, round(limit_dps)))
        self.setpoint = self.request("position", speed_dps=self.speed_limit_dps, angle_deg=0.0)
        self.motion = self.request("status_2")
        self.angle = self.request("multi_turn_angle")
        self.status = self.request("status_1")
        self.alarm_key = reply_key(self.dialect, drive.address, WATCHDOG_ALARM)
        self.errors: tuple[str, ...] = ()
        self.lost: str = ""
        """What a drive must be enabled again for: alarms, jumps of its angle."""

    def request(self, request: Request, **values: float) -> Outgoing:
        return outgoing(self.dialect, self.address, request, **values)

    @property
    def foreign_status_key(self) -> int:
        """Under which the other dialect's drive would answer a status request."""
        other = RMD_V1 if self.coarse else RMD_V3
        return reply_key(other, self.address, other.entries["status_1"].command)

    @property
    def fault(self) -> str:
        return "; ".join((*self.errors, self.lost) if self.lost else self.errors)

    def take_status(self, status: dict[str, float]) -> None:
        """Keep in words what is wrong by the drive's own flags and by the limits of its motor."""
        limits = beyond_limits(self.motor, status["temperature_C"], status["voltage_V"])
        self.errors = (*fault_words(self.dialect, int(status["flags"])), *limits)
