"""STOP, said again and again until the robot says that it heard it.

Zenoh drops a message rather than wait for more than a millisecond, and a link may break at any moment: a single message is
not enough for a STOP. Each press has a mark of its own by which the robot obeys it once, and tells that it did.
"""

import contextlib
import secrets
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass, field

import zenoh

from cobra.messages import RobotState, Stop, encode

REPEAT_S = 0.02
CONFIRM_S = 1.0
"""A STOP that is not confirmed for so long is told to whoever pressed it …"""
GIVE_UP_S = 10.0
"""… and goes on being said for so long, should the robot be heard again."""
MAX_AT_ONCE = 32
UNCONFIRMED = "the robot does not confirm the STOP: use its emergency stop. It is told again for ten seconds"


@dataclass(frozen=True, slots=True)
class _Press:
    mark: str
    data: bytes
    since_s: float
    confirmed: "Future[bool]" = field(default_factory=Future)


class Stopping:
    """Says STOP to one robot. Safe from any thread, and blocks none.

    Args:
        put: sends one encoded `Stop`, or does nothing where there is no link.
        latest: the newest state of the robot.
    """

    def __init__(self, put: Callable[[bytes], None], latest: Callable[[], RobotState | None]) -> None:
        self._put = put
        self._latest = latest
        self._lock = threading.Lock()
        self._presses: list[_Press] = []

    def say(self, who: str, reason: str) -> "Future[bool]":
        """STOP. The result tells whether the robot confirmed it within `CONFIRM_S`."""
        mark = secrets.token_hex(4)
        press = _Press(mark, encode(Stop(who=who, reason=reason, press=mark)), time.monotonic())
        press.confirmed.set_running_or_notify_cancel()  # whoever waits for it cannot call it off
        with self._lock:
            if len(self._presses) >= MAX_AT_ONCE:
                return self._presses[-1].confirmed
            self._presses.append(press)
            if len(self._presses) == 1:
                threading.Thread(target=self._insist, name="stop", daemon=True).start()
        self._try(press)
        return press.confirmed

    def _insist(self) -> None:
        while True:
            time.sleep(REPEAT_S)
            with self._lock:
                self._presses = [press for press in self._presses if not self._over(press)]
                if not self._presses:
                    return
                again = tuple(self._presses)
            for press in again:
                self._try(press)

    def _over(self, press: _Press) -> bool:
        state, age_s = self._latest(), time.monotonic() - press.since_s
        heard = state is not None and press.mark in state.stops
        if (heard or age_s > CONFIRM_S) and not press.confirmed.done():
            press.confirmed.set_result(heard)
        return heard or age_s > GIVE_UP_S

    def _try(self, press: _Press) -> None:
        with contextlib.suppress(zenoh.ZError):  # the link is closing: the next turn may find another one
            self._put(press.data)
