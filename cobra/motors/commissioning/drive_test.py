"""Does a drive do what the description says of it: encoder, travel, direction, current? One drive after the other.

A tendon's drive pays out, then winds in slowly until the tendon pulls, and goes back. What a motor turns can only be told by
what answers: a tendon that grows tight while it is paid out is wound the other way round than described.
"""

import math
from dataclasses import dataclass
from enum import Enum
from typing import Final

import numpy as np

from cobra.description import Drive, Motor, RobotDescription
from cobra.motors.commissioning.procedure import Bounds, Floats, Seen

OUT_M: Final = 0.003
OUT_RAD: Final = math.radians(2.0)
"""Of a twist."""
SPEED_M_S: Final = 0.008
SPEED_RAD_S: Final = math.radians(4.0)
MOST_WIND_M: Final = 0.030
"""Beyond what was paid out: more slack than that is none."""
REST_S: Final = 0.25
CONTACT_SHARE: Final = 0.2
"""Of the pretension, over what the drive reads while nothing pulls."""
CONTACT_COUNTS: Final = 4.0
CONTACT_S: Final = 0.04
FREE_M: Final = 0.0008
"""Wound in before the free reading counts: by then the gear turns."""
FOLLOWS: Final = 0.15
"""Of the way: a larger difference between told and travelled is a fault."""
AT_REST: Final = 0.02
"""Of the speed of the test."""
PLAUSIBLE_A: Final = 0.5
"""Of the maximum current: more is not free running."""


@dataclass(frozen=True, slots=True)
class Check:
    """One thing that was looked at."""

    name: str
    ok: bool
    words: str


class _Stage(Enum):
    BEGIN = "stands"
    OUT = "goes out"
    IN = "comes in"
    BACK = "goes back"
    DONE = "is done"


