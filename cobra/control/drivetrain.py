"""From the configuration to the motors and back: tendon map, transmission and the one exchange with the bus."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cobra.description import RobotDescription
from cobra.kinematics.configuration import FEED, TWIST
from cobra.kinematics.tendons import TendonMap
from cobra.motors.bus import BusError, Feedback, MotorBus
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

    def travel_of(self, q: Floats) -> Floats:
        """Travel of all drives for a configuration."""
        travel = np.zeros(len(self.description.drives))
        travel[self.tendon_index] = self.tendons.lengths(q)
        if self.description.twist_drive is not None:
            travel[self.description.twist_drive] = q[TWIST]
        if self.description.feed_drive is not None:
            travel[self.description.feed_drive] = q[FEED]
        return travel

    def q_of(self, travel: Floats, near: Floats) -> Floats:
        """q from the drives' travel alone (least squares over all tendons); what no drive moves is taken from `near`."""
        q = near.copy()
        if self.description.twist_drive is not None:
            q[TWIST] = travel[self.description.twist_drive]
        if self.description.feed_drive is not None:
            q[FEED] = travel[self.description.feed_drive]
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
            self.feedback = self.bus.exchange(None if travel is None else self.transmission.angle(travel))
            self.gone = ""
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
            self.feedback = self.bus.told()
            self.gone = ""
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

    def _lose(self, error: BusError) -> None:
        """What the drives said last stands, but nobody may take it for news."""
        self.gone = str(error)
        if self.feedback is not None:
            n = len(self.feedback.valid)
            self.feedback = replace(self.feedback, valid=np.zeros(n, dtype=bool), age=np.full(n, np.inf))
