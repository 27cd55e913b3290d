"""Find the zero of every tendon: pay out, wind to contact, let go, draw in together, tighten, dither; take that as zero.

Current alone is a poor witness (a jammed spool draws some too), so contact needs tension and a drive at rest for a hold
time, and travel and time are bounded. Friction along the tendons holds whatever bend it likes while each drive reads the
same tension. So the tendons are let go until the body is straight, and drawn in together: then all slide the same way, and
equal tensions keep it straight, if their conduits are alike. For those that are not, all are pulled to and fro (`dither`).
Where nothing rubs along the tendons, they are settled finely in the end. Where the sections can be pulled together to a
stop, that stop is the reference instead: against it a tendon's force rises so steeply with its length that neither a
gear's friction nor a coarse current reading matters.
"""

from enum import Enum

import numpy as np
from numpy.typing import NDArray

from cobra.description import RobotDescription, Tendon
from cobra.motors.dither import Dither
from cobra.motors.pretension import pretension_shares
from cobra.motors.seating import Seating, has_stop
from cobra.motors.settling import Settling

Floats = NDArray[np.float64]

SLACK_M = 0.002
"""At least this much is paid out, and then more until no tension changes any more: a bent body is slow to straighten."""
MAX_SLACK_M = 0.030
SLACK_SPEED_M_S = 0.02
LOOK_BACK_S = 0.3
STILL_CHANGING = 0.02
"""Of the pretension: a smaller change over the look-back is none."""
SURELY = 3.0
"""Times what a taut tendon must be paid out, by the body's stiffness, to show a change: the least that is looked back on."""
FREE_M = 0.0005
"""Wound in before the free reading is taken: by then the gear turns, and what it draws is friction alone."""
WIND_SPEED_M_S = 0.012
MAX_WIND_M = 0.040
"""Beyond where a tendon stood before it was paid out: a bent robot's outer tendons have become slack."""
CONTACT_FRACTION = 0.25
"""Of the pretension: a tendon that carries this much is wound far enough."""
CONTACT_HOLD_S = 0.03
AT_REST = 0.25
"""Of the speed of winding: a drive that still turns faster has not met its tendon's pull."""
TOUCH_FRACTION = 0.03
"""Of the pretension: less is none."""
LOOSE_M = 0.002
"""Paid out beyond the last tension,"""
MAX_LOOSE_M = 0.040
"""but no further than this."""
STRAIGHTEN_S = 0.5
"""In which the body straightens when nothing pulls."""
DRAW_SPEED_M_S = 0.004
RISE_S = 1.5
"""In which the tension rises while all are drawn in."""
LIGHT_FRACTION = 0.3
"""Of the pretension, up to which they are drawn in each by its tension; the rest by about the same length."""
APPROACH_S = 0.1
"""In which a missing tension is approached."""
TOLERANCE = 0.004
"""Of the pretension."""
GOOD_READINGS = 3
"""In a row."""
LEAST_SPEED_M_S = 2e-4
TIGHTENING_GROWTH = 1.3
"""A tick."""
RUBBING_RISE_S = 2.5
"""In which rubbing tendons are tightened: long enough to tell their tensions apart finer than by one count."""
EVENING_S = 0.1
"""In which the difference of a tendon's tension to the others' is found, and again in which it is wound away."""
EVENING_SHARE = 0.7
"""Of the tightening speed: so every tendon is always wound in."""
STRETCHES = 0.25
"""Of the described stretch: tendons that stretch less than that are not pulled to and fro, it would be too hard."""
PULL_MARGIN = 0.6
"""Of the pretension, beyond the amplitude: no tendon is pulled harder while they are pulled to and fro."""
UNEVEN = 0.5
"""Of the pretension: tensions differ by less after the stop."""
TIMEOUT_S = 30.0
CONTACT_COUNTS = 2.5
"""A rise of the current by fewer counts is no contact. Between counts, where rounding decides nothing."""


class HomingError(RuntimeError):
    """Homing cannot go on. The message says which tendon and why."""


class _Stage(Enum):
    SLACK = "paying out"
    WIND = "winding to contact"
    LET_GO = "letting go"
    DRAW = "drawing all tendons in"
    TIGHTEN = "tightening to pretension"
    DITHER = "pulling to and fro until friction has settled"
    SETTLE = "settling at pretension"
    SEAT = "pulling together to the stop"
    FREE = "letting go of the stop"
    DONE = "homed"


