"""How far away the robot process is: the round trip of commands, by what the robot's states say it has taken."""

from collections import deque
from statistics import median

KEPT = 25
"""Half a second of the driver's stream."""


class RobotLag:
    """Fed by the driver's thread alone. It is up to a period of the stream and a tick of the robot too high."""

    def __init__(self) -> None:
        self._sent: deque[tuple[int, float]] = deque(maxlen=10 * KEPT)
        self._trips: deque[float] = deque(maxlen=KEPT)

    @property
    def seconds(self) -> float:
        """Median of the last round trips [s]; 0 before the first."""
        return median(self._trips) if self._trips else 0.0

    def sent(self, sequence: int, now_s: float) -> None:
        """A command left. A sequence that begins anew is another lease's."""
        if self._sent and sequence <= self._sent[-1][0]:
            self._sent.clear()
        self._sent.append((sequence, now_s))

    def taken(self, accepted: int, arrived_s: float) -> None:
        """A state arrived that says which command the robot took last."""
        left_s = None
        while self._sent and self._sent[0][0] <= accepted:
            sequence, at_s = self._sent.popleft()
            left_s = at_s if sequence == accepted else None
        if left_s is not None and arrived_s >= left_s:
            self._trips.append(arrived_s - left_s)
