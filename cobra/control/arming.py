"""Switching on and off: what a driver may ask for, and what has to be so before it is done."""

from cobra.control.arrivals import Arrivals
from cobra.control.procedures import Procedures
from cobra.control.requests import Act
from cobra.control.setpoints import Floats, Setpoints
from cobra.control.supervisor import Health, Supervisor
from cobra.messages import Reply, Request


class Switching:
    """On for a step of commissioning, and zeros taken over without moving: what commissioning asks of the loop."""

    def __init__(self, supervisor: Supervisor, setpoints: Setpoints, arrivals: Arrivals) -> None:
        self._supervisor = supervisor
        self._setpoints = setpoints
        self._arrivals = arrivals

    def stand_ready(self, health: Health, now_s: float) -> tuple[str, ...]:
        """For a step of commissioning: switched on and standing. What prevents it, in words."""
        supervisor = self._supervisor
        if supervisor.phase not in ("disarmed", "fault", "ready", "holding"):
            return ("not while it moves or is stopped",)
        reasons = supervisor.arming_reasons(Health(blocking=health.blocking), self._arrivals.drive, now_s)
        if not reasons and self._setpoints.current is None:
            reasons = self._setpoints.switch_on()
        if not reasons:
            supervisor.start_commissioning()
        return reasons

    def refer(self, angle: Floats, travel: Floats) -> Reply:
        """Take the shafts' angles for this travel, homed, though nothing moved."""
        if self._supervisor.phase != "disarmed":
            return Reply(ok=False, reasons=("disarm it first",))
        self._setpoints.refer(angle, travel)
        return Reply(ok=True)


def arming_acts(
    supervisor: Supervisor, setpoints: Setpoints, procedures: Procedures, arrivals: Arrivals
) -> dict[str, Act]:
    """arm, home, disarm, clear."""

    def arm(request: Request, now_s: float, health: Health) -> Reply:
        if supervisor.phase not in ("disarmed", "fault"):
            return Reply(ok=False, reasons=("it is armed already",))
        # A fault is cleared by enabling the motors, or is named again.
        reasons = supervisor.arming_reasons(Health(blocking=health.blocking), arrivals.drive, now_s)
        if reasons := reasons or setpoints.switch_on():
            return Reply(ok=False, reasons=reasons)
        if not supervisor.homed:
            procedures.begin_homing()
        supervisor.armed()
        return Reply(ok=True)

    def home(request: Request, now_s: float, health: Health) -> Reply:
        if supervisor.phase not in ("ready", "holding"):
            return Reply(ok=False, reasons=("arm it first; homing needs the drives on and standing still",))
        if health.blocking:
            return Reply(ok=False, reasons=health.blocking)
        procedures.begin_homing()
        supervisor.start_homing()
        return Reply(ok=True)

    def disarm(request: Request, now_s: float, health: Health) -> Reply:
        setpoints.switch_off()
        supervisor.disarmed()
        return Reply(ok=True)

    def clear(request: Request, now_s: float, health: Health) -> Reply:
        if supervisor.phase != "stopped":
            return Reply(ok=False, reasons=("there is no STOP to clear",))
        supervisor.clear()
        return Reply(ok=True)

    return {"arm": arm, "home": home, "disarm": disarm, "clear": clear}
