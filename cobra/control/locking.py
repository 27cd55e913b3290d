"""Rigid and continuum status: sections whose guiders catch in each other when all tendons pull them together (MODEL 3).

continuum → locking → rigid → unlocking → continuum. On the way it moves only while the dead-man is held, as any motion. In
all but continuum the sections stay straight: what would bend them is refused in words, whatever mode asks for it.
"""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cobra.control.requests import Act
from cobra.control.supervisor import Health, Supervisor
from cobra.description import RobotDescription
from cobra.kinematics.configuration import Configuration
from cobra.kinematics.ramps import approached, braking_speed, shortened
from cobra.messages import LockReport, Reply, Request, Rigidity

Floats = NDArray[np.float64]

STRAIGHT_SHARE = 0.5
"""Of the bend at which the slots do not catch any more: the bend need not be even along the robot."""
SURE = 0.25
"""Of the way from locked to unlocked length: as near counts as locked, and as far beyond as free."""
ASKED_rad = 1e-7
"""A step of a bend smaller than this asks for nothing."""


class Locking:
    """The status of a robot, and what it allows. A robot without such sections has none, and everything is allowed."""

    def __init__(self, description: RobotDescription) -> None:
        self._configuration = configuration = Configuration(description)
        self._sections = tuple(i for i in description.active_sections if description.sections[i].elongation)
        self._bends = [configuration.bends[i] for i in self._sections]
        self._lengths = np.array([configuration.lengths[i] for i in self._sections], dtype=np.int64)
        parts = [(description.sections[i], description.sections[i].elongation) for i in self._sections]
        self._names = [section.name for section, _ in parts]
        locked = np.array([section.vertebrae * part.locked_length_m for section, part in parts if part])
        unlocked = np.array([section.vertebrae * part.unlocked_length_m for section, part in parts if part])
        self._locked, self._sure = locked, SURE * (unlocked - locked)
        self._free = unlocked + self._sure
        self._straight = np.array(
            [STRAIGHT_SHARE * section.vertebrae * math.radians(part.lock_bend_deg) for section, part in parts if part]
        )
        self._refused = ""
        self.status: Rigidity = "continuum" if self._sections else "none"

    def report(self) -> LockReport:
        return LockReport(status=self.status, words=self._refused or _WORDS[self.status])

    def reset(self, q: Floats) -> None:
        """Take the status from where the robot stands, after homing or on switching on."""
        if not self._sections:
            return
        lengths, straight = q[self._lengths], self._bent(q) is None
        if straight and np.all(lengths <= self._locked + self._sure):
            self.status = "rigid"
        elif np.all(lengths >= self._free - 1e-9):
            self.status = "continuum"
        else:
            self.status = "unlocking"

    def lock(self, q: Floats, measured: Floats) -> tuple[str, ...]:
        """Begin to lock; gives why not, in words, else nothing. `measured` is q from the motors alone."""
        if self.status == "none":
            return ("this robot has nothing that locks",)
        if self.status == "rigid":
            return ("it is rigid already",)
        if bent := self._bent(q) or self._bent(measured):
            return (bent,)
        self.status = "locking"
        return ()

    def unlock(self) -> tuple[str, ...]:
        """Begin to let go; gives why not, in words, else nothing."""
        if self.status == "none":
            return ("this robot has nothing that locks",)
        if self.status == "continuum":
            return ("it is not locked: it bends already",)
        self.status = "unlocking"
        return ()

    def restrain(self, q: Floats, velocity: Floats, wanted: Floats, moving: bool, dt_s: float) -> Floats:
        """What the status makes of a step from q at `velocity` to `wanted`: the next q.

        Continuum: lengths end where the guiders could catch. Rigid: nothing moves. On the way: straight first, then
        towards the locked or the free length, while `moving`.
        """
        self._refused = ""
        if not self._sections:
            return wanted
        out = wanted.copy()
        if self.status == "continuum":
            shorter = self._free - wanted[self._lengths]
            out[self._lengths] = np.maximum(wanted[self._lengths], np.minimum(self._free, q[self._lengths]))
            if moving and np.any((shorter > 1e-9) | ((shorter > -1e-6) & (wanted < q)[self._lengths])):
                self._refused = "shorter than this its guiders catch: straighten it and lock it, if it is to be rigid"
            return out
        if any(np.max(np.abs(wanted[where] - q[where])) > ASKED_rad for where in self._bends) and moving:
            self._refused = _REFUSALS[self.status]
        for where in self._bends:
            out[where] = q[where]
        out[self._lengths] = q[self._lengths]
        if self.status != "rigid":
            self._on_the_way(q, velocity, out, moving, dt_s)
        return out

    def observe(self, q: Floats, measured: Floats) -> None:
        """Whether it has arrived, by the commanded and the motors' own lengths."""
        if self.status == "locking":
            there = np.maximum(q[self._lengths] - 1e-6, measured[self._lengths] - self._sure) <= self._locked
            if np.all(there):
                self.status = "rigid"
        elif self.status == "unlocking":
            there = np.minimum(q[self._lengths] + 1e-6, measured[self._lengths] + self._sure) >= self._free
            if np.all(there):
                self.status = "continuum"

    def _on_the_way(self, q: Floats, velocity: Floats, out: Floats, moving: bool, dt_s: float) -> None:
        rate, acceleration = self._configuration.rate, self._configuration.acceleration
        straight = True
        if self.status == "locking":
            for where in self._bends:
                step = rate[where.start] * dt_s if moving else 0.0
                out[where] = q[where] - shortened(q[where], step)
                straight &= math.hypot(*out[where]) < 1e-9
        targets = self._locked if self.status == "locking" else np.maximum(self._free, q[self._lengths])
        for i, target in zip(self._lengths, targets, strict=True):
            left = float(target - q[i])
            wanted = math.copysign(rate[i], left) if moving and straight and left else 0.0
            speed = approached(float(velocity[i]), wanted, acceleration[i] * dt_s)
            brake = braking_speed(abs(left), acceleration[i], dt_s)
            out[i] = q[i] + min(max(speed, -brake), brake) * dt_s

    def _bent(self, q: Floats) -> str | None:
        for name, where, limit in zip(self._names, self._bends, self._straight, strict=True):
            bend = math.hypot(*q[where])
            if bend > limit:
                return (
                    f"section {name} is bent by {math.degrees(bend):.0f} degrees: straighten it to under "
                    f"{math.degrees(limit):.0f} degrees, then lock it"
                )
        return None


