"""What people do with the robot, gathered from what the robot process hears and says, for the audit trail."""

from collections import deque

import msgspec

from app.people.audit import AuditTrail
from cobra.messages import Heard, RobotState, Stop, decode

WORTH_NOTING = {
    "acquire": "took the controls",
    "take": "took over the controls",
    "release": "let go of the controls",
    "ask": "asked for the controls",
    "grant": "gave the controls away",
    "refuse": "refused the controls to somebody",
    "arm": "armed",
    "disarm": "disarmed",
    "home": "homed",
    "identify": "moved a drive to identify it",
    "test": "tested drives",
    "home_repeatedly": "homed repeatedly",
    "tare": "tared load cells",
    "calibrate_cell": "calibrated a load cell",
    "resume": "took the kept zeros",
    "abort": "ended a step of commissioning",
    "clear": "cleared the stop",
    "quit": "quit",
}
"""Requests by what was done; others are called by their name. `retain` and `mark` are no deeds."""
SILENT = ("retain", "mark", "withdraw")


class RobotDeeds:
    """Follows a robot process. Its methods are called on the loop's or the link's threads and never block."""

    def __init__(self, trail: AuditTrail) -> None:
        self._trail = trail
        self._driver = ""
        self._since = 0.0
        self._holder = ""
        self._presses: deque[str] = deque(maxlen=32)
        """Marks of STOPs that are noted; a STOP is said again until it is confirmed."""

    def heard(self, heard: Heard) -> None:
        """Requests with their answers."""
        for answered in heard.answers:
            request, reply = answered.request, answered.reply
            if request.what in SILENT:
                continue
            what = WORTH_NOTING.get(request.what, request.what)
            about = ": ".join(filter(None, (request.name, request.reason)))
            if not reply.ok:
                what, about = f"was refused: {request.what}", "; ".join(reply.reasons)
            self._trail.note(request.who or self._holder, what, about)

    def state(self, state: RobotState) -> None:
        """Who drove, and for how long."""
        holder, drives = state.lease.holder, state.phase == "driving"
        if drives and not self._driver:
            self._driver, self._since = holder or self._holder, state.stamp
        elif self._driver and not drives:
            self._trail.note(self._driver, f"drove {state.stamp - self._since:.1f} s", state.cause)
            self._driver = ""
        self._holder = holder or self._holder

    def stopped(self, data: bytes) -> None:
        """A STOP as it arrived."""
        try:
            stop = decode(data, Stop)
        except msgspec.MsgspecError:
            stop = Stop(reason="the message was damaged")
        if stop.press in self._presses:
            return
        if stop.press:
            self._presses.append(stop.press)
        self._trail.note(stop.who, "STOP", stop.reason)
