"""Notices load cells that cannot be believed any more: driving ends, people are told, and the currents stand in for them.

Of every tendon with a cell it keeps what the current says beside it: the two disagree where one of them is wrong.
"""

from collections.abc import Callable, Iterator

import numpy as np

from cobra.control.supervisor import Supervisor
from cobra.description import RobotDescription
from cobra.mechanics.losses import Losses
from cobra.messages import Cell
from cobra.motors.bus import Feedback
from cobra.motors.transmission import Floats, Transmission, without_gear_friction


class CellWatch:
    """Call `step` once a tick."""

    def __init__(self, description: RobotDescription, supervisor: Supervisor, warn: Callable[[str], None]) -> None:
        self._names = description.tendon_names
        self._supervisor = supervisor
        self._warn = warn
        self._believed = np.zeros(len(self._names), dtype=bool)
        self._transmission = Transmission(description)
        self._index = np.array(description.tendon_drives, dtype=np.intp)
        self._friction_N = Losses.described(description).drive_friction_N
        self._current_N: Floats = np.zeros(len(self._names))

    def step(self, feedback: Feedback | None) -> None:
        """Compare with the tick before."""
        if feedback is None or not len(feedback.cells.tension):
            return
        cells = feedback.cells
        load = np.nan_to_num(self._transmission.load(feedback.current)[self._index])
        speed = np.nan_to_num((feedback.velocity * self._transmission.travel_per_rad)[self._index])
        self._current_N = without_gear_friction(self._current_N, load, speed, self._friction_N)
        believed = np.isfinite(cells.tension)
        lost = np.flatnonzero(self._believed & ~believed)
        self._believed = believed
        for i in lost:
            words = f"load cell of tendon {self._names[i]}: {cells.trouble[i]}"
            if self._supervisor.phase == "driving":
                self._supervisor.hold(
                    f"{words}. Its tension comes from the motor's current now. Let go, centre, press again to go on."
                )
            elif self._supervisor.phase == "homing":
                # The current that takes its place has its gear's friction in it, which would be taken for tension.
                self._supervisor.homing_failed(f"{words}. Home again: its tension comes from the motor's current then.")
            self._warn(f"{words}. Its tension comes from the motor's current until it is mended.")

    def report(self, feedback: Feedback | None) -> tuple[Cell, ...]:
        """The load cells, as everybody sees them."""
        return tuple(self._each(feedback)) if feedback is not None else ()

    def _each(self, feedback: Feedback) -> Iterator[Cell]:
        cells = feedback.cells
        for i in np.flatnonzero(cells.fitted):
            yield Cell(
                tendon=self._names[i],
                tension=float(cells.tension[i]),
                from_current=float(self._current_N[i]),
                reading=float(cells.raw[i]),
                age=float(cells.age[i]),
                trouble=cells.trouble[i],
            )
