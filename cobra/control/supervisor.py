"""The states of the robot and what leads from one to the other. It alone decides whether a command moves anything."""

from collections.abc import Sequence
from dataclasses import dataclass

from cobra.messages import COMMAND_VALIDITY_S, Command, Phase
from cobra.motors.bus import HOME_AGAIN

ATTENDED_S = 1.0
"""Commissioning moves without a dead-man, but never without a driver at the page."""
CENTRED = 0.02
"""A stick that reads more than this is not centred."""


@dataclass(frozen=True, slots=True)
class Health:
    """What the supervisor needs to know of the machine in this tick, in words; empty tuples when all is well."""

    blocking: tuple[str, ...] = ()
    """Prevents arming and stops motion until it is gone: drives that do not answer, a bus that is gone."""
    faults: tuple[str, ...] = ()
    """Faults that need to be looked at: arming again is required after them."""


@dataclass(frozen=True, slots=True)
class Drive:
    """The newest command that was accepted, and when it arrived."""

    command: Command
    arrival_s: float


class Supervisor:
    """disarmed → (commissioning →) homing → ready → driving → holding → stopped / fault.

    Holding is leaving `driving` (or `ready`) for a reason other than letting go. From there, and after every end of
    driving, the driver must release the dead-man and centre the sticks before the next press moves anything.
    """

    def __init__(self) -> None:
        self.phase: Phase = "disarmed"
        self.cause = ""
        self.homed = False
        self._armed = False
        self._may_press = False

    def arming_reasons(self, health: Health, drive: Drive | None, now_s: float) -> tuple[str, ...]:
        """What still prevents arming, in words."""
        reasons = [*health.blocking, *health.faults]
        if self.phase == "stopped":
            reasons.append("STOP is latched: clear it first")
        if drive is None:
            reasons.append("nobody drives: take the controls first")
        elif not _fresh(drive, now_s):
            reasons.append("no input arrives from the driver: check pad and page")
        elif drive.command.held:
            reasons.append("the drive button is held: let it go")
        elif not _centred(drive.command):
            reasons.append("the sticks are not centred: let them go")
        return tuple(reasons)

    def armed(self) -> None:
        """The drives took their setpoints."""
        self._armed = True
        self._enter("ready" if self.homed else "homing")

    def start_commissioning(self) -> None:
        """The drives took their setpoints, for a step of commissioning."""
        self._armed = True
        self._enter("commissioning")

    def start_homing(self) -> None:
        self.homed = False
        self._enter("homing")

    def homing_done(self) -> None:
        self.homed = True
        self._enter("ready")

    def homing_failed(self, reason: str) -> None:
        self._enter("holding", f"homing failed: {reason}")

    def disarmed(self, cause: str = "") -> None:
        self._armed = False
        self._enter("disarmed", cause)

    def stop(self, who: str, reason: str) -> None:
        """Latch: nothing moves until a driver clears it."""
        by = f" by {who}" if who else ""
        why = f": {reason}" if reason else ""
        self._enter("stopped", f"STOP{by}{why}. Look, then clear it to go on.")

    def hold(self, cause: str) -> None:
        """End the drive for a reason of the driver's own making."""
        self._enter("holding", cause)

    def clear(self) -> None:
        """Take the latch away; moves nothing."""
        self._enter("ready" if self._armed and self.homed else "holding" if self._armed else "disarmed")
        if self.phase == "holding":
            self.cause = "not homed: home it before driving"

    def tick(self, now_s: float, drive: Drive | None, health: Health) -> bool:
        """Advance the state; returns whether the newest command may move the robot in this tick."""
        if any(HOME_AGAIN in fault for fault in health.faults):
            self.homed = False
        if health.faults and self._armed and self.phase != "stopped":
            self._armed = False
            self._enter("fault", f"{health.faults[0]}. The drives stand still; arm again when it is mended.")
        elif health.blocking and self.phase in ("ready", "driving", "homing", "commissioning"):
            self._enter("holding", health.blocking[0])
        elif self.phase == "commissioning" and (drive is None or now_s - drive.arrival_s > ATTENDED_S):
            self._enter("holding", "commissioning was ended: the driver's commands stopped arriving")
        elif self.phase == "driving":
            self._keep_driving(now_s, drive)
        elif self.phase in ("ready", "holding"):
            self._wait_for_press(now_s, drive, health)
        return self.phase == "driving"

    def _keep_driving(self, now_s: float, drive: Drive | None) -> None:
        if drive is None:
            self._enter("holding", "the driver's lease ended. Let go, centre, press again.")
        elif not _fresh(drive, now_s):
            self._enter("holding", "the driver's commands stopped arriving. Let go, centre, press again.")
        elif not drive.command.held:
            ended = drive.command.ended
            self._enter("ready", f"{ended}. Let go, centre, press again." if ended else "")

    def _wait_for_press(self, now_s: float, drive: Drive | None, health: Health) -> None:
        if drive is None or not _fresh(drive, now_s):
            self._may_press = False
            return
        if not drive.command.held:
            self._may_press = _centred(drive.command)
            if self._may_press and self.phase == "holding" and self.homed and not health.blocking:
                self._enter("ready")
                self._may_press = True
        elif self._may_press and self.phase == "ready":
            self._enter("driving")

    def _enter(self, phase: Phase, cause: str = "") -> None:
        self.phase = phase
        self.cause = cause
        self._may_press = False


def _fresh(drive: Drive, now_s: float) -> bool:
    return now_s - drive.arrival_s <= COMMAND_VALIDITY_S


def _centred(command: Command) -> bool:
    intent = command.intent
    rates: Sequence[float] = (*intent.primary, *intent.secondary, intent.feed, intent.twist, intent.length)
    return all(abs(rate) <= CENTRED for rate in rates)
