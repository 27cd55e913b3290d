"""What every mode is to the loop, and which modes a robot offers."""

from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from cobra.description import RobotDescription
from cobra.messages import Intent, ModeReport

Floats = NDArray[np.float64]

ModeName = Literal["section", "tip", "following", "straighten", "pose"]


class Mode(Protocol):
    """Turns intents into the commanded configuration q and its velocity; both (size,)."""

    @property
    def q(self) -> Floats: ...

    @property
    def velocity(self) -> Floats: ...

    def warm_up(self) -> None:
        """Compile what has to be compiled: at start, and not while driving."""

    def reset(self, q: Floats) -> None:
        """Begin at rest at q (bumpless): nothing moves until an intent asks for it."""

    def propose(self, intent: Intent | None, dt_s: float, fed_m: float | None) -> tuple[Floats, Floats]:
        """The next q and its velocity, not taken yet, so that later limits may scale the step.

        Args:
            intent: what the driver wants; None while nobody drives, which ramps every motion to rest.
            dt_s: duration of the tick.
            fed_m: the exposed length of a robot that is fed by hand; None for one with a drive for it.
        """

    def take(self, q: Floats, velocity: Floats) -> None:
        """Make the proposed step, or the part of it that was allowed, the commanded one."""

    def report(self) -> ModeReport:
        """What it has to say of itself."""


def modes_of(description: RobotDescription) -> tuple[ModeName, ...]:
    """The modes that make sense for a robot, the first one to begin with.

    One without tendons of its own is twisted and fed, and goes to saved poses; it has nothing to steer or to straighten.
    Nothing follows a tip that is not fed.
    """
    if not description.active_sections:
        return ("section", "pose")
    if description.feed or description.hand_fed:
        return ("section", "tip", "following", "straighten", "pose")
    return ("section", "tip", "straighten", "pose")
