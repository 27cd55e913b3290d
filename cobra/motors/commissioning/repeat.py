"""Homing more than once: what the zero of each tendon is, and by how much it differs from one time to the next."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from cobra.description import RobotDescription
from cobra.motors.bus import CellReadings
from cobra.motors.commissioning.procedure import AbortError, Bounds, Floats, Seen
from cobra.motors.homing import TIMEOUT_S, Homing, HomingError

RUNS: Final = 3
MOST_RUNS: Final = 10
MAX_TURN_RAD: Final = 12.0
"""Of any shaft; homing itself bounds what it winds."""


class RepeatedHoming:
    """Homes `runs` times; the last zero stays. `travels` has that of each time."""

    def __init__(self, description: RobotDescription, bending: Floats, runs: int = RUNS) -> None:
        self._description = description
        self._bending = bending
        self._runs = runs
        self._index = np.array(description.tendon_drives, dtype=np.intp)
        self._homing = Homing(description, bending)
        self._believed: NDArray[np.bool_] | None = None
        self.travels: list[Floats] = []
        """Setpoints (drives,) at the end of each run."""
        self.name = "homing"
        self.moved = tuple(range(len(description.drives)))
        self.bounds = Bounds(seconds=runs * (TIMEOUT_S + 1.0), travel=MAX_TURN_RAD, current=0.95)

    @property
    def done(self) -> bool:
        return len(self.travels) >= self._runs

    @property
    def progress(self) -> str:
        run = min(len(self.travels) + 1, self._runs)
        return f"homing {run} of {self._runs}: {self._homing.progress}"

    @property
    def spread_m(self) -> Floats:
        """(m,) largest difference between the zeros of any two runs [m]."""
        ends = np.array([travel[self._index] for travel in self.travels])
        return np.asarray(np.ptp(ends, axis=0)) if len(ends) else np.full(len(self._index), np.nan)

    def step(self, setpoint: Floats, seen: Seen, dt_s: float) -> Floats:
        """As `Procedure.step`."""
        self._check_cells(seen.feedback.cells)
        try:
            target = self._homing.step(setpoint, seen.load, seen.speed, dt_s)
        except HomingError as error:
            raise AbortError(str(error)) from None
        if self._homing.done:
            self.travels.append(target.copy())
            if not self.done:
                self._homing = Homing(self._description, self._bending)
        return target

    def _check_cells(self, cells: CellReadings) -> None:
        """A current that takes a cell's place on the way has another zero: its gear's friction is in it."""
        now = np.isfinite(cells.tension)
        if self._believed is None:
            self._believed = now
        if np.any(lost := self._believed & ~now):
            i = int(np.argmax(lost))
            raise AbortError(f"load cell of tendon {self._description.tendon_names[i]}: {cells.trouble[i]}")
