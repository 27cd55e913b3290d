"""Forces that people drag onto the twin in the 3D view. Made only where a plant is simulated: on hardware nothing listens.

They push the physics, as a hand would; no drive is told anything. What is not repeated ends.
"""

import threading
from collections import Counter

import msgspec
import numpy as np

from cobra.clock import Clock
from cobra.description import RobotDescription
from cobra.messages import Push, decode
from cobra.simulation.plant import Plant

LAPSE_S = 0.5
"""A push that is not repeated for so long is over: its sender is gone."""
SHARE = 0.1
"""Of a tendon's largest tension: the strongest push."""
STRONGEST_N = 10.0
"""The same for a robot without tendons."""


def strongest_push_N(description: RobotDescription) -> float:
    """What a push may be at most: enough to see, and no more than a robot might survive."""
    return SHARE * description.tendon.max_tension_N if description.tendon else STRONGEST_N


class TwinPushes:
    """Holds what pushes on a plant now. `take` from the link's thread, `expire` regularly from any."""

    def __init__(self, plant: Plant, description: RobotDescription, clock: Clock) -> None:
        self._plant = plant
        self._clock = clock
        self._count = len(plant.truth().vertebrae)
        self._strongest = strongest_push_N(description)
        self._since: dict[int, float] = {}
        self._lock = threading.Lock()
        self.refused: Counter[str] = Counter()
        """Messages that pushed nothing, by reason."""

    def take(self, data: bytes) -> None:
        """Push as a message says; never raises."""
        try:
            push = decode(data, Push)
        except msgspec.MsgspecError:
            self.refused["malformed push"] += 1
            return
        force = np.array(push.force_N)
        if not 0 <= push.vertebra < self._count:
            self.refused[f"push on a vertebra that does not exist (there are {self._count})"] += 1
        elif not (np.isfinite(force).all() and np.linalg.norm(force) <= self._strongest * 1.001):
            self.refused[f"push of more than {self._strongest:g} N"] += 1
        else:
            with self._lock:
                self._plant.push(push.vertebra, force)
                if force.any():
                    self._since[push.vertebra] = self._clock.now()
                else:
                    self._since.pop(push.vertebra, None)

    def expire(self) -> None:
        """End what was not repeated."""
        now = self._clock.now()
        with self._lock:
            for vertebra in [v for v, since in self._since.items() if now - since > LAPSE_S]:
                self._plant.push(vertebra, np.zeros(3))
                del self._since[vertebra]