class DriveTest:
    """Drive `index`; `checks` tell what was found once it is done."""

    def __init__(self, description: RobotDescription, index: int) -> None:
        self._index = index
        drive = description.drives[index]
        self.name = drive.name
        self.moved = (index,)
        self.checks: tuple[Check, ...] = ()
        self._tendon = drive.moves == "tendon"
        self._twists = drive.moves == "twist"
        self._out, self._speed = (OUT_RAD, SPEED_RAD_S) if self._twists else (OUT_M, SPEED_M_S)
        self._motor: Motor = description.motor_of(drive)
        self._count_N = _count(drive, self._motor)
        pretension = description.tendon.pretension_N if description.tendon else 0.0
        self._contact_N = max(CONTACT_SHARE * pretension, CONTACT_COUNTS * self._count_N)
        span = 2.0 * self._out + (MOST_WIND_M if self._tendon else 0.0)
        self.bounds = Bounds(
            seconds=8.0 * span / self._speed + 4.0, travel=1.5 * span / abs(drive.travel_per_rad), current=PLAUSIBLE_A
        )
        self._stage = _Stage.BEGIN
        self._resting = self._held = 0.0
        self._start = self._turned = math.nan
        self._free = math.inf
        self._free_A: list[float] = []
        self._contact_at: float | None = None
        self._tight_outwards = self._reversed = False
        self._reached: dict[str, float] = {}

    @property
    def done(self) -> bool:
        return self._stage is _Stage.DONE

    @property
    def progress(self) -> str:
        return f"drive {self.name} {self._stage.value}"

    def step(self, setpoint: Floats, seen: Seen, dt_s: float) -> Floats:
        """As `Procedure.step`."""
        i, out = self._index, setpoint.copy()
        here, load = float(seen.travel[i]), float(seen.load[i])
        self._resting += dt_s
        match self._stage:
            case _Stage.BEGIN:
                self._start = float(setpoint[i])
                if self._resting >= REST_S:
                    self._free = load
                    self._go(_Stage.OUT)
            case _Stage.OUT:
                self._outwards(out, here, load, float(seen.feedback.current[i]), dt_s)
            case _Stage.IN:
                self._inwards(out, here, load, float(seen.speed[i]), float(seen.feedback.current[i]), dt_s)
            case _Stage.BACK:
                if self._towards(out, self._start, dt_s) and self._resting >= REST_S:
                    self._reached["back"] = here - self._start
                    self.checks = self._found()
                    self._go(_Stage.DONE)
            case _Stage.DONE:
                pass
        return out

    def _go(self, stage: _Stage) -> None:
        self._stage, self._resting, self._held = stage, 0.0, 0.0

    def _towards(self, out: Floats, goal: float, dt_s: float) -> bool:
        """Move the setpoint; whether it is there. What follows must come to rest first, so time counts from there."""
        left = goal - float(out[self._index])
        step = self._speed * dt_s
        out[self._index] += max(-step, min(step, left))
        if abs(left) > step:
            self._resting = 0.0
        return abs(left) <= step

    def _outwards(self, out: Floats, here: float, load: float, current: float, dt_s: float) -> None:
        if self._tendon and load - self._free > self._contact_N:
            self._held += dt_s
            if self._held >= CONTACT_S:
                self._tight_outwards = True
                self._reached["out"] = math.nan
                self._go(_Stage.BACK)
                return
        else:
            self._held = 0.0
        self._free_A.append(current)
        if self._towards(out, self._start + self._out, dt_s) and self._resting >= REST_S:
            self._reached["out"] = here - self._start
            self._free, self._turned = math.inf, here
            self._go(_Stage.IN)

    def _inwards(self, out: Floats, here: float, load: float, speed: float, current: float, dt_s: float) -> None:
        if not self._tendon:
            self._free_A.append(current)
            if self._towards(out, self._start - self._out, dt_s) and self._resting >= REST_S:
                self._reached["in"] = here - self._start
                self._go(_Stage.BACK)
            return
        wound = self._turned - here
        if wound <= FREE_M:
            self._free = load
        pulls, pushes = load - self._free >= self._contact_N, self._free - load >= self._contact_N
        touching = wound > FREE_M and (pulls or pushes)
        if touching:
            self._held = self._held + dt_s if abs(speed) <= AT_REST * self._speed else self._held
        else:
            self._free = min(self._free, load)
            self._free_A.append(current)
            self._held = 0.0
        if self._held >= CONTACT_S:
            self._contact_at, self._reversed = wound, pushes
            self._go(_Stage.BACK)
        elif not touching and self._towards(out, self._start - MOST_WIND_M, dt_s) and self._resting >= REST_S:
            self._go(_Stage.BACK)

    def _found(self) -> tuple[Check, ...]:
        checks = [self._encoder()]
        checks.append(self._direction() if self._tendon else self._reach())
        checks.append(self._current())
        return tuple(checks)

    def _words(self, way: float) -> str:
        return f"{math.degrees(way):.1f} degrees" if self._twists else f"{way * 1e3:.1f} mm"

    def _encoder(self) -> Check:
        moved = self._reached.get("out", math.nan)
        if math.isnan(moved):
            return Check("encoder", True, "it moves")
        off, back = abs(moved - self._out), abs(self._reached["back"])
        ok = max(off, back) <= FOLLOWS * self._out
        words = f"told {self._words(self._out)}, went {self._words(moved)}, came back to {self._words(back)}"
        return Check("encoder", ok, words if ok else f"{words}: is it slipping, or the ratio wrong?")

    def _direction(self) -> Check:
        if self._tight_outwards:
            return Check(
                "direction",
                False,
                "the tendon grew tight while it was paid out: turn `direction` round in the description",
            )
        if self._reversed:
            return Check(
                "direction", False, "its current says push while the tendon pulls: the sign of the current is reversed"
            )
        if self._contact_at is None:
            return Check(
                "direction", False,
                f"{self._words(MOST_WIND_M)} wound in without tension: is the tendon on its spool, and wound the way that "
                "`direction` says?",
            )  # fmt: skip
        return Check("direction", True, f"winding in pulls, after {self._words(self._contact_at)}")

    def _reach(self) -> Check:
        moved = -self._reached.get("in", 0.0)
        ok = abs(moved - self._out) <= FOLLOWS * self._out
        which = "right, then left" if self._twists else "in, then out"
        return Check("direction", ok, f"went {which} by {self._words(self._out)}: did you see it do so?")

    def _current(self) -> Check:
        drawn = np.array(self._free_A)
        if not len(drawn) or not np.all(np.isfinite(drawn)):
            return Check("current", False, "no current was told")
        most = float(np.max(np.abs(drawn)))
        words = f"{np.mean(np.abs(drawn)):.2f} A while it turns freely, at most {most:.2f} A"
        if len(np.unique(drawn)) < 2:
            return Check("current", False, f"{words}: the reading never changes")
        ok = most <= PLAUSIBLE_A * self._motor.max_current_A
        return Check("current", ok, words if ok else f"{words}: too much for a free drive")


def _count(drive: Drive, motor: Motor) -> float:
    """Load of one count of the current [N or N·m]."""
    return motor.current_per_count_A * motor.torque_constant_Nm_A / abs(drive.travel_per_rad)
