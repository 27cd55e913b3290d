"""Two points of a load cell: what it reads of a slack tendon (tare), and of a known force."""

from typing import Final

import numpy as np

from cobra.description import LoadCell, RobotDescription
from cobra.motors.cell_readings import MENDED_BY_TARING, CellCalibration
from cobra.motors.commissioning.procedure import AbortError, Bounds, Floats, Seen

LOOSE_M: Final = 0.004
"""At least so much is paid out before taring, …"""
MAX_LOOSE_M: Final = 0.040
"""… and as long as any reading still falls, up to this."""
SPEED_M_S: Final = 0.02
LOOK_BACK_TICKS: Final = 20
REST_S: Final = 0.4
AVERAGE_S: Final = 1.0
STEADY: Final = 4.0
"""Times the described noise, or counts: readings that spread further are not at rest."""
BIAS_MARGIN: Final = 2.0
"""Times the described largest offset: beyond, the tendon is not slack."""
GAINS: Final = (0.5, 2.0)
"""Outside, the described scale is wrong or the force was another."""
LEAST_FORCE: Final = 10.0
"""Times the noise of a reading: a smaller force tells no gain."""


class Tare:
    """Pays out the tendons that have a load cell until nothing falls any more, and takes what the cells read then as nothing."""

    def __init__(self, description: RobotDescription, tendons: tuple[str, ...] = ()) -> None:
        """`tendons`: whose cells; all by default. Raises AbortError if there are none."""
        self._cells = _chosen(description, tendons)
        self._entries = np.array([description.tendon_names.index(cell.tendon) for cell in self._cells], dtype=np.intp)
        self._drives = np.array([description.tendon_drives[i] for i in self._entries], dtype=np.intp)
        self.name = "tare"
        self.moved = tuple(self._drives.tolist())
        per_rad = min(abs(description.drives[i].travel_per_rad) for i in self.moved)
        self.bounds = Bounds(seconds=20.0, travel=1.2 * MAX_LOOSE_M / per_rad, current=0.6)
        self.cells: dict[str, CellCalibration] = {}
        self._paid = self._resting = 0.0
        self._past: list[Floats] = []
        self._readings: list[Floats] = []
        self.done = False

    @property
    def progress(self) -> str:
        return "reading the cells" if self._readings else "slackening the tendons"

    def step(self, setpoint: Floats, seen: Seen, dt_s: float) -> Floats:
        """As `Procedure.step`."""
        raw = _raw(self._cells, self._entries, seen)
        out = setpoint.copy()
        if self._slackens(raw):
            out[self._drives] += SPEED_M_S * dt_s
            self._paid += SPEED_M_S * dt_s
            return out
        self._resting += dt_s
        if self._resting > REST_S:
            self._readings.append(raw)
        if self._resting >= REST_S + AVERAGE_S:
            mean, spread = _average(self._readings)
            self.cells = {cell.tendon: _tared(cell, m, s) for cell, m, s in zip(self._cells, mean, spread, strict=True)}
            self.done = True
        return out

    def _slackens(self, raw: Floats) -> bool:
        if self._resting > 0.0:
            return False
        self._past = [*self._past, raw][-LOOK_BACK_TICKS:]
        half = len(self._past) // 2
        if self._paid < LOOSE_M or len(self._past) < LOOK_BACK_TICKS:
            return True
        fell = np.mean(self._past[:half], axis=0) - np.mean(self._past[half:], axis=0)
        still = fell > np.array([max(cell.noise_N, cell.scale_N) for cell in self._cells])
        return bool(np.any(still)) and self._paid < MAX_LOOSE_M


