"""The hand of whoever feeds a simulated robot. Made only where a plant is simulated: a real robot has a real one.

It slides the robot in and out as far as the robot has taken in the length that it was told, so that what slides into the
port is straight by then. No drive is told anything.
"""

from cobra.description import RobotDescription
from cobra.messages import RobotState
from cobra.simulation.plant import Plant


class TwinHand:
    """`state` is called with every state of the robot, on the loop's thread; it never blocks."""

    def __init__(self, plant: Plant, description: RobotDescription) -> None:
        self._plant = plant
        self._feeds = description.hand_fed

    def state(self, state: RobotState) -> None:
        if self._feeds and state.motion.hand_feed:
            self._plant.feed_by_hand(state.motion.hand_feed.used_m)
