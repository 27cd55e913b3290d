"""Tells once of what changed since the last tick: phase and cause to people, the calibration in force to whoever records."""

from collections.abc import Callable
from typing import Literal

from cobra.control.calibration import calibration_of
from cobra.control.commissioning import Commissioning
from cobra.control.drivetrain import Drivetrain
from cobra.control.supervisor import Supervisor
from cobra.control.tendon_control import TendonControl
from cobra.messages import Calibration, Event, RobotState


class Changes:
    """`tell` after every tick."""

    def __init__(
        self,
        supervisor: Supervisor,
        drivetrain: Drivetrain,
        tendons: TendonControl,
        commissioning: Commissioning,
        announce: Callable[[Event], None],
        calibrated: Callable[[Calibration], None],
    ) -> None:
        self._supervisor = supervisor
        self._drivetrain = drivetrain
        self._tendons = tendons
        self._commissioning = commissioning
        self._announce = announce
        self._calibrated = calibrated
        self._told: tuple[str, str] = ("", "")
        self._calibration: tuple[bool, int, int, int] | None = None

    def tell(self, state: RobotState) -> None:
        self._tell_phase(state)
        self._tell_calibration(state)

    def _tell_phase(self, state: RobotState) -> None:
        cause = self._supervisor.cause
        before, self._told = self._told, (state.phase, cause)
        pressed_or_let_go = not cause and {state.phase, before[0]} == {"ready", "driving"}
        if self._told == before or pressed_or_let_go:
            return
        if state.phase == "stopped" and before[0] != "stopped":
            # Told of when it arrived.
            return
        cut_short = state.phase == "ready" and cause
        level: Literal["info", "warning", "alarm"] = (
            "alarm"
            if state.phase in ("stopped", "fault")
            else "warning"
            if state.phase == "holding" or cut_short
            else "info"
        )
        self._announce(Event(stamp=state.stamp, level=level, text=f"{state.phase}: {cause}" if cause else state.phase))

    def _tell_calibration(self, state: RobotState) -> None:
        kept = self._commissioning.kept
        version = kept.version if kept else 0
        now = (state.homed, self._drivetrain.transmission.references, self._tendons.takeovers, version)
        if now != self._calibration:
            self._calibration = now
            self._calibrated(calibration_of(state.stamp, state.homed, self._drivetrain, self._tendons, kept))
