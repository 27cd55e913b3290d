"""What the loop makes of the motors' feedback, for the supervisor and for people."""

import numpy as np
from numpy.typing import NDArray

from cobra.control.supervisor import Health
from cobra.description import RobotDescription
from cobra.messages import Drives
from cobra.motors.bus import Feedback
from cobra.motors.transmission import Transmission

Floats = NDArray[np.float64]

MISSES_TO_HOLD = 5
"""Replies missed in a row by one motor before the whole robot holds: one dead tendon stops its antagonists."""


def health_of(description: RobotDescription, feedback: Feedback | None, gone: str) -> Health:
    """What prevents motion, in words; `gone` says why there is no bus."""
    if gone:
        return Health(blocking=(gone,))
    if feedback is None:
        return Health(blocking=("the motors have not answered yet",))
    drives = description.drives
    silent = [drives[i].name for i in np.flatnonzero(feedback.missed >= MISSES_TO_HOLD)]
    blocking = (f"no answer from {_list(silent)}: check power and cable",) if silent else ()
    faults = tuple(
        f"drive {drive.name}: {fault}" for drive, fault in zip(drives, feedback.faults, strict=True) if fault
    )
    return Health(blocking=blocking, faults=faults)


def drives_report(
    feedback: Feedback | None, travel: Floats, setpoint: Floats | None, transmission: Transmission
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
        fault=feedback.faults,
    )


def _list(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
