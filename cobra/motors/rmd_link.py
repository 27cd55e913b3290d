"""One RMD drive as its bus sees it: what it speaks, the requests that are sent again and again, and what is wrong with it."""

import math
from collections.abc import Set

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
        self.unanswered: dict[int, None] = {}
        """Keys of requests whose replies may still come, late, in the order in which they were asked."""
        self._reads = [
            self.motion, self.angle, self.status,
            *(self.request(name) for name in ("status_3", "single_turn_angle", "read_gains")),
        ]  # fmt: skip
        self.errors: tuple[str, ...] = ()
        self.lost: str = ""
        """What a drive must be enabled again for: alarms, jumps of its angle."""

    def request(self, request: Request, **values: float) -> Outgoing:
        return outgoing(self.dialect, self.address, request, values)

    def unambiguous(self, wanted: Outgoing) -> Outgoing:
        """The wanted request, or a read in its place while a late reply could be taken for its own.

        Of the reads, the one that was not asked for longest: a reply must be later than as many ticks as there are reads
        to be mistaken.
        """
        if wanted.key not in self.unanswered:
            return wanted
        for request in self._reads:
            if request.key not in self.unanswered:
                return request
        by_key = {request.key: request for request in self._reads}
        return next(by_key[key] for key in self.unanswered if key in by_key)

    def note_answers(self, asked: list[int], answered: Set[int]) -> None:
        """Keep what may still come late. A drive answers in order: what was asked before an answered request is lost."""
        last = max((i for i, key in enumerate(asked) if key in answered), default=-1)
        if last >= 0:
            self.unanswered.clear()
        for key in asked[last + 1 :]:
            self.unanswered.pop(key, None)
            self.unanswered[key] = None

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
