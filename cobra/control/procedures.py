"""What moves the drives without a hand at the stick: homing, steps of commissioning, and the final action of an orphan."""

from collections.abc import Callable
from typing import Literal

from cobra.control.commissioning import Commissioning
from cobra.control.drivetrain import Drivetrain
from cobra.control.final_action import FinalAction
from cobra.control.locking import Locking
from cobra.control.setpoints import Floats, Setpoints
from cobra.control.supervisor import Supervisor
from cobra.motors.homing import Homing, HomingError


class Procedures:
    """`step` once a tick; at most one procedure runs."""

    def __init__(
        self,
        drivetrain: Drivetrain,
        setpoints: Setpoints,
        supervisor: Supervisor,
        commissioning: Commissioning,
        locking: Locking,
        orphaned: Callable[[], None],
        leave: Callable[[], None],
    ) -> None:
        """`orphaned` is called when the final action begins; `leave` when it has ended and the process shall too."""
        self._drivetrain = drivetrain
        self._setpoints = setpoints
        self._supervisor = supervisor
        self._commissioning = commissioning
        self._locking = locking
        self._orphaned = orphaned
        self._leave = leave
        self._homing: Homing | None = None
        self._final: FinalAction | None = None
        self._abandoned: Literal["", "leave", "stay"] = ""
        self._decided = False
        """A procedure decided on the last setpoint, and did not come to its end."""

    @property
    def doing(self) -> str:
        """What is being done now, in words; empty when nothing is."""
        return self._homing.progress if self._homing else self._commissioning.report().doing

    def begin_homing(self) -> None:
        """Home from the next tick on."""
        self._homing = Homing(self._drivetrain.description, self._drivetrain.tendons.bending)

    def abandon(self, leave: bool) -> None:
        """Take the final action from the next tick on. Safe from any thread."""
        self._abandoned = "leave" if leave else "stay"

    def step(self, dt_s: float) -> bool:
        """Decide on the next setpoint, where a procedure has to; else it is the driver's."""
        self._end_interrupted()
        setpoints, phase = self._setpoints, self._supervisor.phase
        if self._abandoned:
            setpoints.current = self._step_final(dt_s)
            return True
        if setpoints.current is None:
            self._decided = False
            return True
        if phase == "homing":
            setpoints.current = self._step_homing(setpoints.current, dt_s)
        elif phase == "commissioning":
            setpoints.current = self._step_commissioning(setpoints.current, dt_s)
        else:
            if self._decided:
                # Ended on the way: it stays where it is, and does not go back to where it began.
                setpoints.go_on()
            self._decided = False
            return False
        self._decided = self._supervisor.phase != "ready"
        return True

    def _end_interrupted(self) -> None:
        """Whatever led out of a procedure, STOP or a fault, is why it ended."""
        supervisor, commissioning = self._supervisor, self._commissioning
        if supervisor.phase != "homing":
            self._homing = None
        if commissioning.running and supervisor.phase != "commissioning":
            commissioning.end(supervisor.cause or supervisor.phase)
            commissioning.forget()
            supervisor.homed = False

    def _step_homing(self, setpoint: Floats, dt_s: float) -> Floats:
        drivetrain = self._drivetrain
        if self._homing is None or drivetrain.feedback is None:
            return setpoint
        try:
            load = drivetrain.loads(of_one_kind=True)
            target = self._homing.step(setpoint, load, drivetrain.speeds(), dt_s)
        except HomingError as error:
            self._supervisor.homing_failed(str(error))
            return setpoint
        if not self._homing.done:
            return target
        rest = self._setpoints.take_zero(target)
        self._supervisor.homing_done()
        self._commissioning.compare()
        return rest

    def _step_commissioning(self, setpoint: Floats, dt_s: float) -> Floats | None:
        step, supervisor = self._commissioning, self._supervisor
        target = step.advance(setpoint, dt_s)
        if step.done and step.homes:
            target = self._setpoints.take_zero(target)
            supervisor.homing_done()
            step.homed(target)
            step.forget()
            return target
        if step.done:
            if step.loosens:
                supervisor.homed = False
            self._setpoints.switch_off()
            supervisor.disarmed()
            step.forget()
            return None
        if step.failed:
            supervisor.homed = False
            supervisor.hold(f"commissioning was ended: {step.failed}. The drives stand; disarm, or try again.")
            step.forget()
        return target

    def _step_final(self, dt_s: float) -> Floats | None:
        setpoints, drivetrain = self._setpoints, self._drivetrain
        if self._final is None:
            self._final = FinalAction(drivetrain.description)
            # A rigid robot may be carrying what it would drop: paying out would unlock it.
            self._final.done |= self._final.kind == "hold" and self._locking.status == "rigid"
            self._orphaned()
        if setpoints.current is not None and drivetrain.feedback is not None and not self._final.done:
            return setpoints.limits.clamp(self._final.step(setpoints.current, drivetrain.loads(), dt_s))
        if setpoints.current is not None:
            setpoints.switch_off(hold=self._final.kind == "hold")
        self._supervisor.disarmed(f"nobody was there; final action: {self._final.kind}")
        if self._abandoned == "leave":
            self._leave()
        self._final, self._abandoned = None, ""
        return None
