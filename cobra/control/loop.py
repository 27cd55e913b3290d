"""The fixed-rate loop: one tick takes what arrived, moves what may move, exchanges once with the bus, and tells everybody.

commands → supervisor → motion → tendons → limits → motor bus → feedback → estimation → state
"""

import gc
import threading
from collections import Counter
from collections.abc import Callable
from typing import Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from cobra.clock import Clock
from cobra.control.authority import Authority
from cobra.control.calibration import calibration_of
from cobra.control.cell_watch import CellWatch, cells_report
from cobra.control.commissioning import Commissioning
from cobra.control.drive_watch import DriveWatch, Watched
from cobra.control.drivetrain import Drivetrain
from cobra.control.final_action import FinalAction
from cobra.control.inbox import Inbox
from cobra.control.limits import DriveLimits
from cobra.control.locking import Locking, locking_acts
from cobra.control.motion import Motion
from cobra.control.motion_requests import motion_acts
from cobra.control.outlets import guarded
from cobra.control.poses import PoseBook
from cobra.control.realtime import LOOP_PRIORITY, ask_for_realtime
from cobra.control.report import channels_report, drives_report, health_of
from cobra.control.requests import Requests
from cobra.control.supervisor import Drive, Health, Supervisor
from cobra.control.tendon_control import TendonControl
from cobra.control.timing import LoopTiming
from cobra.control.witness import Witness
from cobra.description import RobotDescription
from cobra.mechanics.losses import LossesError, from_text
from cobra.messages import Calibration, Command, Event, HandFedLength, Heard, Reply, Request, RobotState, Stop, decode
from cobra.motors.bus import BusError, Feedback, MotorBus
from cobra.motors.bus_load import busiest
from cobra.motors.calibration import CalibrationBook
from cobra.motors.cell_readings import LoadCells
from cobra.motors.homing import Homing, HomingError

Floats = NDArray[np.float64]

BIAS_RATE = 0.002
"""After arming with bent tendons, their difference to the model is taken up at this speed [m/s]."""

PREPARING = "the modes of motion are being compiled: wait (seconds; the first time on a computer half a minute)"


OVERLAP = 0.7
"""Part of the period that the frames of a tick take on the busiest bus."""


