"""From an intent to the commanded configuration, in the mode that the driver chose: rates, never positions.

Modes are switched at rest only, and the new one begins at the q of the old one: bumpless.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from cobra.control.modes.go_to import GoToMode, straight
from cobra.control.modes.hand_feed import HandFeed
from cobra.control.modes.mode import Mode, modes_of
from cobra.control.modes.section import SectionMode
from cobra.description import RobotDescription
from cobra.kinematics.configuration import FEED, Configuration
from cobra.messages import Intent, MotionReport

Floats = NDArray[np.float64]

STILL = 1e-6
"""A share of its rate: an entry of q that is slower stands."""
NO_POSE = "choose a saved pose to go to"


class Motion:
    """All modes of one robot; exactly one of them moves it."""

    def __init__(self, description: RobotDescription, poses: Mapping[str, Floats] | None = None) -> None:
        """`poses` are those to go to, by name; it is read anew whenever one is asked for."""
        self.configuration = Configuration(description)
        self.names = modes_of(description)
        self.hand_feed = HandFeed(description)
        self._description = description
        self._poses: Mapping[str, Floats] = {} if poses is None else poses
        self._made: dict[str, Mode] = {}
        self._wanted = self._active = self.names[0]
        self._pose = ""
        self._rate = np.where(self.configuration.rate > 0.0, self.configuration.rate, np.inf)

    @property
    def mode(self) -> str:
        """The mode chosen."""
        return self._wanted

    @property
    def pose(self) -> str:
        """The saved pose chosen."""
        return self._pose

    @property
    def q(self) -> Floats:
        """The commanded configuration (size,)."""
        return self._moving.q

    @property
    def velocity(self) -> Floats:
        """Of the last step (size,)."""
        return self._moving.velocity

    def warm_up(self) -> None:
        """Make every mode and compile what it needs: seconds the first time on a machine. Not while driving."""
        for name in self.names:
            self._mode(name).warm_up()

    def choose(self, mode: str, pose: str = "") -> None:
        """Drive in this mode from now on; what still moves comes to rest in the old one first.

        Raises:
            KeyError: the robot does not offer it.
        """
        if mode not in self.names:
            raise KeyError(mode)
        self._wanted, self._pose = mode, pose

    def reset(self, q: Floats) -> None:
        """Begin at rest at q, brought inside the limits; a length fed by hand is taken as it was told."""
        q = q.copy()
        if self.hand_feed.offered:
            q[FEED] = self.hand_feed.begin(float(q[FEED]))
        self._begin(q)

    def propose(self, intent: Intent | None, dt_s: float) -> tuple[Floats, Floats]:
        """The next q and its velocity after one tick of `dt_s`; None ramps every motion to rest."""
        if self._active != self._wanted:
            if self._stands:
                self._begin(self.q)
            else:
                intent = None
        moving = self._moving
        if isinstance(moving, GoToMode):
            moving.aim(self._pose)
        fed = self.hand_feed.next(float(self.q[FEED]), intent is not None, dt_s)
        return moving.propose(intent, dt_s, fed)

    def take(self, q: Floats, velocity: Floats) -> None:
        """Make a proposed step, or the part of it that was allowed, the commanded one."""
        self._moving.take(q, velocity)

    def report(self, now_s: float) -> MotionReport:
        """What the motion has to say, for people."""
        return MotionReport(
            modes=self.names,
            poses=tuple(self._poses),
            pose=self._pose,
            doing=self._moving.report(),
            hand_feed=self.hand_feed.report(float(self.q[FEED]), now_s),
        )

    @property
    def _moving(self) -> Mode:
        return self._mode(self._active)

    @property
    def _stands(self) -> bool:
        return bool(np.all(np.abs(self.velocity) <= STILL * self._rate))

    def _begin(self, q: Floats) -> None:
        self._active = self._wanted
        self._moving.reset(q)

    def _mode(self, name: str) -> Mode:
        if name not in self._made:
            self._made[name] = self._make(name)
        return self._made[name]

    def _make(self, name: str) -> Mode:
        d = self._description
        match name:
            case "section":
                return SectionMode(d)
            case "straighten":
                return GoToMode(d, straight(d), "")
            case "pose":
                return GoToMode(d, lambda pose, _: self._poses.get(pose), NO_POSE)
            # These bring numba, whose import takes a second: only where they are made.
            case "tip":
                from cobra.control.modes.tip import TipMode

                return TipMode(d)
            case _:
                from cobra.control.modes.following import FollowingMode

                return FollowingMode(d)
