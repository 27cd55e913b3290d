"""From the configuration to the motors and back: tendon map, transmission and the one exchange with the bus."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cobra.description import RobotDescription
from cobra.kinematics.configuration import FEED, TWIST
from cobra.kinematics.tendons import TendonMap
from cobra.motors.bus import HOME_AGAIN, BusError, Feedback, MotorBus
from cobra.motors.transmission import Transmission

Floats = NDArray[np.float64]


class Drivetrain:
    """Travel of all drives (drives,): m of tendon paid out, m of feed, rad of twist; and what the motors last said."""

    def __init__(self, description: RobotDescription, bus: MotorBus) -> None:
        self.description = description
        self.bus = bus
        self.tendons = TendonMap(description)
        self.transmission = Transmission(description)
        self.feedback: Feedback | None = None
        self.gone = ""
        """Why the bus cannot be reached, in words; empty while it can."""
        self.tendon_index = np.array(description.tendon_drives, dtype=np.int64)
        """For each tendon the index of its drive."""
        base = ((TWIST, description.twist_drive), (FEED, description.feed_drive))
        self._base = {column: drive for column, drive in base if drive is not None}
        self._known: set[int] = set()
        """Drives of twist and feed whose travel is known: since the first homing, until they lose their count."""

    def refer(self, angle: Floats, travel: Floats) -> None:
        """The shafts' `angle` (drives,) [rad] means `travel` (drives,)."""
        self.transmission.refer(angle, travel)
        self._known = set(self._base.values())

    def refer_tendons(self, angle: Floats, q: Floats) -> tuple[Floats, tuple[str, ...]]:
        """The tendons' `angle` (drives,) [rad] means q. Twist and feed stay what they are known to be; else they are q's.

        Returns q as it is now taken, and in words which of twist and feed had lost its count.
        """
        q, now = q.copy(), self.transmission.travel(angle)
        lost: tuple[str, ...] = ()
        for column, drive in self._base.items():
            if drive in self._known:
                q[column] = now[drive]
            elif self.transmission.references:
                lost = (*lost, _lost(column, self.description.drives[drive].name, float(q[column])))
        self.refer(angle, self.travel_of(q))
        return q, lost

    def travel_of(self, q: Floats) -> Floats:
        """Travel of all drives for a configuration."""
        travel = np.zeros(len(self.description.drives))
        travel[self.tendon_index] = self.tendons.lengths(q)
        for column, drive in self._base.items():
            travel[drive] = q[column]
        return travel

    def q_of(self, travel: Floats, near: Floats) -> Floats:
        """q from the drives' travel alone (least squares over all tendons); what no drive moves is taken from `near`."""
        q = near.copy()
        for column, drive in self._base.items():
            q[column] = travel[drive]
        return self.tendons.shape(travel[self.tendon_index], q).q

    def loads(self, *, of_one_kind: bool = False) -> Floats:
        """Load of each drive [N or N·m], as `Transmission.loads`; zeros before the first feedback."""
        if self.feedback is None:
            return np.zeros(len(self.description.drives))
        return self.transmission.loads(self.feedback.current, self.feedback.cells.tension, of_one_kind=of_one_kind)

    def speeds(self) -> Floats:
        """Speed of each drive's travel, a second; zeros before the first feedback."""
        if self.feedback is None:
            return np.zeros(len(self.description.drives))
        return self.feedback.velocity * self.transmission.travel_per_rad

    def measured_tensions(self) -> Floats:
        """(m,) what load cells measure of each tendon [N]; NaN where there is none that can be believed."""
        if self.feedback is None or not len(self.feedback.cells.tension):
            return np.full(len(self.tendon_index), np.nan)
        return self.feedback.cells.tension

    def exchange(self, travel: Floats | None) -> None:
        """Send the setpoints, or only read with None, and keep the feedback. A bus that is gone is remembered in `gone`."""
        try:
            self._take(self.bus.exchange(None if travel is None else self.transmission.angle(travel)))
        except BusError as error:
            self._lose(error)

    def send(self, travel: Floats | None) -> None:
        """The sending half of `exchange`."""
        try:
            self.bus.burst(None if travel is None else self.transmission.angle(travel))
        except BusError as error:
            self._lose(error)

    def gather(self) -> None:
        """The receiving half, but for what the replies say."""
        try:
            self.bus.gather()
        except BusError as error:
            self._lose(error)

    def hear(self) -> None:
        """Keep what the replies say that were gathered last."""
        try:
            self._take(self.bus.told())
        except BusError as error:
            self._lose(error)

    def switch_off(self, hold: bool) -> None:
        """The drives lose their torque, or with `hold` keep standing where they are."""
        try:
            if hold:
                self.bus.hold()
            else:
                self.bus.disable()
        except BusError as error:
            self._lose(error)

    def _take(self, feedback: Feedback) -> None:
        self.feedback, self.gone = feedback, ""
        if any(feedback.faults):
            self._known -= {drive for drive in self._known if HOME_AGAIN in feedback.faults[drive]}

    def _lose(self, error: BusError) -> None:
        """What the drives said last stands, but nobody may take it for news."""
        self.gone = str(error)
        if self.feedback is not None:
            n = len(self.feedback.valid)
            self.feedback = replace(self.feedback, valid=np.zeros(n, dtype=bool), age=np.full(n, np.inf))


def _lost(column: int, name: str, taken: float) -> str:
    where = f"{np.degrees(taken):.0f} degrees" if column == TWIST else f"{taken * 1e3:.0f} mm"
    return (
        f"drive {name} lost its count: where it stands is taken for {where}, as in the beginning. If that is wrong, bring it "
        "there and start the robot's program again"
    )