class RobotLoop:
    """Owns the motor bus. `tick` is one cycle; `run` repeats it at the description's rate."""

    def __init__(
        self,
        description: RobotDescription,
        bus: MotorBus,
        clock: Clock,
        publish: Callable[[RobotState], None],
        announce: Callable[[Event], None],
        testify: Callable[[Heard], None] = lambda heard: None,
        poses: PoseBook | None = None,
        calibrated: Callable[[Calibration], None] = lambda calibration: None,
        cells: LoadCells | None = None,
        calibrations: CalibrationBook | None = None,
    ) -> None:
        self.description = description
        self.clock = clock
        self.inbox = Inbox()
        self.authority = Authority()
        self.supervisor = Supervisor()
        self._malformed: Counter[str] = Counter()
        self._publish = guarded("publishing a state", publish, self._malformed)
        self._announce = guarded("announcing an event", announce, self._malformed)
        self._witness = Witness(guarded("telling a recorder", testify, self._malformed))
        self._calibrated = guarded("telling the calibration", calibrated, self._malformed)
        self._calibration: tuple[bool, int, int, int] | None = None
        self.requests = Requests(self.authority, self._lose_driver, self._announce)
        self.requests.acts.update(
            arm=self._arm, home=self._home, disarm=self._disarm, clear=self._clear, quit=self._quit
        )
        poses = poses or PoseBook(description)
        self.motion = Motion(description, poses)
        self.requests.acts.update(motion_acts(self.motion, poses, self.supervisor))
        self.preparing = ""
        """Why it cannot be armed yet though the drives are well, in words; empty when it can."""
        self.locking = Locking(description)
        self.requests.acts.update(
            locking_acts(self.locking, self.supervisor, lambda: (self.motion.q, self._measured()))
        )
        self.period_s = 1.0 / description.teleop.loop_rate_Hz
        self.quit_requested = False
        self.drivetrain = Drivetrain(description, bus)
        self.tendons = TendonControl(self.drivetrain)
        self.requests.acts.update(
            compensation=self._compensate, pretension=self._tighten, parameters=self._take_parameters
        )
        self.commissioning = Commissioning(
            description,
            self.drivetrain,
            cells if cells is not None else LoadCells(description, clock),
            calibrations or CalibrationBook(description, None),
            self._stand_ready,
            self._refer,
            self.warn,
        )
        self.requests.acts.update(self.commissioning.acts)
        self._limits = DriveLimits(description)
        self._watch = DriveWatch(description)
        self._watched: Watched | None = None
        self._cells = CellWatch(description, self.supervisor, self.warn)
        self._timing = LoopTiming(self.period_s)
        self._homing: Homing | None = None
        self._final: FinalAction | None = None
        self._abandoned: Literal["", "leave", "stay"] = ""
        self._drive: Drive | None = None
        self._setpoint: Floats | None = None
        self._ready: Floats | None = None
        # Where the bus needs most of the period, the next setpoint is computed while the frames are on the wire: a tick later,
        # but the rate is the bus's.
        self._overlapped = busiest(description) > OVERLAP
        self._bias = np.zeros(len(description.drives))
        self._procedural = False
        """Homing or commissioning decided on the last setpoint."""
        self._limited = ""
        self._tick = 0
        self._told: tuple[str, str] = ("", "")

    # ------------------------------------------------------------------ one tick

    def tick(self) -> RobotState:
        start = self.clock.now()
        waited_s = self.drivetrain.bus.waited_s
        if self._overlapped:
            # The bus first: what was computed while the last frames were on it, and nothing if it was taken back since. What
            # the drives said is looked at while these frames are on their way.
            self.drivetrain.send(self._setpoint if self._setpoint is None else self._ready)
            if self._tick:
                self.drivetrain.hear()
                self._watch_drives()
        self._take_stops(start)
        self._take_commands(start)
        health = health_of(self.description, self.drivetrain.feedback, self.drivetrain.gone, self._watched)
        if self.preparing:
            health = Health(blocking=(self.preparing, *health.blocking), faults=health.faults)
        if not self._overlapped:
            self._take_requests(start, health)
        self._choose_mode()
        moving = self.supervisor.tick(start, self._drive, health)
        if self.supervisor.phase == "fault" and self._setpoint is not None:
            # Tendons that lost their pull would let the robot fall: the other drives keep standing.
            self._switch_off(hold=True)
        self._ready = self._next_setpoint(moving)
        if not self._overlapped:
            self.drivetrain.exchange(self._ready)
            self._watch_drives()
        state = self._snapshot(start, health, self.drivetrain.bus.waited_s - waited_s)
        self._publish(state)
        self._witness.tell()
        self._tell_changes(state)
        self._tell_calibration(state)
        if self._overlapped:
            self.drivetrain.gather()
            # Requests may speak to the drives themselves: not while others' replies are on their way.
            self._take_requests(start, health)
        self._tick += 1
        return state

    def abandon(self, leave: bool) -> None:
        """Nobody is there any more: take the description's final action, disarm and, with `leave`, ask to quit.

        Safe from any thread: the next tick begins it.
        """
        self._abandoned = "leave" if leave else "stay"

    def run(self, until: threading.Event) -> None:
        """Tick at the fixed rate until told to stop. A tick that is half a period late is not made up for."""
        self._timing.realtime = ask_for_realtime(LOOP_PRIORITY)
        gc.collect()
        gc.freeze()
        deadline = self.clock.now()
        while not until.is_set() and not self.quit_requested:
            self.tick()
            deadline += self.period_s
            now = self.clock.now()
            if now > deadline + 0.5 * self.period_s:
                deadline = now
            self.clock.sleep_until(deadline)

    def warn(self, text: str) -> None:
        """Tell people something that is no state of the robot's. Safe from any thread."""
        self._announce(Event(stamp=self.clock.now(), level="warning", text=text))

    def prepare(self) -> None:
        """Compile what the modes need, beside the loop: it cannot be armed before that is done."""
        self.preparing = PREPARING
        try:
            self.motion.warm_up()
            self.tendons.warm_up()
        finally:
            self.preparing = ""
            # What was late meanwhile says nothing of driving.
            self._timing.restart()

    # ------------------------------------------------------------------ what arrives

    def _take_stops(self, now_s: float) -> None:
        while self.inbox.stops:
            data = self.inbox.stops.popleft()
            try:
                stop = decode(data, Stop)
            except msgspec.MsgspecError:
                # A stop that cannot be read is still a stop.
                self._malformed["malformed stop (obeyed)"] += 1
                stop = Stop(who="somebody", reason="the message was damaged")
            self.authority.revoke()
            self._drive = None
            self.supervisor.stop(stop.who, stop.reason)
            self._announce(Event(stamp=now_s, level="alarm", text=self.supervisor.cause))

    def _take_commands(self, now_s: float) -> None:
        while self.inbox.commands:
            data = self.inbox.commands.popleft()
            try:
                command = decode(data, Command)
            except msgspec.MsgspecError:
                self._malformed["malformed message"] += 1
                continue
            if command.mode in self.motion.names:
                dropped = self.authority.accept(command, now_s)
            else:
                dropped = "unknown mode"
                self._malformed[dropped] += 1
            if dropped is None:
                self._drive = Drive(command, now_s)
            self._witness.command(command, dropped, now_s)
        while self.inbox.lengths:
            try:
                length = decode(self.inbox.lengths.popleft(), HandFedLength)
            except msgspec.MsgspecError:
                self._malformed["malformed length"] += 1
                continue
            if self.motion.hand_feed.measured(length.length_m, now_s):
                self._malformed["length out of range or not asked for"] += 1

    def _choose_mode(self) -> None:
        """Take the mode of the newest command; while driving another one ends the drive."""
        if self._drive is None:
            return
        command = self._drive.command
        if self.supervisor.phase != "driving":
            self.motion.choose(command.mode, command.intent.pose)
        elif command.held and (command.mode, command.intent.pose) != (self.motion.mode, self.motion.pose):
            self.supervisor.hold("the mode was changed while driving. Let go, centre, press again.")

    def _take_requests(self, now_s: float, health: Health) -> None:
        while self.inbox.requests:
            asked = self.inbox.requests.popleft()
            reply = self.requests.answer(asked.data, now_s, health)
            asked.answer(reply)
            self._witness.request(asked.data, reply, now_s)

    def _lose_driver(self) -> None:
        self._drive = None

    def _disarm(self, request: Request, now_s: float, health: Health) -> Reply:
        self._switch_off()
        self.supervisor.disarmed()
        return Reply(ok=True)

    def _clear(self, request: Request, now_s: float, health: Health) -> Reply:
        if self.supervisor.phase != "stopped":
            return Reply(ok=False, reasons=("there is no STOP to clear",))
        self.supervisor.clear()
        return Reply(ok=True)

    def _quit(self, request: Request, now_s: float, health: Health) -> Reply:
        self.quit_requested = True
        return Reply(ok=True)

    # ------------------------------------------------------------------ arming and homing

    def _arm(self, request: Request, now_s: float, health: Health) -> Reply:
        if self.supervisor.phase not in ("disarmed", "fault"):
            return Reply(ok=False, reasons=("it is armed already",))
        # A fault is cleared by enabling the motors, or is named again.
        reasons = self.supervisor.arming_reasons(Health(blocking=health.blocking), self._drive, now_s)
        if reasons:
            return Reply(ok=False, reasons=reasons)
        if reasons := self._switch_on():
            return Reply(ok=False, reasons=reasons)
        if not self.supervisor.homed:
            self._homing = Homing(self.description, self.drivetrain.tendons.bending)
        self.supervisor.armed()
        return Reply(ok=True)

    def _home(self, request: Request, now_s: float, health: Health) -> Reply:
        if self.supervisor.phase not in ("ready", "holding"):
            return Reply(ok=False, reasons=("arm it first; homing needs the drives on and standing still",))
        if health.blocking:
            return Reply(ok=False, reasons=health.blocking)
        self._homing = Homing(self.description, self.drivetrain.tendons.bending)
        self.supervisor.start_homing()
        return Reply(ok=True)

    def _switch_on(self) -> tuple[str, ...]:
        """The drives take setpoints from where they stand. What prevents it, in words."""
        try:
            reasons = self.drivetrain.bus.enable()
        except BusError as error:
            reasons = (str(error),)
        if reasons or self.drivetrain.feedback is None:
            return reasons or ("the motors have not answered yet",)
        self.drivetrain.exchange(None)
        self._start_from_measured(self.drivetrain.feedback)
        return ()

    def _stand_ready(self, health: Health, now_s: float) -> tuple[str, ...]:
        """For a step of commissioning: switched on and standing. What prevents it, in words."""
        if self.supervisor.phase not in ("disarmed", "fault", "ready", "holding"):
            return ("not while it moves or is stopped",)
        reasons = self.supervisor.arming_reasons(Health(blocking=health.blocking), self._drive, now_s)
        if not reasons and self._setpoint is None:
            reasons = self._switch_on()
        if not reasons:
            self.supervisor.start_commissioning()
        return reasons

    def _refer(self, angle: Floats, travel: Floats) -> Reply:
        """Take the shafts' angles for this travel, homed, though nothing moved."""
        if self.supervisor.phase != "disarmed":
            return Reply(ok=False, reasons=("disarm it first",))
        self.drivetrain.transmission.refer(angle, travel)
        self.supervisor.homed = True
        self.motion.reset(self._measured())
        self.locking.reset(self.motion.q)
        return Reply(ok=True)

    def _start_from_measured(self, feedback: Feedback) -> None:
        """Bumpless: the first setpoint after switching on is where the drives stand."""
        self._watch.forget()
        self._watched = None
        if not self.supervisor.homed:
            rest = self.drivetrain.travel_of(self.motion.configuration.rest())
            self.drivetrain.transmission.refer(feedback.angle, rest)
        self._setpoint = self.drivetrain.transmission.travel(feedback.angle)
        self.motion.reset(self._measured())
        self.tendons.resume(self.motion.q, self._setpoint)
        self.locking.reset(self.motion.q)
        self._bias = self._setpoint - self.tendons.travel(self.motion.q, 0.0)

    def _switch_off(self, hold: bool = False) -> None:
        """No more setpoints; the drives lose their torque, or with `hold` keep standing where they are."""
        self._setpoint = self._ready = None
        self._homing = None
        self.drivetrain.switch_off(hold)

    # ------------------------------------------------------------------ setpoints

    def _next_setpoint(self, moving: bool) -> Floats | None:
        holds = self._setpoint is not None and self.supervisor.phase in ("ready", "driving", "holding")
        self.tendons.observe(self.motion.q, self.motion.velocity, self.period_s, holds)
        if self._abandoned:
            return self._step_final()
        if self._setpoint is None:
            return None
        procedural = self.supervisor.phase in ("homing", "commissioning")
        if self.supervisor.phase == "homing":
            self._setpoint = self._step_homing(self._setpoint)
        elif self.supervisor.phase == "commissioning":
            self._setpoint = self._step_commissioning(self._setpoint)
        else:
            self._homing = None
            if self._procedural:
                # Ended on the way: it stays where it is, and does not go back to where it began.
                self._bias = self._setpoint - self.tendons.travel(self.motion.q, 0.0)
            self._setpoint = self._step_motion(moving, self._setpoint)
        self._procedural = procedural and self.supervisor.phase != "ready"
        return self._setpoint

    def _step_homing(self, setpoint: Floats) -> Floats:
        if self._homing is None or self.drivetrain.feedback is None:
            return setpoint
        try:
            target = self._homing.step(setpoint, self.drivetrain.loads(), self.drivetrain.speeds(), self.period_s)
        except HomingError as error:
            self.supervisor.homing_failed(str(error))
            return setpoint
        if not self._homing.done:
            return target
        rest = self._take_zero(target)
        self.commissioning.compare()
        return rest

    def _step_commissioning(self, setpoint: Floats) -> Floats | None:
        step = self.commissioning
        target = step.advance(setpoint, self.period_s)
        if step.done and step.homes:
            target = self._take_zero(target)
            step.homed(target)
            step.forget()
            return target
        if step.done:
            if step.loosens:
                self.supervisor.homed = False
            self._switch_off()
            self.supervisor.disarmed()
            step.forget()
            return None
        if step.failed:
            self.supervisor.homed = False
            self.supervisor.hold(f"commissioning was ended: {step.failed}. The drives stand; disarm, or try again.")
            step.forget()
        return target

    def _take_zero(self, target: Floats) -> Floats:
        # Zero is where the tendons carry their pretension now; twist and feed keep what they are taken for.
        home = self.motion.configuration.home()
        rest = self.drivetrain.travel_of(home)
        self.drivetrain.transmission.refer(self.drivetrain.transmission.angle(target), rest)
        self.motion.reset(home)
        self.locking.reset(home)
        self._bias = np.zeros_like(self._bias)
        self.tendons.homed(rest)
        self.supervisor.homing_done()
        return rest

    def _step_final(self) -> Floats | None:
        if self._final is None:
            self._final = FinalAction(self.description)
            # A rigid robot may be carrying what it would drop: paying out would unlock it.
            self._final.done |= self._final.kind == "hold" and self.locking.status == "rigid"
            self.authority.revoke()
            self._drive = None
        if self._setpoint is not None and self.drivetrain.feedback is not None and not self._final.done:
            load = self.drivetrain.loads()
            self._setpoint = self._limits.clamp(self._final.step(self._setpoint, load, self.period_s))
            return self._setpoint
        if self._setpoint is not None:
            self._switch_off(hold=self._final.kind == "hold")
        self.supervisor.disarmed(f"nobody was there; final action: {self._final.kind}")
        self.quit_requested = self._abandoned == "leave"
        self._final, self._abandoned = None, ""
        return None

    def _step_motion(self, moving: bool, setpoint: Floats) -> Floats:
        intent = self._drive.command.intent if moving and self._drive else None
        q, velocity = self.motion.propose(intent, self.period_s)
        restrained = self.locking.restrain(self.motion.q, self.motion.velocity, q, moving, self.period_s)
        if restrained is not q:
            q, velocity = restrained, (restrained - self.motion.q) / self.period_s
        if moving:
            self._bias = np.sign(self._bias) * np.maximum(np.abs(self._bias) - BIAS_RATE * self.period_s, 0.0)
        step = self.drivetrain.travel_of(q) - self.drivetrain.travel_of(self.motion.q)
        allowed = self._limits.allow(setpoint, step, self.tendons.loads(), self.period_s)
        share, reason = self.tendons.allow(step)
        scale = min(allowed.scale, share)
        self._limited = allowed.reason or reason
        if scale < 1.0:
            q = self.motion.q + scale * (q - self.motion.q)
            velocity = velocity * scale
        self.motion.take(q, velocity)
        self.locking.observe(q, self._measured())
        known = self.tendons.faults
        self.tendons.watch(setpoint, self.period_s)
        for fault in self.tendons.faults[len(known) :]:
            self.supervisor.hold(f"{fault}. Let go, look, press again to go on.")
            self.warn(fault)
        return self._limits.paced(setpoint, self.tendons.travel(q, self.period_s) + self._bias, self.period_s)

    def _compensate(self, request: Request, now_s: float, health: Health) -> Reply:
        """Switch compensation on (value 1) or off (0). Bumpless: the difference is taken up while driving."""
        if not self.tendons.available:
            return Reply(ok=False, reasons=("this robot has no tendons that could be compensated",))
        self.tendons.enabled = request.value != 0.0
        if self._setpoint is not None:
            self.tendons.resume(self.motion.q, self._setpoint)
        if self._setpoint is not None and self.supervisor.phase != "homing":
            self._bias = self._setpoint - self.tendons.travel(self.motion.q, 0.0)
        return Reply(ok=True)

    def _take_parameters(self, request: Request, now_s: float, health: Health) -> Reply:
        """Take over loss parameters, TOML in `name`; they count from the next homing on."""
        if self.supervisor.phase not in ("disarmed", "ready", "holding"):
            return Reply(ok=False, reasons=("not while it moves or is stopped",))
        try:
            self.tendons.prepare(from_text(request.name, self.description, "the parameters"))
        except LossesError as error:
            return Reply(ok=False, reasons=(str(error),))
        return Reply(ok=True)

    def _tighten(self, request: Request, now_s: float, health: Health) -> Reply:
        """Bring the tendons to a mean tension of `value` [N]."""
        if self.supervisor.phase != "ready":
            return Reply(ok=False, reasons=("arm and home it first, and let go of the drive button",))
        refused = self.tendons.tighten(request.value)
        return Reply(ok=not refused, reasons=(refused,) if refused else ())

    # ------------------------------------------------------------------ what it tells

    def _watch_drives(self) -> None:
        drivetrain = self.drivetrain
        self._cells.step(drivetrain.feedback)
        if drivetrain.feedback is not None and not drivetrain.gone:
            wanted = None if self._setpoint is None else drivetrain.transmission.angle(self._setpoint)
            self._watched = self._watch.step(drivetrain.feedback, wanted, self.period_s)

    def _snapshot(self, start_s: float, health: Health, waited_s: float) -> RobotState:
        supervisor, now = self.supervisor, self.clock.now()
        travel = self._travel()
        waiting = supervisor.phase in ("disarmed", "fault", "stopped")
        doing = self._homing.progress if self._homing else self.commissioning.report().doing
        if self.commissioning.running and supervisor.phase != "commissioning":
            # Whatever led out of it, STOP or a fault, is why it ended.
            self.commissioning.end(supervisor.cause or supervisor.phase)
            self.commissioning.forget()
            supervisor.homed = False
        return RobotState(
            robot=self.description.name,
            stamp=now,
            tick=self._tick,
            phase=supervisor.phase,
            cause=supervisor.cause or self._limited or doing,
            reasons=supervisor.arming_reasons(health, self._drive, now) if waiting else (),
            homed=supervisor.homed,
            epoch=self.authority.epoch,
            lease=self.authority.lease(now),
            accepted=self.authority.last_sequence,
            mode=self.motion.mode,
            commanded=tuple(self.motion.q.tolist()),
            measured=tuple(self._measured().tolist()),
            drives=drives_report(
                self.drivetrain.feedback, travel, self._setpoint, self.drivetrain.transmission, self._watched
            ),
            drops=dict(self.authority.drops + self._malformed + self.requests.malformed),
            channels=channels_report(self.drivetrain.bus),
            notes=self.drivetrain.bus.notes,
            bus=dict(self.drivetrain.bus.counts),
            timing=self._timing.tick(start_s, self.clock.now() - start_s - waited_s),
            tendons=self.tendons.report(),
            cells=cells_report(self.description, self.drivetrain.feedback.cells) if self.drivetrain.feedback else (),
            lock=self.locking.report(),
            commissioning=self.commissioning.report(),
            motion=self.motion.report(now),
        )

    def _travel(self) -> Floats:
        """Where the drives stand; before the first feedback where they are taken to be."""
        drivetrain = self.drivetrain
        if drivetrain.feedback is None:
            return drivetrain.travel_of(self.motion.q)
        return drivetrain.transmission.travel(drivetrain.feedback.angle)

    def _measured(self) -> Floats:
        """q from the motors' feedback alone."""
        return self.tendons.measured(self.motion.q) if self.drivetrain.feedback else self.motion.q

    def _tell_calibration(self, state: RobotState) -> None:
        """To whoever records, whenever another one is in force."""
        kept = self.commissioning.kept
        version = kept.version if kept else 0
        now = (state.homed, self.drivetrain.transmission.references, self.tendons.takeovers, version)
        if now != self._calibration:
            self._calibration = now
            self._calibrated(calibration_of(state.stamp, state.homed, self.drivetrain, self.tendons, kept))

    def _tell_changes(self, state: RobotState) -> None:
        """An event for every change of phase or cause, once."""
        told = (state.phase, self.supervisor.cause)
        pressed_or_let_go = {told[0], self._told[0]} == {"ready", "driving"}
        if told == self._told or pressed_or_let_go:
            self._told = told
            return
        level: Literal["info", "warning", "alarm"] = (
            "alarm" if state.phase in ("stopped", "fault") else "warning" if state.phase == "holding" else "info"
        )
        if state.phase != "stopped" or self._told[0] == "stopped":
            text = f"{state.phase}: {self.supervisor.cause}" if self.supervisor.cause else state.phase
            self._announce(Event(stamp=state.stamp, level=level, text=text))
        self._told = told
