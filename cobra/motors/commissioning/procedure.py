"""What a procedure is, what it sees of the drives, and the guard that ends it when something goes beyond its bounds."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from cobra.description import RobotDescription
from cobra.motors.bus import Feedback
from cobra.motors.transmission import Transmission

Floats = NDArray[np.float64]

MISSES: Final = 5
"""Replies in a row: after one there is nothing to be said against a drive, after so many it is gone."""
HIGH_CURRENT_S: Final = 0.15
"""A current may be beyond its bound for so long: starting from rest takes some."""
BEHIND_RAD: Final = 0.25
"""Of the output shaft: further behind its setpoint a drive does not follow."""
BEHIND_S: Final = 0.3


class AbortError(RuntimeError):
    """A procedure was ended before it was done. The message says which drive and why."""


@dataclass(frozen=True, slots=True)
class Seen:
    """What the drives said in this tick, one entry a drive."""

    travel: Floats
    """m of tendon paid out, m of feed, rad of twist."""
    speed: Floats
    """Of the travel, a second."""
    load: Floats
    """[N] or [N·m], from motor current; of tendons what their load cells measure, where all have one."""
    feedback: Feedback


class Procedure(Protocol):
    """Moves drives step by step."""

    @property
    def done(self) -> bool: ...

    @property
    def progress(self) -> str:
        """What it does now, in words."""

    def step(self, setpoint: Floats, seen: Seen, dt_s: float) -> Floats:
        """The next travel setpoint (drives,) from the present one.

        Raises:
            AbortError, cobra.motors.homing.HomingError: it cannot go on.
        """


@dataclass(frozen=True, slots=True)
class Bounds:
    """What a procedure may do at most."""

    seconds: float
    travel: float = np.inf
    """Of any drive, from where it began: turns of its output shaft [rad]."""
    current: float = 0.6
    """Part of a motor's maximum."""


class Guard:
    """Watches those drives that a procedure moves."""

    def __init__(self, description: RobotDescription, moved: tuple[int, ...], bounds: Bounds) -> None:
        self._bounds = bounds
        self._moved = np.array(moved, dtype=np.intp)
        self._names = [description.drives[i].name for i in moved]
        motors = [description.motor_of(description.drives[i]) for i in moved]
        self._hot_C = np.array([motor.max_temperature_C for motor in motors])
        self._most_A = bounds.current * np.array([motor.max_current_A for motor in motors])
        self._transmission = Transmission(description)
        self._elapsed = 0.0
        self._high_s = np.zeros(len(moved))
        self._behind_s = np.zeros(len(moved))
        self._start_rad: Floats | None = None

    def check(self, setpoint: Floats, seen: Seen, dt_s: float) -> None:
        """Raises AbortError with the first thing that is beyond its bound."""
        told, moved = seen.feedback, self._moved
        self._elapsed += dt_s
        self._complain(
            told.missed[moved] >= MISSES, lambda i: f"does not answer any more ({told.missed[moved][i]} misses)"
        )
        self._complain(np.array([bool(told.faults[i]) for i in moved], dtype=bool), lambda i: told.faults[moved[i]])
        hot = told.temperature[moved]
        self._complain(hot > self._hot_C, lambda i: f"is at {hot[i]:.0f} °C, at most {self._hot_C[i]:g} °C")
        drawn = np.abs(told.current[moved])
        self._high_s = np.where(drawn > self._most_A, self._high_s + dt_s, 0.0)
        self._complain(
            self._high_s > HIGH_CURRENT_S,
            lambda i: f"draws {drawn[i]:.2f} A, at most {self._most_A[i]:.2f} A here: is it blocked?",
        )
        rad = 1.0 / np.abs(self._transmission.travel_per_rad[moved])
        behind = np.abs(setpoint - seen.travel)[moved] * rad
        self._behind_s = np.where(behind > BEHIND_RAD, self._behind_s + dt_s, 0.0)
        self._complain(
            self._behind_s > BEHIND_S,
            lambda i: (
                f"does not follow: {np.degrees(behind[i]):.0f} degrees behind what it is told; is it blocked, or is its "
                "encoder dead?"
            ),
        )
        angle = seen.travel[moved] * rad
        self._start_rad = angle if self._start_rad is None else self._start_rad
        away = np.abs(angle - self._start_rad)
        self._complain(
            away > self._bounds.travel,
            lambda i: f"went {np.degrees(away[i]):.0f} degrees, at most {np.degrees(self._bounds.travel):.0f} here",
        )
        if self._elapsed > self._bounds.seconds:
            raise AbortError(f"not done after {self._bounds.seconds:.0f} s")

    def _complain(self, wrong: NDArray[np.bool_], words: Callable[[int], str]) -> None:
        if np.any(wrong):
            first = int(np.argmax(wrong))
            raise AbortError(f"drive {self._names[first]} {words(first)}")


def seen_of(feedback: Feedback, transmission: Transmission) -> Seen:
    """What the drives said, as travel."""
    return Seen(
        travel=transmission.travel(feedback.angle),
        speed=feedback.velocity * transmission.travel_per_rad,
        load=transmission.loads(feedback.current, feedback.cells.tension, of_one_kind=True),
        feedback=feedback,
    )
