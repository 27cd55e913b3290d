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
from cobra.control.final_action import FinalAction
from cobra.control.inbox import Inbox
from cobra.control.limits import DriveLimits
from cobra.control.motion import SectionMotion
from cobra.control.realtime import LOOP_PRIORITY, ask_for_realtime
from cobra.control.report import drives_report, health_of
from cobra.control.supervisor import Drive, Health, Supervisor
from cobra.control.timing import LoopTiming
from cobra.description import RobotDescription
from cobra.kinematics.configuration import FEED, TWIST
from cobra.kinematics.tendons import TendonMap
from cobra.messages import Command, Event, Reply, Request, RobotState, Stop, decode
from cobra.motors.bus import BusError, Feedback, MotorBus
from cobra.motors.homing import Homing, HomingError
from cobra.motors.transmission import Transmission

Floats = NDArray[np.float64]

BIAS_RATE = 0.002
"""After arming with bent tendons, their difference to the model is taken up at this speed [m/s]."""


class RobotLoop:
    """Owns the motor bus. `tick` is one cycle; `run` repeats it at the description's rate."""

    def __init__(
        self,
        description: RobotDescription,
        bus: MotorBus,
        clock: Clock,
        publish: Callable[[RobotState], None],
        announce: Callable[[Event], None],
    ) -> None:
        self.description = description
        self.bus = bus
        self.clock = clock
        self.inbox = Inbox()
        self.authority = Authority()
        self.supervisor = Supervisor()
        self.motion = SectionMotion(description)
        self.period_s = 1.0 / description.teleop.loop_rate_Hz
        self.quit_requested = False
        self._publish = publish
        self._announce = announce
        self._tendons = TendonMap(description)
        self._tendon_index = np.array(description.tendon_drives, dtype=np.int64)
        self._transmission = Transmission(description)
        self._limits = DriveLimits(description)
        self._timing = LoopTiming(self.period_s)
        self._homing: Homing | None = None
        self._final: FinalAction | None = None
        self._abandoned: Literal["", "leave", "stay"] = ""
        self._drive: Drive | None = None
        self._feedback: Feedback | None = None
        self._setpoint: Floats | None = None
        self._bias = np.zeros(len(description.drives))
        self._malformed: Counter[str] = Counter()
        self._limited = ""
        self._gone = ""
        self._tick = 0
        self._told: tuple[str, str] = ("", "")

    # ------------------------------------------------------------------ one tick

    def tick(self) -> RobotState:
        start = self.clock.now()
        self._take_stops(start)
        self._take_commands(start)
        health = health_of(self.description, self._feedback, self._gone)
        self._take_requests(start, health)
        moving = self.supervisor.tick(start, self._drive, health)
        if self.supervisor.phase == "fault" and self._setpoint is not None:
            # Tendons that lost their pull would let the robot fall: the other drives keep standing.
            self._switch_off(hold=True)
        self._exchange(self._next_setpoint(moving))
        state = self._snapshot(start, health)
        self._publish(state)
        self._tell_changes(state)
        self._tick += 1
        return state

    def abandon(self, leave: bool) -> None:
        """Nobody is there any more: take the description's final action, disarm and, with `leave`, ask to quit.

        Safe from any thread: the next tick begins it.
        """
        self._abandoned = "leave" if leave else "stay"

    def run(self, until: threading.Event) -> None:
        """Tick at the fixed rate until told to stop. Missed deadlines are skipped, not made up for."""
        self._timing.realtime = ask_for_realtime(LOOP_PRIORITY)
        gc.collect()
        gc.freeze()
        deadline = self.clock.now()
        while not until.is_set() and not self.quit_requested:
            self.tick()
            deadline += self.period_s
            now = self.clock.now()
            deadline = max(deadline, now)
            self.clock.sleep_until(deadline)

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
            if self.authority.accept(command, now_s) is None:
                self._drive = Drive(command, now_s)

    def _take_requests(self, now_s: float, health: Health) -> None:
        while self.inbox.requests:
            asked = self.inbox.requests.popleft()
            try:
                request = decode(asked.data, Request)
            except msgspec.MsgspecError:
                self._malformed["malformed request"] += 1
                asked.answer(Reply(ok=False, reasons=("the request could not be read",)))
                continue
            asked.answer(self._answer(request, now_s, health))

    def _answer(self, request: Request, now_s: float, health: Health) -> Reply:
        match request.what:
            case "acquire" | "take" | "retain" | "release":
                return self._answer_lease(request, now_s)
            case _ if not self.authority.holds(request.lease):
                return Reply(ok=False, reasons=("only the driver may do this: take the controls first",))
            case "arm":
                return self._arm(now_s, health)
            case "home":
                return self._home(health)
            case "disarm":
                self._switch_off()
                self.supervisor.disarmed()
            case "clear":
                if self.supervisor.phase != "stopped":
                    return Reply(ok=False, reasons=("there is no STOP to clear",))
                self.supervisor.clear()
            case "quit":
                self.quit_requested = True
        return Reply(ok=True, epoch=self.authority.epoch)

    def _answer_lease(self, request: Request, now_s: float) -> Reply:
        if request.what == "retain":
            ok = self.authority.retain(request.lease, now_s)
            return Reply(ok=ok, epoch=self.authority.epoch, reasons=() if ok else ("this lease is over",))
        if request.what == "release":
            ok = self.authority.release(request.lease)
            if ok:
                self._drive = None
            return Reply(ok=ok, epoch=self.authority.epoch)
        lease = (
            self.authority.take(request.who, now_s)
            if request.what == "take"
            else self.authority.acquire(request.who, now_s)
        )
        if lease is None:
            holder = self.authority.lease(now_s).holder
            return Reply(ok=False, reasons=(f"{holder} drives",), epoch=self.authority.epoch)
        self._drive = None
        self._announce(Event(stamp=now_s, level="info", text=f"{request.who or 'somebody'} took the controls"))
        return Reply(ok=True, lease=lease, epoch=self.authority.epoch)

    # ------------------------------------------------------------------ arming and homing

    def _arm(self, now_s: float, health: Health) -> Reply:
        if self.supervisor.phase not in ("disarmed", "fault"):
            return Reply(ok=False, reasons=("it is armed already",))
        # A fault is cleared by enabling the motors, or is named again.
        reasons = self.supervisor.arming_reasons(Health(blocking=health.blocking), self._drive, now_s)
        if reasons:
            return Reply(ok=False, reasons=reasons)
        try:
            reasons = self.bus.enable()
        except BusError as error:
            reasons = (str(error),)
        if reasons or self._feedback is None:
            return Reply(ok=False, reasons=reasons or ("the motors have not answered yet",))
        self._exchange(None)
        self._start_from_measured(self._feedback)
        if not self.supervisor.homed:
            self._homing = Homing(self.description, self._tendons.bending)
        self.supervisor.armed()
        return Reply(ok=True, epoch=self.authority.epoch)

    def _home(self, health: Health) -> Reply:
        if self.supervisor.phase not in ("ready", "holding"):
            return Reply(ok=False, reasons=("arm it first; homing needs the drives on and standing still",))
        if health.blocking:
            return Reply(ok=False, reasons=health.blocking)
        self._homing = Homing(self.description, self._tendons.bending)
        self.supervisor.start_homing()
        return Reply(ok=True, epoch=self.authority.epoch)

    def _start_from_measured(self, feedback: Feedback) -> None:
        """Bumpless: the first setpoint after switching on is where the drives stand."""
        if not self.supervisor.homed:
            rest = self._travel_of(self.motion.configuration.rest())
            self._transmission.refer(feedback.angle, rest)
        self._setpoint = self._transmission.travel(feedback.angle)
        self.motion.reset(self._measured(self._setpoint))
        self._bias = self._setpoint - self._travel_of(self.motion.q)

    def _switch_off(self, hold: bool = False) -> None:
        """No more setpoints; the drives lose their torque, or with `hold` keep standing where they are."""
        self._setpoint = None
        self._homing = None
        try:
            if hold:
                self.bus.hold()
            else:
                self.bus.disable()
        except BusError as error:
            self._gone = str(error)

    # ------------------------------------------------------------------ setpoints

    def _next_setpoint(self, moving: bool) -> Floats | None:
        if self._abandoned:
            return self._step_final()
        if self._setpoint is None:
            return None
        if self.supervisor.phase == "homing":
            self._setpoint = self._step_homing(self._setpoint)
        else:
            self._homing = None
            self._setpoint = self._step_motion(moving, self._setpoint)
        return self._setpoint

    def _step_homing(self, setpoint: Floats) -> Floats:
        if self._homing is None or self._feedback is None:
            return setpoint
        try:
            target = self._homing.step(setpoint, self._transmission.load(self._feedback.current), self.period_s)
        except HomingError as error:
            self.supervisor.homing_failed(str(error))
            return setpoint
        if not self._homing.done:
            return target
        # Zero is where the tendons carry their pretension now; twist and feed keep what they are taken for.
        rest = self._travel_of(self.motion.configuration.rest())
        self._transmission.refer(self._transmission.angle(target), rest)
        self.motion.reset(self.motion.configuration.rest())
        self._bias = np.zeros_like(self._bias)
        self.supervisor.homing_done()
        return rest

    def _step_final(self) -> Floats | None:
        if self._final is None:
            self._final = FinalAction(self.description)
            self.authority.revoke()
            self._drive = None
        if self._setpoint is not None and self._feedback is not None and not self._final.done:
            load = self._transmission.load(self._feedback.current)
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
        if moving:
            self._bias = np.sign(self._bias) * np.maximum(np.abs(self._bias) - BIAS_RATE * self.period_s, 0.0)
        target = self._travel_of(q) + self._bias
        load = self._transmission.load(self._feedback.current) if self._feedback else np.zeros_like(target)
        allowed = self._limits.allow(setpoint, target - setpoint, load, self.period_s)
        self._limited = allowed.reason
        if allowed.scale < 1.0:
            q = self.motion.q + allowed.scale * (q - self.motion.q)
            velocity = velocity * allowed.scale
            target = setpoint + allowed.scale * (target - setpoint)
        self.motion.take(q, velocity)
        return self._limits.clamp(target)

    def _travel_of(self, q: Floats) -> Floats:
        """Travel of all drives for a configuration."""
        travel = np.zeros(len(self.description.drives))
        travel[self._tendon_index] = self._tendons.lengths(q)
        if self.description.twist_drive is not None:
            travel[self.description.twist_drive] = q[TWIST]
        if self.description.feed_drive is not None:
            travel[self.description.feed_drive] = q[FEED]
        return travel

    def _measured(self, travel: Floats) -> Floats:
        """q from the drives' travel alone (least squares over all tendons)."""
        q = self.motion.q.copy()
        if self.description.twist_drive is not None:
            q[TWIST] = travel[self.description.twist_drive]
        if self.description.feed_drive is not None:
            q[FEED] = travel[self.description.feed_drive]
        return self._tendons.shape(travel[self._tendon_index], q).q

    # ------------------------------------------------------------------ the bus

    def _exchange(self, travel: Floats | None) -> None:
        try:
            self._feedback = self.bus.exchange(None if travel is None else self._transmission.angle(travel))
            self._gone = ""
        except BusError as error:
            self._gone = str(error)

    # ------------------------------------------------------------------ what it tells

    def _snapshot(self, start_s: float, health: Health) -> RobotState:
        supervisor, now = self.supervisor, self.clock.now()
        travel = self._transmission.travel(self._feedback.angle) if self._feedback else self._travel_of(self.motion.q)
        waiting = supervisor.phase in ("disarmed", "fault", "stopped")
        doing = self._homing.progress if self._homing else ""
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
            mode=self._drive.command.mode if self._drive else "section",
            commanded=tuple(self.motion.q.tolist()),
            measured=tuple(self._measured(travel).tolist()),
            drives=drives_report(self._feedback, travel, self._setpoint, self._transmission),
            drops=dict(self.authority.drops + self._malformed),
            bus=dict(self.bus.counts),
            timing=self._timing.tick(start_s, self.clock.now() - start_s),
        )

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
