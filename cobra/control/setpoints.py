"""What the drives are told: where they stand when they are switched on, the zero that homing found, and the driver's motion.

Whoever takes over goes on from the last setpoint: nothing jumps.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cobra.control.drive_watch import DriveWatch, Watched
from cobra.control.drivetrain import Drivetrain
from cobra.control.limits import DriveLimits
from cobra.control.locking import Locking
from cobra.control.motion import Motion
from cobra.control.supervisor import Supervisor
from cobra.control.tendon_control import TendonControl
from cobra.messages import Intent
from cobra.motors.bus import BusError, Feedback

Floats = NDArray[np.float64]

BIAS_RATE = 0.002
"""After arming with bent tendons, their difference to the model is taken up at this speed [m/s]."""


class Setpoints:
    """`current` is the travel (drives,) that the drives are told; None while they are off."""

    def __init__(
        self,
        drivetrain: Drivetrain,
        motion: Motion,
        tendons: TendonControl,
        locking: Locking,
        supervisor: Supervisor,
        warn: Callable[[str], None],
    ) -> None:
        self.current: Floats | None = None
        self.ahead: Floats | None = None
        """The next one, where the bus is so busy that it is computed a tick before it is sent."""
        self.limited = ""
        """What limits the motion, in words; empty when nothing does."""
        self.watched: Watched | None = None
        """What the drives' watch says of the last feedback."""
        self.limits = DriveLimits(drivetrain.description)
        self._drivetrain = drivetrain
        self._motion = motion
        self._tendons = tendons
        self._locking = locking
        self._supervisor = supervisor
        self._warn = warn
        self._watch = DriveWatch(drivetrain.description)
        self._bias = np.zeros(len(drivetrain.description.drives))

    # ------------------------------------------------------------------ on and off

    def switch_on(self) -> tuple[str, ...]:
        """The drives take setpoints from where they stand. What prevents it, in words."""
        try:
            reasons = self._drivetrain.bus.enable()
        except BusError as error:
            reasons = (str(error),)
        if reasons or self._drivetrain.feedback is None:
            return reasons or ("the motors have not answered yet",)
        self._drivetrain.exchange(None)
        self.start(self._drivetrain.feedback)
        return ()

    def start(self, feedback: Feedback) -> None:
        """Bumpless: the first setpoint is where the drives stand."""
        drivetrain = self._drivetrain
        self._watch.forget()
        self.watched = None
        if not self._supervisor.homed:
            self._take_tendons(feedback.angle, self._motion.configuration.rest())
        self.current = drivetrain.transmission.travel(feedback.angle)
        self._motion.reset(self.measured())
        self._tendons.resume(self._motion.q, self.current)
        self._locking.reset(self._motion.q)
        self.go_on()

    def switch_off(self, hold: bool = False) -> None:
        """No more setpoints; the drives lose their torque, or with `hold` keep standing where they are."""
        self.current = self.ahead = None
        self._drivetrain.switch_off(hold)

    # ------------------------------------------------------------------ where it stands

    def travel(self) -> Floats:
        """(drives,) of the feedback; before the first one where they are taken to be."""
        drivetrain = self._drivetrain
        if drivetrain.feedback is None:
            return drivetrain.travel_of(self._motion.q)
        return drivetrain.transmission.travel(drivetrain.feedback.angle)

    def measured(self) -> Floats:
        """q from the motors' feedback alone."""
        return self._tendons.measured(self._motion.q) if self._drivetrain.feedback else self._motion.q

    def shapes(self) -> tuple[Floats, Floats]:
        """q as commanded and as measured."""
        return self._motion.q, self.measured()

    def watch(self, dt_s: float) -> None:
        """Look at what the drives said."""
        drivetrain = self._drivetrain
        if drivetrain.feedback is not None and not drivetrain.gone:
            wanted = None if self.current is None else drivetrain.transmission.angle(self.current)
            self.watched = self._watch.step(drivetrain.feedback, wanted, dt_s)

    def refer(self, angle: Floats, travel: Floats) -> None:
        """Take the shafts' angles (drives,) for this travel (drives,), homed, though nothing moved."""
        self._drivetrain.refer(angle, travel)
        self._supervisor.homed = True
        self._motion.reset(self.measured())
        self._locking.reset(self._motion.q)

    def take_zero(self, target: Floats) -> Floats:
        """Homed: tendons carry their pretension at this travel (drives,). The same place, counted from the zero."""
        home = self._take_tendons(self._drivetrain.transmission.angle(target), self._motion.configuration.home())
        self._motion.reset(home)
        self._locking.reset(home)
        self._bias = np.zeros_like(self._bias)
        travel = self._drivetrain.travel_of(home)
        self._tendons.homed(home, travel)
        return travel

    def _take_tendons(self, angle: Floats, q: Floats) -> Floats:
        """The tendons stand at q; returns it with twist and feed where they stand, which homing does not find anew."""
        q, lost = self._drivetrain.refer_tendons(angle, q)
        for words in lost:
            self._warn(words)
        return q

    # ------------------------------------------------------------------ motion

    def go_on(self) -> None:
        """Stay where the drives are told to be: the difference to what the tendons' model asks is taken up while driving."""
        if self.current is not None:
            self._bias = self.current - self._tendons.travel(self._motion.q, 0.0)

    def retake(self) -> None:
        """The tendons' model asks for other travels from now on: go on from here all the same."""
        if self.current is None:
            return
        self._tendons.resume(self._motion.q, self.current)
        if self._supervisor.phase != "homing":
            self.go_on()

    def move(self, setpoint: Floats, intent: Intent | None, dt_s: float) -> Floats:
        """The next travel (drives,) after `setpoint`, by the driver's intent; None ramps every motion to rest."""
        motion, tendons, moving = self._motion, self._tendons, intent is not None
        q, velocity = motion.propose(intent, dt_s)
        restrained = self._locking.restrain(motion.q, motion.velocity, q, moving, dt_s)
        if restrained is not q:
            q, velocity = restrained, (restrained - motion.q) / dt_s
        if moving:
            self._bias = np.sign(self._bias) * np.maximum(np.abs(self._bias) - BIAS_RATE * dt_s, 0.0)
        step = self._drivetrain.travel_of(q) - self._drivetrain.travel_of(motion.q)
        allowed = self.limits.allow(setpoint, step, tendons.loads(), dt_s)
        share, reason = tendons.allow(step)
        scale = min(allowed.scale, share)
        self.limited = allowed.reason or reason
        if scale < 1.0:
            q = motion.q + scale * (q - motion.q)
            velocity = velocity * scale
        q = tendons.give_way(q, moving, dt_s)
        motion.take(q, velocity)
        self._locking.observe(q, self.measured())
        self._watch_tendons(setpoint, dt_s)
        return self.limits.paced(setpoint, tendons.travel(q, dt_s) + self._bias, dt_s)

    def _watch_tendons(self, setpoint: Floats, dt_s: float) -> None:
        known = len(self._tendons.faults)
        self._tendons.watch(setpoint, dt_s)
        for fault in self._tendons.faults[known:]:
            self._supervisor.hold(f"{fault}. Let go, look, press again to go on.")
            self._warn(fault)
