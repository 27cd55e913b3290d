"""A pad whose stream lives while its content is dead: the radio link dropped and the last values are repeated."""

from app.console.inputs import Controls

STILL_S = 2.0
"""No hand holds a stick in mid-travel for longer without trembling by a thousandth of its travel."""
MONOTONOUS_S = 20.0
"""After this long without any change, even of a coarse or fully pushed stick, the driver is asked to press again."""
FINE_STEP = 0.002
"""A stick that has shown a smaller step resolves a hand's tremor (10 bit and better; an 8-bit stick steps by 0.008)."""
MID_TRAVEL = (0.15, 0.95)
"""Where a value is neither at rest nor at the end stop: there it is a hand that holds it."""


class FreezeWatch:
    """Tells when a held device has not changed for longer than a hand can hold it still.

    What it can see is limited: a coarse device, or one pushed against its end stop, may rightly stay constant, so only
    the long limit applies to it. A device that is *known* to be gone never gets here.
    """

    def __init__(self) -> None:
        self._last = Controls()
        self._changed_s = 0.0
        self._fine = [False] * 6

    def look(self, controls: Controls) -> None:
        """Take the next reading."""
        values, last = _values(controls), _values(self._last)
        for i, (value, before) in enumerate(zip(values, last, strict=True)):
            self._fine[i] = self._fine[i] or 0.0 < abs(value - before) < FINE_STEP
        if values != last or controls.buttons != self._last.buttons:
            self._changed_s = controls.stamp
        self._last = controls

    def still_s(self) -> float:
        """How long nothing has changed [s]."""
        return self._last.stamp - self._changed_s

    def frozen(self) -> bool:
        """Whether the newest reading has stayed the same for too long. Only meaningful while it moves the robot."""
        low, high = MID_TRAVEL
        by_hand = any(fine and low < abs(v) < high for fine, v in zip(self._fine, _values(self._last), strict=True))
        return self.still_s() > (STILL_S if by_hand else MONOTONOUS_S)


def _values(controls: Controls) -> tuple[float, ...]:
    return (*controls.left, *controls.right, controls.left_trigger, controls.right_trigger)
