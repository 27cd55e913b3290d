"""What tendons would carry if they were stuck just before the port: their conduits alone, rubbing, with a fixed end.

Beside the healthy model (`rubbing`) this says how a jammed tendon would answer its drive. As long as its conduit's
friction holds, a healthy one answers alike.
"""

import numpy as np

from cobra.kinematics.configuration import Floats
from cobra.mechanics import rubbing_kernels as kernels
from cobra.mechanics.rubbing import Rubbing


class StuckTendons:
    """The m tendons of a model, `copies` times, each copy stuck since another time (`begin`)."""

    def __init__(self, model: Rubbing, copies: int) -> None:
        self._model = model
        _, stiffness, capstan = model.conduits
        self._m, parts = stiffness.shape
        self._stiffness, self._capstan = np.tile(stiffness, (copies, 1)), np.tile(capstan, (copies, 1))
        self._counts = np.full(copies * self._m, parts, dtype=np.int64)
        self._extension = np.zeros((copies * self._m, parts))
        self._tension = np.zeros_like(self._extension)
        self._slides = np.zeros(self._extension.shape, dtype=np.int64)

    def begin(self, copy: int) -> None:
        """From now on this copy is stuck, with the tensions that the model has now."""
        self._extension[copy * self._m : (copy + 1) * self._m] = self._model.conduits[0]

    def advance(self, paid_out: Floats) -> Floats:
        """(copies, m) [N] at the motors, once their ends have paid out (m,) [m]."""
        copies = len(self._extension) // self._m
        self._extension[:, 0] -= np.tile(paid_out, copies)
        kernels.relax(self._extension, self._stiffness, self._capstan, self._counts, self._slides, self._tension)
        out: Floats = self._tension[:, 0].reshape(copies, self._m).copy()
        return out
