"""The seam between simulated drives and the physics they move."""

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from cobra.simulation.environments import Environment

Floats = NDArray[np.float64]


def nowhere() -> Floats:
    """No points (0, 3)."""
    return np.zeros((0, 3))


@dataclass(frozen=True, slots=True)
class Truth:
    """The twin's own truth, for tests and plots only; no controller reads it."""

    time_s: float
    tip_position: Floats
    """(3,) in the frame of the entry port [m]."""
    tip_wxyz: Floats
    """(4,)"""
    vertebrae: Floats
    """(n, 3) centres of the vertebrae, base first [m]."""
    bends: Floats
    """(sections, 2) bend vector of each section [rad]."""
    tensions: Floats
    """(tendons,) at the motors [N]."""
    tension_profile: Floats
    """(tendons, 2 + sections) at the motor, at the port, and at the end of each section [N]; NaN beyond a tendon's end."""
    locked: tuple[bool, ...] = ()
    """For each chamber whose guiders can catch in each other's slots whether they have, base first."""
    passive: Floats = field(default_factory=nowhere)
    """(k, 3) along the passive body behind the sections, base first [m]; none in free space, where it is straight."""
    contact_points: Floats = field(default_factory=nowhere)
    """(k, 3) where walls press on the robot [m]."""
    contact_forces: Floats = field(default_factory=nowhere)
    """(k, 3) on the robot [N]."""
    clearance_m: float = math.inf
    """From the body's skin to the nearest wall, beyond the port; negative where it presses in. inf without walls."""
    clearance_points: Floats = field(default_factory=nowhere)
    """(2, 3) the nearest two points of body's axis and wall [m]; none without walls."""


class Plant(Protocol):
    """Physics driven by the travel of the drives."""

    @property
    def environment(self) -> "Environment | None":
        """The walls around the robot; None in free space."""

    def advance(self, travel: Floats, duration_s: float) -> Floats:
        """Move the drives' ends to `travel` and let `duration_s` pass.

        `travel` has one entry a drive: m of tendon paid out, m of feed, rad of twist; 0 is a straight robot with its
        tendons just taut, and for the feed an exposed length of 0. The first call tells where the drives stand. Returns
        the load at each drive: tension [N] (≥ 0), and what the drive exerts along the feed [N] and about the twist [N·m].
        """

    def truth(self) -> Truth:
        """A consistent snapshot; safe to call from another thread."""

    def push(self, vertebra: int, force: Floats, torque: Floats | None = None) -> None:
        """From now on push at a vertebra's centre: `force` (3,) [N], `torque` (3,) [N·m], in the frame of the port.

        `vertebra` counts as in `Truth.vertebrae`. Safe to call from another thread.
        """

    def feed_by_hand(self, length_m: float) -> None:
        """Somebody feeds the robot until this much is exposed, as a hand does it. Safe to call from another thread.

        Raises:
            ValueError: it is not fed by hand.
        """
