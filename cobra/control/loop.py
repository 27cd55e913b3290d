"""The fixed-rate loop: one tick takes what arrived, moves what may move, exchanges once with the bus, and tells everybody.

commands → supervisor → motion → tendons → limits → motor bus → feedback → estimation → state
"""

import gc
import threading
from collections import Counter
from collections.abc import Callable

from cobra.clock import Clock
from cobra.control.arming import Switching, arming_acts
from cobra.control.arrivals import Arrivals
from cobra.control.authority import Authority
from cobra.control.cell_watch import CellWatch
from cobra.control.changes import Changes
from cobra.control.commissioning import Commissioning
from cobra.control.drivetrain import Drivetrain
from cobra.control.inbox import Inbox
from cobra.control.locking import Locking, locking_acts
from cobra.control.motion import Motion
from cobra.control.motion_requests import motion_acts
from cobra.control.outlets import guarded
from cobra.control.poses import PoseBook
from cobra.control.procedures import Procedures
from cobra.control.realtime import LOOP_PRIORITY, ask_for_realtime
from cobra.control.report import channels_report, drives_report, health_of
from cobra.control.setpoints import Setpoints
from cobra.control.supervisor import Health, Supervisor
from cobra.control.tendon_control import TendonControl
from cobra.control.tendon_requests import tendon_acts
from cobra.control.timing import LoopTiming
from cobra.control.witness import Witness
from cobra.description import RobotDescription
from cobra.messages import Calibration, Event, Heard, Reply, Request, RobotState
from cobra.motors.bus import MotorBus
from cobra.motors.bus_load import busiest
from cobra.motors.calibration import CalibrationBook
from cobra.motors.cell_readings import LoadCells

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
        self.period_s = 1.0 / description.teleop.loop_rate_Hz
        self.preparing = ""
        """Why it cannot be armed yet though the drives are well, in words; empty when it can."""
        self.quit_requested = False
        self._tick = 0
        self._timing = LoopTiming(self.period_s)
        # Where the bus needs most of the period, the next setpoint is computed while the frames are on the wire: a tick later,
        # but the rate is the bus's.
        self._overlapped = busiest(description) > OVERLAP

        self._dropped: Counter[str] = Counter()
        self._publish = guarded("publishing a state", publish, self._dropped)
        self._announce = guarded("announcing an event", announce, self._dropped)
        self._witness = Witness(guarded("telling a recorder", testify, self._dropped))

        poses = poses or PoseBook(description)
        self.inbox = Inbox()
        self.authority = Authority()
        self.supervisor = Supervisor()
        self.motion = Motion(description, poses)
        self.locking = Locking(description)
        self.drivetrain = Drivetrain(description, bus)
        self.tendons = TendonControl(self.drivetrain)
        self.setpoints = Setpoints(self.drivetrain, self.motion, self.tendons, self.locking, self.supervisor, self.warn)
        self._cells = CellWatch(description, self.supervisor, self.warn)
        self._arrivals = Arrivals(
            self.inbox, self.authority, self.supervisor, self.motion, self._announce, self._witness, self._dropped
        )
        switching = Switching(self.supervisor, self.setpoints, self._arrivals)
        self.commissioning = Commissioning(
            description,
            self.drivetrain,
            cells if cells is not None else LoadCells(description, clock),
            calibrations or CalibrationBook(description, None),
            switching.stand_ready,
            switching.refer,
            self.warn,
        )
        self._procedures = Procedures(
            self.drivetrain,
            self.setpoints,
            self.supervisor,
            self.commissioning,
            self.locking,
            self._arrivals.revoke,
            self._leave,
        )
        self._changes = Changes(
            self.supervisor,
            self.drivetrain,
            self.tendons,
            self.commissioning,
            self._announce,
            guarded("telling the calibration", calibrated, self._dropped),
        )
        self._arrivals.requests.acts.update(
            arming_acts(self.supervisor, self.setpoints, self._procedures, self._arrivals)
            | motion_acts(self.motion, poses, self.supervisor)
            | locking_acts(self.locking, self.supervisor, self.setpoints.shapes)
            | tendon_acts(self.tendons, self.setpoints, self.supervisor)
            | self.commissioning.acts
            | {"quit": self._quit}
        )

    def tick(self) -> RobotState:
        """One cycle; returns what it published."""
        start = self.clock.now()
        waited_s = self.drivetrain.bus.waited_s
        setpoints, arrivals = self.setpoints, self._arrivals
        if self._overlapped:
            # The bus first: what was computed while the last frames were on it, and nothing if it was taken back since. What
            # the drives said is looked at while these frames are on their way.
            self.drivetrain.send(setpoints.ahead)
            if self._tick:
                self.drivetrain.hear()
                self._watch_drives()
        arrivals.take_stops(start)
        arrivals.take_commands(start)
        health = self._health()
        if not self._overlapped:
            arrivals.take_requests(start, health)
        arrivals.choose_mode()
        moving = self.supervisor.tick(start, arrivals.drive, health)
        if self.supervisor.phase == "fault" and setpoints.current is not None:
            # Tendons that lost their pull would let the robot fall: the other drives keep standing.
            setpoints.switch_off(hold=True)
        self._decide(moving)
        if not self._overlapped:
            self.drivetrain.exchange(setpoints.current)
            self._watch_drives()
        setpoints.ahead = setpoints.current
        state = self._snapshot(start, health, self.drivetrain.bus.waited_s - waited_s)
        self._publish(state)
        self._witness.tell()
        self._changes.tell(state)
        if self._overlapped:
            self.drivetrain.gather()
            # Requests may speak to the drives themselves: not while others' replies are on their way.
            arrivals.take_requests(start, health)
        self._tick += 1
        return state

    def run(self, until: threading.Event) -> None:
        """Tick at the fixed rate until told to stop. A tick that is half a period late is not made up for."""
        self._timing.realtime = ask_for_realtime(LOOP_PRIORITY)
        _settle_memory()
        deadline = self.clock.now()
        while not until.is_set() and not self.quit_requested:
            self.tick()
            deadline += self.period_s
            now = self.clock.now()
            if now > deadline + 0.5 * self.period_s:
                deadline = now
            self.clock.sleep_until(deadline)

    def prepare(self) -> None:
        """Compile what the modes need, beside the loop: it cannot be armed before that is done."""
        self.preparing = PREPARING
        try:
            self.motion.warm_up()
            self.tendons.warm_up()
        finally:
            self.preparing = ""
            _settle_memory()
            # What was late meanwhile says nothing of driving.
            self._timing.restart()

    def abandon(self, leave: bool) -> None:
        """Nobody is there any more: take the description's final action, disarm and, with `leave`, ask to quit.

        Safe from any thread: the next tick begins it.
        """
        self._procedures.abandon(leave)

    def warn(self, text: str) -> None:
        """Tell people something that is no state of the robot's. Safe from any thread."""
        self._announce(Event(stamp=self.clock.now(), level="warning", text=text))

    def _health(self) -> Health:
        health = health_of(self.description, self.drivetrain.feedback, self.drivetrain.gone, self.setpoints.watched)
        return Health(blocking=(self.preparing, *health.blocking), faults=health.faults) if self.preparing else health

    def _decide(self, moving: bool) -> None:
        """The next setpoint: a procedure's, else the driver's."""
        setpoints, phase = self.setpoints, self.supervisor.phase
        holds = setpoints.current is not None and phase in ("ready", "driving", "holding")
        self.tendons.observe(self.motion.q, self.motion.velocity, self.period_s, holds)
        if self._procedures.step(self.period_s) or setpoints.current is None:
            return
        drive = self._arrivals.drive
        intent = drive.command.intent if moving and drive else None
        setpoints.current = setpoints.move(setpoints.current, intent, self.period_s)

    def _watch_drives(self) -> None:
        self._cells.step(self.drivetrain.feedback)
        self.setpoints.watch(self.period_s)

    def _leave(self) -> None:
        self.quit_requested = True

    def _quit(self, request: Request, now_s: float, health: Health) -> Reply:
        self._leave()
        return Reply(ok=True)

    def _snapshot(self, start_s: float, health: Health, waited_s: float) -> RobotState:
        supervisor, now = self.supervisor, self.clock.now()
        setpoints = self.setpoints
        waiting = supervisor.phase in ("disarmed", "fault", "stopped")
        limited = setpoints.limited if supervisor.phase == "driving" else ""
        return RobotState(
            robot=self.description.name,
            stamp=now,
            tick=self._tick,
            phase=supervisor.phase,
            cause=supervisor.cause or limited or self._procedures.doing,
            reasons=supervisor.arming_reasons(health, self._arrivals.drive, now) if waiting else (),
            homed=supervisor.homed,
            epoch=self.authority.epoch,
            stops=tuple(self._arrivals.stops),
            lease=self.authority.lease(now),
            accepted=self.authority.last_sequence,
            mode=self.motion.mode,
            commanded=tuple(self.motion.q.tolist()),
            measured=tuple(setpoints.measured().tolist()),
            drives=drives_report(
                self.drivetrain.feedback,
                setpoints.travel(),
                setpoints.current,
                self.drivetrain.transmission,
                setpoints.watched,
            ),
            drops=dict(self.authority.drops + self._dropped + self._arrivals.requests.malformed),
            channels=channels_report(self.drivetrain.bus),
            notes=self.drivetrain.bus.notes,
            bus=dict(self.drivetrain.bus.counts),
            timing=self._timing.tick(start_s, self.clock.now() - start_s - waited_s),
            tendons=self.tendons.report(),
            cells=self._cells.report(self.drivetrain.feedback),
            lock=self.locking.report(),
            commissioning=self.commissioning.report(),
            motion=self.motion.report(now),
        )


def _settle_memory() -> None:
    """What is there stays: the interpreter need not go through all of it again and again, in the middle of a tick."""
    gc.collect()
    gc.freeze()
