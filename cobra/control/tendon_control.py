"""Tendons between configuration and drives: estimation, compensation and tension together, one call each a tick.

Robots without tendons, or whose sections change their length, are driven by the tendon map alone; chambers take no shape
in which a cable would have to push.
"""

from pathlib import Path

import numpy as np

from cobra.control.compensation import Compensation
from cobra.control.drivetrain import Drivetrain
from cobra.control.estimation import Estimator, TendonEstimate
from cobra.control.tendon_health import TendonHealth
from cobra.control.tension import TensionKeeper
from cobra.description import RobotDescription
from cobra.kinematics.backbone import Backbone
from cobra.kinematics.configuration import Configuration, Floats
from cobra.kinematics.ramps import shortened
from cobra.mechanics.losses import Identified, described, load
from cobra.mechanics.rubbing import Rubbing
from cobra.mechanics.slack_shape import SlackShape
from cobra.mechanics.stuck import StuckTendons
from cobra.messages import CompensationState, Tendons

MOVING_RAD_S = 1e-3
"""Slower motions are at rest."""

LEVEL_M_S = 0.001
"""At which all tendons are wound in or out to another pretension."""
LEVEL_REACHED_M = 2e-5


class TendonControl:
    """`observe` what the drives say, then ask for their `travel`. `homed` tells where the tendons' zero is."""

    def __init__(self, drivetrain: Drivetrain) -> None:
        self.description: RobotDescription = drivetrain.description
        self._drivetrain = drivetrain
        self._configuration, self._backbone = Configuration(self.description), Backbone(self.description)
        self._next: Identified | None = None
        self.takeovers = 0
        """How often loss parameters were taken over."""
        self._level_N: float | None = None
        self._target: Floats | None = None
        """Of the tendons (m,), without what the keeper changes of it."""
        self._wound_m = 0.0
        """All tendons wound in alike, beyond what homing found."""
        self._index = drivetrain.tendon_index
        chambers = bool(self.description.tendon_names) and all(s.elongation for s in self.description.sections)
        self._slack = SlackShape(self.description, drivetrain.tendons) if chambers else None
        self.available = fits(self.description)
        """Whether this robot's tendons can be compensated at all."""
        self.enabled = self.available and (
            self.description.compensation is None or self.description.compensation.enabled
        )
        self.estimate: TendonEstimate | None = None
        self._referred = self._driven = False
        if self.available:
            wanted = self.description.compensation
            self.use(
                load(Path(wanted.parameters), self.description)
                if wanted is not None and wanted.parameters
                else described(self.description)
            )

    def use(self, identified: Identified) -> None:
        """Take other parameters; they count from the next homing on."""
        self.identified = identified
        self.model = Rubbing(self.description, identified.losses)
        self._estimator = Estimator(self.description, self.model, identified)
        self._compensation = Compensation(self.model)
        self._keeper = TensionKeeper(self.description, self.model, identified)
        self._health = TendonHealth(self.description, self.model, identified)
        self._last_q = self.model.tendons.rest
        self.estimate = None
        self._referred = False
        self.takeovers += 1

    def warm_up(self) -> None:
        """Compile what the tendons' model needs: seconds the first time on a machine. Not while driving."""
        if self.available:
            model = Rubbing(self.description, self.identified.losses)
            model.warm_up()
            StuckTendons(model, 1).advance(np.zeros(len(self._index)))

    def prepare(self, identified: Identified) -> None:
        """Take these parameters when it is homed next."""
        self._next = identified

    @property
    def active(self) -> bool:
        """Whether the drives are told a compensated travel now."""
        return self.enabled and self._referred

    def homed(self, q: Floats, travel: Floats) -> None:
        """The robot stands straight and at pretension, at this q and this travel of all drives."""
        if not self.available:
            return
        if self._next is not None:
            self.use(self._next)
            self._next = None
        self._estimator.refer(travel, self._drivetrain.loads(), self._drivetrain.measured_tensions())
        self._compensation.resume(travel[self._index], self._estimator.spool_m)
        self._last_q = q
        self._keeper.reset()
        self._target = None
        self._health.reset()
        self._referred = self._driven = True
        self._level_N, self._wound_m = None, 0.0

    def tighten(self, tension_N: float) -> str:
        """Bring the mean tension to another level, all tendons by the same length. Why it will not, in words; else empty."""
        tendon = self.description.tendon
        if not self._referred or tendon is None:
            return "home it first: the tendons' tension is not known yet"
        if not tendon.min_tension_N < tension_N < tendon.max_tension_N:
            return f"{tension_N:g} N: must be between {tendon.min_tension_N:g} and {tendon.max_tension_N:g} N"
        self._level_N = tension_N
        return ""

    def _step_level(self, dt_s: float) -> None:
        if self._level_N is None or self.estimate is None:
            return
        missing = self._level_N - float(np.mean(self.estimate.motor_N))
        reach = abs(missing) / float(np.mean(self.model.stiffness_N_m))
        self._wound_m += float(np.sign(missing)) * min(LEVEL_M_S * dt_s, 0.1 * reach)
        if reach < LEVEL_REACHED_M:
            self._level_N = None

    def resume(self, q: Floats, setpoint: Floats) -> None:
        """Setpoints go on from this one (drives,), where q is commanded. No trims before they are driven."""
        self._driven = False
        if self.available:
            self._compensation.resume(setpoint[self._index] + self._wound_m, self._estimator.spool_m)
            self._last_q = q
            self._keeper.reset()
            self._target = None
            self._health.reset()

    def observe(self, q: Floats, velocity: Floats, dt_s: float, holds: bool) -> None:
        """Take the drives' last feedback, for the commanded q and its velocity; `holds`: setpoints are sent."""
        drivetrain = self._drivetrain
        if not self._referred or drivetrain.feedback is None:
            return
        transmission, feedback = drivetrain.transmission, drivetrain.feedback
        speed = feedback.velocity * transmission.travel_per_rad
        travel = transmission.travel(feedback.angle)
        measured = drivetrain.measured_tensions()
        self.estimate = self._estimator.observe(travel, speed, drivetrain.loads(), measured, q, dt_s)
        if not holds:
            return
        self._step_level(dt_s)
        if self.enabled:
            self._driven = self._driven or bool(np.any(np.abs(velocity) > MOVING_RAD_S))
            if self._driven:
                coming = self._target + self._keeper.offset_m - travel[self._index] if self._target is not None else 0.0
                self._keeper.observe(self.estimate, np.zeros(len(self._index)) + coming, dt_s)

    def watch(self, setpoint: Floats, dt_s: float) -> None:
        """Look for tendons that do not do what they should; only while the drives hold them."""
        if self.active and self._driven and self.estimate is not None:
            self._health.observe(self.estimate, setpoint[self._index], dt_s)

    def allow(self, step: Floats) -> tuple[float, str]:
        """Which share of a step of all drives (by the tendon map) their tensions allow, and why not all, in words."""
        if not self.active or self.estimate is None:
            return 1.0, ""
        feed = self.description.feed_drive
        return self._keeper.allow(step[self._index], 0.0 if feed is None else float(step[feed]))

    def give_way(self, q: Floats, driven: bool, dt_s: float) -> Floats:
        """q, or where it goes because its tendons would hang slack, or their tensions do not let it be held, or it is pushed."""
        if self._slack is not None:
            return self._slack.shape(self._drivetrain.tendons.lengths(q), q)
        if not self.active or self.estimate is None:
            return q
        ways = self._keeper.give_way(dt_s)
        if driven:
            ways = ways + self._pushed_away(dt_s)
        if not np.any(ways):
            return q
        out = q.copy()
        out[self.model.tendons.columns] += ways
        limits = self._backbone.bend_limits(q)
        for i, where in enumerate(self._configuration.bends):
            step = shortened(out[where] - q[where], self._configuration.rate[where.start] * dt_s)
            out[where] = shortened(q[where] + step, max(float(limits[i]), float(np.linalg.norm(q[where]))))
        return out

    def _pushed_away(self, dt_s: float) -> Floats:
        """(c,) with admittance: bends go with the moments from outside, beyond those that friction may pretend."""
        outside, wanted = self._estimator.outside_Nm, self.description.compensation
        if wanted is None or wanted.admittance_rad_s_Nm == 0.0:
            return np.zeros_like(outside)
        beyond = np.sign(outside) * np.maximum(np.abs(outside) - wanted.admittance_from_Nm, 0.0)
        return beyond * (wanted.admittance_rad_s_Nm * dt_s)

    def loads(self) -> Floats:
        """Loads of all drives, those of tendons without their gears' friction."""
        loads = self._drivetrain.loads()
        if self.estimate is not None and self._referred:
            loads[self._index] = self.estimate.motor_N
        return loads

    def travel(self, q: Floats, dt_s: float) -> Floats:
        """Travel of all drives for q, `dt_s` after the last call; 0 changes nothing."""
        travel = self._drivetrain.travel_of(q)
        target = travel[self._index] - self._wound_m
        if self.active:
            velocity = (q - self._last_q) / dt_s if dt_s > 0.0 else np.zeros_like(q)
            moving = bool(np.any(velocity))
            if moving:
                extra = self._keeper.trims_m - self._wound_m
                spool, outside = self._estimator.spool_m, self._estimator.outside_Nm
                self._compensation.step(q, velocity, extra, spool, outside, dt_s)
            target = self._compensation.travel() - self._wound_m
            if dt_s > 0.0 and self._target is not None:
                self._keeper.step(target - self._target, moving, dt_s)
            target, self._target = target + self._keeper.offset_m, target
        self._last_q = q
        travel[self._index] = target
        return travel

    def measured(self, near: Floats) -> Floats:
        """q from the motors' feedback alone; what no drive moves is taken from `near`."""
        drivetrain = self._drivetrain
        if drivetrain.feedback is None:
            return near
        travel = drivetrain.transmission.travel(drivetrain.feedback.angle)
        q = drivetrain.q_of(travel, near)
        if self._slack is not None:
            return self._slack.shape(travel[self._index], q)
        if self.estimate is not None and self._referred and self.enabled:
            q[self.model.tendons.columns] = self.estimate.bends
        return q

    def report(self) -> Tendons:
        """For everybody to see."""
        if not self.available:
            return Tendons()
        words: CompensationState = "on" if self.enabled else "off"
        if self.estimate is None or not self._referred:
            return Tendons(compensation=words, parameters=self.identified.source)
        q = np.zeros(len(self.model.tendons.rest))
        q[self.model.tendons.columns] = self.estimate.deviation
        return Tendons(
            compensation=words,
            parameters=self.identified.source,
            tension=tuple(self.estimate.motor_N.tolist()),
            profile=tuple(tuple(row) for row in self.estimate.profile_N.tolist()),
            deviation=tuple(q.tolist()),
            residual=tuple(self.estimate.residual_m.tolist()),
            warnings=(*self._health.faults, *self._keeper.warnings) if self.enabled else (),
        )

    @property
    def faults(self) -> tuple[str, ...]:
        """Tendons that are broken, slipped or jammed, in words."""
        return self._health.faults if self.available and self.active else ()


def fits(description: RobotDescription) -> bool:
    """Whether a robot has tendons on sections of constant length."""
    return (
        description.tendon is not None
        and bool(description.tendon_names)
        and all(section.elongation is None for section in description.sections)
    )
