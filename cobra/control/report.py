"""What the loop makes of the motors' feedback, for the supervisor and for people."""

import numpy as np
from numpy.typing import NDArray

from cobra.control.drive_watch import Watched
from cobra.control.supervisor import Health
from cobra.description import RobotDescription
from cobra.messages import Channel, Drives
from cobra.motors.bus import Feedback, MotorBus
from cobra.motors.transmission import Transmission

Floats = NDArray[np.float64]

SPELLED_OUT = 4
"""More drives than these are counted instead of named."""
MISSES_TO_HOLD = 5
"""Replies missed in a row by one motor before the whole robot holds: one dead tendon stops its antagonists."""


def health_of(
    description: RobotDescription, feedback: Feedback | None, gone: str, watched: Watched | None = None
) -> Health:
    """What prevents motion, in words; `gone` says why there is no bus."""
    if gone:
        return Health(blocking=(gone,))
    if feedback is None:
        return Health(blocking=("the motors have not answered yet",))
    drives = description.drives
    silent = [drives[i].name for i in np.flatnonzero(feedback.missed >= MISSES_TO_HOLD)]
    blocking = (f"no answer from {_list(silent)}: check power and cable",) if silent else ()
    told = feedback.faults if watched is None else (*feedback.faults, *watched.faults)
    return Health(blocking=blocking, faults=_grouped([drive.name for drive in drives], told))


def _grouped(names: list[str], told: tuple[str, ...]) -> tuple[str, ...]:
    """One line a fault: what all drives of a bus have in common is said once."""
    who: dict[str, list[str]] = {}
    for i, fault in enumerate(told):
        if fault:
            who.setdefault(fault, []).append(names[i % len(names)])
    return tuple(f"{_drives(named)}: {fault}" for fault, named in who.items())


def _drives(names: list[str]) -> str:
    if len(names) == 1:
        return f"drive {names[0]}"
    return f"drives {_list(names)}" if len(names) <= SPELLED_OUT else f"{len(names)} drives"


def drives_report(
    feedback: Feedback | None,
    travel: Floats,
    setpoint: Floats | None,
    transmission: Transmission,
    watched: Watched | None = None,
) -> Drives:
    """The drives in travel and load, as everybody sees them; NaN for what no motor has said yet."""
    n = len(travel)
    if feedback is None:
        nothing = (float("nan"),) * n
        return Drives(
            travel=nothing,
            setpoint=nothing,
            velocity=nothing,
            load=nothing,
            temperature=nothing,
            voltage=nothing,
            age=nothing,
            valid=(False,) * n,
            fault=("",) * n,
            current=nothing,
            missed=(0,) * n,
            warning=("",) * n,
        )
    return Drives(
        travel=tuple(travel.tolist()),
        setpoint=tuple((travel if setpoint is None else setpoint).tolist()),
        velocity=tuple((feedback.velocity * transmission.travel_per_rad).tolist()),
        load=tuple(transmission.load(feedback.current).tolist()),
        temperature=tuple(feedback.temperature.tolist()),
        voltage=tuple(feedback.voltage.tolist()),
        age=tuple(feedback.age.tolist()),
        valid=tuple(feedback.valid.tolist()),
        fault=_both(feedback.faults, watched.faults if watched else ()),
        current=tuple(feedback.current.tolist()),
        missed=tuple(feedback.missed.tolist()),
        warning=watched.warnings if watched else ("",) * n,
    )


def channels_report(bus: MotorBus) -> tuple[Channel, ...]:
    """The CAN channels, as everybody sees them."""
    return tuple(
        Channel(name=c.name, load=c.load, frame_rate_Hz=c.frame_rate_Hz, trouble=c.trouble) for c in bus.health
    )


def _both(told: tuple[str, ...], watched: tuple[str, ...]) -> tuple[str, ...]:
    if not any(watched):
        return told
    return tuple("; ".join(words for words in pair if words) for pair in zip(told, watched, strict=True))


def _list(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