class Homing:
    """Steps all tendons together, so that antagonists balance; twist and feed stay where they are.

    Args:
        description: the robot.
        bending: (tendons, tendons) projector onto those length changes that bend the robot.
    """

    def __init__(self, description: RobotDescription, bending: Floats) -> None:
        n = len(description.tendon_names)
        self._tendon = description.tendon
        self._names = description.tendon_names
        self._index = np.array(description.tendon_drives, dtype=np.int64)
        self._compliance = _compliance(description)
        self._body_m_N = _body_compliance(description)
        self._shares = pretension_shares(description)
        """(m,) All tensions below are divided by it: equal ones leave the robot straight."""
        self._stage = _Stage.SLACK
        self._elapsed = self._resting = self._light = 0.0
        self._tightening = LEAST_SPEED_M_S
        self._good = 0
        self._uneven = np.zeros(n)
        self._start: Floats | None = None
        self._target = np.zeros(0)
        self._wound_from = np.zeros(0)
        self._paid = np.zeros(n)
        self._contact = np.zeros(n)
        self._turned = np.zeros(n)
        self._loose_from = self._contact_at = np.zeros(n)
        self._free = np.zeros(n)
        """What each drive reads while it winds a slack tendon: friction, not tension."""
        self._readings: list[Floats] = []
        self._count_N = np.array([_count_N(description, i) for i in self._index])
        self._bending = bending
        self._dither: Dither | None = None
        self._tightened_from = 0.0
        self._settling = None if _rubs(description) else Settling(bending, float(np.max(self._count_N, initial=0.0)))
        self._seating = Seating(description) if has_stop(description) else None
        self._stroke_m = float(self._seating.stroke_m.max()) if self._seating else 0.0

    @property
    def done(self) -> bool:
        return self._stage is _Stage.DONE

    @property
    def progress(self) -> str:
        """What it does now, in words."""
        return self._stage.value

    def step(self, travel: Floats, load: Floats, speed: Floats, dt_s: float) -> Floats:
        """One tick: the next travel setpoint of all drives from the present one, the measured load and speed of travel.

        Raises:
            HomingError: a tendon was wound too far without tension, or it takes too long.
        """
        if self._tendon is None or not len(self._index):
            self._stage = _Stage.DONE
            return travel
        if self._start is None:
            self._start, self._target = travel.copy(), travel.copy()
        self._elapsed += dt_s
        if self._elapsed > TIMEOUT_S:
            raise HomingError(f"still {self.progress} after {TIMEOUT_S:.0f} s")
        reading, pretension = load[self._index] / self._shares, self._tendon.pretension_N
        match self._stage:
            case _Stage.SLACK:
                self._pay_out(self._start, reading, pretension, dt_s)
            case _Stage.WIND:
                self._wind(reading, speed[self._index], pretension, dt_s)
            case _Stage.LET_GO:
                self._let_go(reading + self._free, pretension, dt_s)
            case _Stage.DRAW:
                self._draw(reading - self._free, pretension, dt_s)
            case _Stage.TIGHTEN:
                self._tighten(reading - self._free, pretension, dt_s)
            case _Stage.DITHER if self._dither is not None:
                self._check_pull(reading - self._free, pretension * (1.0 + self._tendon.dither_share + PULL_MARGIN))
                self._target[self._index] += self._shares * self._dither.step(reading - self._free, dt_s)
                if self._dither.done:
                    self._tightening = LEAST_SPEED_M_S
                    self._stage = _Stage.TIGHTEN
            case _Stage.SETTLE if self._settling is not None:
                missing = self._shares * (pretension - (reading - self._free))
                self._target[self._index] += self._settling.step(pretension - missing, pretension, dt_s)
                if self._settling.done:
                    self._stage = _Stage.DONE
            case _ if self._seating is not None:
                friction = self._free if self._stage is _Stage.SEAT else -self._free
                self._seat(self._seating, self._shares * (reading - friction), pretension, dt_s)
        return self._target.copy()

    def _pay_out(self, start: Floats, tension: Floats, pretension: float, dt_s: float) -> None:
        limit = np.maximum(STILL_CHANGING * pretension, CONTACT_COUNTS * self._count_N)
        look_back_s = max(LOOK_BACK_S, SURELY * float(limit.max()) * self._body_m_N / SLACK_SPEED_M_S)
        past = max(2, round(look_back_s / dt_s))
        self._readings = [*self._readings, tension][-past:]
        paid = (self._target - start)[self._index]
        # All together: what stands while the body straightens is pulled taut, and its friction is read wrongly then.
        changing = len(self._readings) < past or bool(np.any(np.abs(self._readings[0] - tension) > limit))
        more = (paid < SLACK_M) | (changing & (paid < MAX_SLACK_M + self._stroke_m))
        self._target[self._index] += np.where(more, SLACK_SPEED_M_S * dt_s, 0.0)
        if not np.any(more):
            self._stage = _Stage.WIND
            self._wound_from, self._paid = self._target.copy(), paid

    def _wind(self, tension: Floats, speed: Floats, pretension: float, dt_s: float) -> None:
        wound = (self._wound_from - self._target)[self._index]
        # By what the drive did, not by what it was told: before it turns its reading is not that of winding.
        self._turned = self._turned - np.minimum(speed, 0.0) * dt_s
        free = self._turned <= FREE_M
        self._free = np.where(free, tension, np.minimum(self._free, tension))
        enough = np.maximum(CONTACT_FRACTION * pretension, CONTACT_COUNTS * self._count_N)
        touching = ~free & (tension - self._free >= enough)
        resting = np.abs(speed) <= AT_REST * WIND_SPEED_M_S
        self._contact = np.where(touching, self._contact + np.where(resting, dt_s, 0.0), 0.0)
        self._target[self._index] -= np.where(touching, 0.0, WIND_SPEED_M_S * dt_s)
        if np.any(far := wound - self._paid > MAX_WIND_M + self._stroke_m):
            self._complain_of_slack(np.where(far, wound, 0.0))
        if np.all(self._contact >= CONTACT_HOLD_S):
            self._stage = _Stage.SEAT if self._seating else _Stage.LET_GO
            self._loose_from = self._contact_at = self._target[self._index].copy()

    def _complain_of_slack(self, wound: Floats) -> None:
        worst = int(np.argmax(wound))
        raise HomingError(
            f"tendon {self._names[worst]} was wound in by {wound[worst] * 1e3:.0f} mm and is still slack: "
            "is it broken or off its spool?"
        )

    def _seat(self, seating: Seating, tension: Floats, pretension: float, dt_s: float) -> None:
        if self._stage is _Stage.SEAT:
            self._target[self._index] -= seating.pull(tension, dt_s)
            if np.any(seating.overrun):
                self._complain_of_slack(np.where(seating.overrun, (self._wound_from - self._target)[self._index], 0.0))
            if seating.seated:
                self._stage = _Stage.FREE
        else:
            self._target[self._index] += seating.release(dt_s)
            if seating.released:
                self._check_evenness(tension, pretension)
                self._stage = _Stage.DONE

    def _check_evenness(self, tension: Floats, pretension: float) -> None:
        """A bent robot's sections have met a stop, too, but one side pulls then."""
        low, high = int(np.argmin(tension)), int(np.argmax(tension))
        most = max(UNEVEN * pretension, CONTACT_COUNTS * float(self._count_N.max()))
        if tension[high] - tension[low] > most:
            raise HomingError(
                f"let go of the stop, tendon {self._names[high]} carries {tension[high]:.0f} N and {self._names[low]} "
                f"{max(tension[low], 0.0):.0f} N: is the robot bent, or does something hold it?"
            )

    def _let_go(self, tension: Floats, pretension: float, dt_s: float) -> None:
        """All out until they carry nothing, each as far beyond as the others, and long enough for the body to straighten."""
        travel = self._target[self._index]
        carries = tension > np.maximum(TOUCH_FRACTION * pretension, self._count_N)
        self._loose_from = np.where(carries, travel, self._loose_from)
        ahead = self._loose_from + LOOSE_M - travel
        if np.any(far := carries & (travel - self._contact_at > MAX_LOOSE_M)):
            raise HomingError(
                f"tendon {self._names[int(np.argmax(far))]} was paid out by {MAX_LOOSE_M * 1e3:.0f} mm and still reads tension: "
                "does its drive turn hard, or is it jammed?"
            )
        self._target[self._index] += np.minimum(np.where(carries, np.inf, ahead), WIND_SPEED_M_S * dt_s)
        self._resting = 0.0 if np.any(carries) or np.any(ahead > 0.0) else self._resting + dt_s
        if self._resting >= STRAIGHTEN_S:
            self._stage = _Stage.DRAW

    def _draw(self, tension: Floats, pretension: float, dt_s: float) -> None:
        """All at the same rising tension, never out again: that would turn the friction round."""
        touch = np.maximum(TOUCH_FRACTION * pretension, self._count_N)
        top = LIGHT_FRACTION * pretension
        self._light = min(self._light + (top * dt_s / RISE_S if np.all(tension >= touch) else 0.0), top)
        missing = np.maximum(self._light, 1.2 * touch) - tension
        tolerance = np.maximum(TOLERANCE * pretension, self._count_N / 2)
        # What is slack is drawn in at full speed.
        speed = np.where(tension < touch, np.inf, missing * self._compliance / APPROACH_S)
        speed = np.clip(speed, 0.0, DRAW_SPEED_M_S)
        self._target[self._index] -= np.where(missing > tolerance, speed, 0.0) * dt_s
        there = self._light >= top and np.all(missing <= tolerance)
        self._good = self._good + 1 if there else 0
        if self._good >= GOOD_READINGS:
            self._stage = _Stage.TIGHTEN
            self._tightened_from = float(np.mean(self._target[self._index]))

    def _tighten(self, tension: Floats, pretension: float, dt_s: float) -> None:
        """All by their share of a length; those that rub a little more or less, until each carries its share."""
        level = float(np.mean(tension))
        missing = pretension - level
        if missing <= 0.0:
            if self._settling is None and self._dither is None and self._tendon is not None:
                self._dither = self._made_dither(self._tendon)
            if self._dither is not None and not self._dither.done:
                self._stage = _Stage.DITHER
            else:
                self._stage = _Stage.SETTLE if self._settling else _Stage.DONE
            return
        # Tendons may be far stiffer than described (the ideal twin's are): begin slowly, so that one step is no shock.
        self._tightening *= TIGHTENING_GROWTH
        speed = min(missing * self._compliance / APPROACH_S, WIND_SPEED_M_S, self._tightening)
        more = np.zeros_like(tension)
        if self._settling is None:
            # Beyond what a dither has evened out, the readings of tendons wound in differ by their conduits alone.
            evens = self._dither is None
            speed = min(speed, (1.0 - LIGHT_FRACTION) * pretension * self._compliance / RUBBING_RISE_S)
            # While it rises, a reading steps from count to count, and its mean is finer than a count.
            self._uneven += (tension - level - self._uneven) * dt_s / EVENING_S
            most = EVENING_SHARE * speed
            more = np.clip(-self._uneven * self._compliance / EVENING_S, -most, most) * evens
        self._target[self._index] -= (max(speed, LEAST_SPEED_M_S) + more) * dt_s * self._shares

    def _check_pull(self, tension: Floats, most: float) -> None:
        worst = int(np.argmax(tension))
        if tension[worst] > most:
            raise HomingError(
                f"tendon {self._names[worst]} carries {tension[worst] * self._shares[worst]:.0f} N while all are pulled to and "
                f"fro, {most * self._shares[worst]:.0f} N at most: is it jammed?"
            )

    def _made_dither(self, tendon: Tendon) -> Dither | None:
        """By lengths, as far as the tendons have just been seen to stretch; None where it is not wanted or too hard."""
        wound = self._tightened_from - float(np.mean(self._target[self._index]))
        expected = (1.0 - LIGHT_FRACTION) * tendon.pretension_N * self._compliance
        if not tendon.dither_cycles or wound < STRETCHES * expected:
            return None
        amplitude = wound * tendon.dither_share / (1.0 - LIGHT_FRACTION)
        return Dither(amplitude, tendon.dither_cycles, self._compliance, self._bending)