_WORDS: dict[Rigidity, str] = {
    "none": "",
    "continuum": "bends and changes its length",
    "locking": "its guiders are being pulled together: hold to go on until it is rigid",
    "rigid": "locked: it carries loads and does not bend. Unlock it to bend it.",
    "unlocking": "its guiders are being let go: hold to go on until it is free",
}
_REFUSALS: dict[Rigidity, str] = {
    "locking": "it is being locked and does not bend: unlock it first, or hold until it is rigid",
    "rigid": "it is rigid and does not bend: unlock it first",
    "unlocking": "it is not free yet: hold until its guiders have let go",
}


def locking_acts(
    locking: Locking, supervisor: Supervisor, shapes: Callable[[], tuple[Floats, Floats]]
) -> dict[str, Act]:
    """What may be asked of the driver's hand; `shapes` gives q as commanded and as measured."""

    def refusal(what: str) -> tuple[str, ...]:
        if not supervisor.homed or supervisor.phase not in ("ready", "holding"):
            return (f"it must be armed, homed and standing still to be {what}",)
        return ()

    def lock(request: Request, now_s: float, health: Health) -> Reply:
        reasons = refusal("locked") or locking.lock(*shapes())
        return Reply(ok=not reasons, reasons=reasons)

    def unlock(request: Request, now_s: float, health: Health) -> Reply:
        reasons = refusal("unlocked") or locking.unlock()
        return Reply(ok=not reasons, reasons=reasons)

    return {"lock": lock, "unlock": unlock}
