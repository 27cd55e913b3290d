"""Notices load cells that cannot be believed any more: driving ends, people are told, and the currents stand in for them."""

from collections.abc import Callable, Iterator

import numpy as np

from cobra.control.supervisor import Supervisor
from cobra.description import RobotDescription
from cobra.messages import Cell
from cobra.motors.bus import CellReadings, Feedback


class CellWatch:
    """Call `step` once a tick."""

    def __init__(self, description: RobotDescription, supervisor: Supervisor, warn: Callable[[str], None]) -> None:
        self._names = description.tendon_names
        self._supervisor = supervisor
        self._warn = warn
        self._believed = np.zeros(len(self._names), dtype=bool)

    def step(self, feedback: Feedback | None) -> None:
        """Compare with the tick before."""
        if feedback is None or not len(feedback.cells.tension):
            return
        cells = feedback.cells
        believed = np.isfinite(cells.tension)
        lost = np.flatnonzero(self._believed & ~believed)
        self._believed = believed
        for i in lost:
            words = f"load cell of tendon {self._names[i]}: {cells.trouble[i]}"
            if self._supervisor.phase == "driving":
                self._supervisor.hold(
                    f"{words}. Its tension comes from the motor's current now. Let go, centre, press again to go on."
                )
            self._warn(f"{words}. Its tension comes from the motor's current until it is mended.")


def cells_report(description: RobotDescription, cells: CellReadings) -> tuple[Cell, ...]:
    """The load cells, as everybody sees them."""

    def each() -> Iterator[Cell]:
        for i in np.flatnonzero(cells.fitted):
            yield Cell(
                tendon=description.tendon_names[i],
                tension=float(cells.tension[i]),
                reading=float(cells.raw[i]),
                age=float(cells.age[i]),
                trouble=cells.trouble[i],
            )

    return tuple(each())
