"""Simulated load cells: beside their drives they feel the tendons, with noise and a bias, and send what they feel."""

from collections.abc import Callable

import numpy as np

from cobra.clock import Clock
from cobra.description import LoadCell, RobotDescription
from cobra.motors.load_cells import encode_reading
from cobra.simulation.node import Frame
from cobra.simulation.plant import Floats

SATURATED_N = 1e9
"""More than any type holds."""


class LoadCellAmplifier:
    """A node on the bus that sends one frame with the readings of one or more cells."""

    listens: frozenset[int] = frozenset()

    def __init__(
        self,
        cells: tuple[LoadCell, ...],
        indices: tuple[int, ...],
        load: Callable[[], Floats],
        clock: Clock,
        rng: np.random.Generator,
    ) -> None:
        self.cells = cells
        self._indices = indices
        self._load = load
        self._clock = clock
        self._rng = rng
        self.bias_N = tuple(float(rng.uniform(-cell.bias_N, cell.bias_N)) for cell in cells)
        """What each reads without any force."""
        self.mute = False
        """It sends nothing any more."""
        self.saturated: set[str] = set()
        """Tendons whose cells read the end of their range."""
        self._period_s = 1.0 / cells[0].rate_Hz
        self._due_s = clock.now() + self._period_s * float(rng.uniform())

    def hear(self, arbitration_id: int, data: bytes) -> list[Frame]:
        """It takes no orders."""
        return []

    @property
    def speaks(self) -> bool:
        return True

    def unasked(self) -> list[Frame]:
        """Its frame, when it is due; what a stalled machine has missed is not made up for."""
        now = self._clock.now()
        if now < self._due_s:
            return []
        self._due_s = max(self._due_s + self._period_s, now)
        if self.mute:
            return []
        load = self._load()
        frame = bytearray(max(cell.byte_offset + cell.size for cell in self.cells))
        for cell, index, bias in zip(self.cells, self._indices, self.bias_N, strict=True):
            force = float(load[index]) + bias + cell.noise_N * self._rng.standard_normal()
            encode_reading(cell, SATURATED_N if cell.tendon in self.saturated else force, frame)
        return [(self.cells[0].frame_id, bytes(frame))]


def amplifiers(
    description: RobotDescription, load: Callable[[], Floats], clock: Clock, rng: np.random.Generator
) -> dict[tuple[str, str], LoadCellAmplifier]:
    """All load cells of a robot, those of one frame together, by bus and name.

    Args:
        load: gives what each drive bears (drives,) [N].
    """
    frames = dict.fromkeys((cell.bus, cell.frame_id) for cell in description.load_cells)
    out = {}
    for bus, frame_id in frames:
        cells = tuple(cell for cell in description.load_cells if (cell.bus, cell.frame_id) == (bus, frame_id))
        drives = tuple(description.tendon_drives[description.tendon_names.index(cell.tendon)] for cell in cells)
        out[(bus, f"load cells 0x{frame_id:X}")] = LoadCellAmplifier(cells, drives, load, clock, rng)
    return out