class KnownForce:
    """A known force pulls at one tendon, whose cell is tared already: how many newtons are its newtons? Moves nothing."""

    def __init__(
        self, description: RobotDescription, tendon: str, force_N: float, tare: CellCalibration | None
    ) -> None:
        """Raises AbortError: no such cell, not tared, or the force tells nothing."""
        (self._cell,) = _chosen(description, (tendon,))
        if tare is None:
            raise AbortError(f"load cell of tendon {tendon}: tare it first")
        least = LEAST_FORCE * max(self._cell.noise_N, self._cell.scale_N)
        most = self._cell.limit_N or (description.tendon.max_tension_N if description.tendon else np.inf)
        if not least <= force_N <= most:
            raise AbortError(f"a force of {force_N:g} N on {tendon}: must be {least:g} to {most:g} N")
        self._tare, self._force_N = tare, force_N
        self._entries = np.array([description.tendon_names.index(tendon)], dtype=np.intp)
        self.name = "known force"
        self.moved = (description.tendon_drives[int(self._entries[0])],)
        self.bounds = Bounds(seconds=10.0, travel=0.5, current=0.9)
        self.cells: dict[str, CellCalibration] = {}
        self._readings: list[Floats] = []
        self._elapsed = 0.0
        self.done = False
        self.progress = f"reading the cell of {tendon} under {force_N:g} N"

    def step(self, setpoint: Floats, seen: Seen, dt_s: float) -> Floats:
        """As `Procedure.step`."""
        self._readings.append(_raw((self._cell,), self._entries, seen))
        self._elapsed += dt_s
        if self._elapsed >= AVERAGE_S:
            (mean,), (spread,) = _average(self._readings)
            _check_steady(self._cell, spread)
            over = mean - self._tare.offset_N
            if abs(over) < 1e-9 or not GAINS[0] <= (gain := self._force_N / over) <= GAINS[1]:
                raise AbortError(
                    f"load cell of tendon {self._cell.tendon} reads {over:.2f} N under {self._force_N:g} N: does the force "
                    "pull at it, and is scale_N right?"
                )
            self.cells = {self._cell.tendon: CellCalibration(offset_N=self._tare.offset_N, gain=gain)}
            self.done = True
        return setpoint


def _chosen(description: RobotDescription, tendons: tuple[str, ...]) -> tuple[LoadCell, ...]:
    fitted = {cell.tendon: cell for cell in description.load_cells}
    if not fitted:
        raise AbortError(f"{description.name} has no load cells: describe them under [[load_cells]]")
    for name in tendons:
        if name not in fitted:
            raise AbortError(f"tendon {name} has no load cell; {', '.join(fitted)} have one")
    return tuple(fitted[name] for name in tendons) if tendons else tuple(fitted.values())


def _raw(cells: tuple[LoadCell, ...], entries: np.ndarray, seen: Seen) -> Floats:
    told = seen.feedback.cells
    for cell, i in zip(cells, entries.tolist(), strict=True):
        # What only calibration can mend must not prevent it.
        if (trouble := told.trouble[i]) and MENDED_BY_TARING not in trouble:
            raise AbortError(f"load cell of tendon {cell.tendon}: {trouble}")
    return np.asarray(told.raw[entries])


def _average(readings: list[Floats]) -> tuple[list[float], list[float]]:
    stack = np.array(readings)
    return stack.mean(axis=0).tolist(), stack.std(axis=0).tolist()


def _check_steady(cell: LoadCell, spread: float) -> None:
    if spread > STEADY * max(cell.noise_N, cell.scale_N):
        raise AbortError(f"load cell of tendon {cell.tendon} is not at rest: its readings spread by {spread:.2f} N")


def _tared(cell: LoadCell, mean: float, spread: float) -> CellCalibration:
    _check_steady(cell, spread)
    if cell.bias_N and abs(mean) > BIAS_MARGIN * cell.bias_N:
        raise AbortError(
            f"load cell of tendon {cell.tendon} reads {mean:.2f} N, more than its offset can be (bias_N = {cell.bias_N:g}): "
            "is the tendon slack?"
        )
    return CellCalibration(offset_N=mean)