def _rubs(description: RobotDescription) -> bool:
    """Whether friction along the tendons hides from the drives what the sections feel."""
    tendon = description.tendon
    return tendon is not None and max(tendon.hole_friction, tendon.conduit_friction) > 0.0


def _compliance(description: RobotDescription) -> float:
    """Stretch per tension of the longest tendon [m/N]."""
    tendon = description.tendon
    return (tendon.conduit_length_m + description.active_length_m) / tendon.axial_stiffness_N if tendon else 0.0


def _body_compliance(description: RobotDescription) -> float:
    """By how much the body gives way to the tendon that it gives way to most, bending and shortening [m/N]."""
    most = 0.0
    for end in description.tendon_section:
        routing, own = description.sections[end].routing, 0.0
        for i in description.active_sections:
            section = description.sections[i]
            if i <= end and routing is not None:
                own += section.length_m * routing.radius_m**2 / section.bending_stiffness_Nm2
            if i <= end and section.elongation is not None:
                own += section.vertebrae / section.elongation.stiffness_N_m
        most = max(most, own)
    return most


def _count_N(description: RobotDescription, drive: int) -> float:
    """Tension of one count of a drive's current [N]: what it can tell at best."""
    motor = description.motor_of(description.drives[drive])
    torque = motor.current_per_count_A * motor.torque_constant_Nm_A
    return torque / abs(description.drives[drive].travel_per_rad)
