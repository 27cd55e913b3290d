"""RMD requests on one CAN channel: one burst out, all replies in, matched by (id, command). Nothing on the wire raises."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import can

from cobra.clock import Clock
from cobra.description import Bus
from cobra.motors.channel import MAX_STALE_FRAMES, Channel
from cobra.motors.rmd import DIALECTS, MAX_ADDRESS, REQUEST_ID, WEARS_FLASH, Dialect, Request, encode

_REPLY_IDS = frozenset(d.reply_id + address for d in DIALECTS.values() for address in range(1, MAX_ADDRESS + 1))


@dataclass(slots=True)
class Outgoing:
    """A request whose message is built once; `data` may be written again before each burst."""

    key: int
    """What answers it: reply id << 8 | command."""
    message: can.Message


@dataclass(frozen=True, slots=True)
class Incoming:
    """The reply to a request."""

    data: bytearray
    time_s: float


@dataclass(slots=True)
class _Burst:
    pending: set[int] = field(default_factory=set)
    deadline_s: float = 0.0


def outgoing(
    dialect: Dialect, address: int, request: Request, values: dict[str, float], *, may_wear_flash: bool = False
) -> Outgoing:
    """Build a request once.

    Raises:
        ValueError: a value does not fit; or the request writes flash, which wears, and that was not asked for.
    """
    if request in WEARS_FLASH and not may_wear_flash:
        raise ValueError(f"{request} writes the drive's flash, which wears: pass may_wear_flash=True to mean it")
    data = encode(dialect, request, **values)
    message = can.Message(arbitration_id=REQUEST_ID + address, is_extended_id=False, is_rx=False, data=data)
    return Outgoing(reply_key(dialect, address, data[0]), message)


def reply_key(dialect: Dialect, address: int, command: int) -> int:
    return (dialect.reply_id + address) << 8 | command


class RmdChannel(Channel):
    """Requests out in one burst, replies collected until all are in or the time is over."""

    def __init__(self, bus: Bus, clock: Clock, options: dict[str, Any], counts: Counter[str]) -> None:
        super().__init__(bus, clock, options, counts)
        self._asked: set[int] = set()
        self._asked_ids: set[int] = set()
        self._burst = _Burst()
        self.welcome: set[int] = set()
        """Keys of frames that are noted though nobody asked: alarms, and the other dialect's answer to a probe."""
        self._late: list[int] = []
        self.noted: set[int] = set()
        """Those of them that came; whoever reads it clears it."""

    def transact(self, requests: Iterable[Outgoing], timeout_s: float) -> dict[int, Incoming]:
        """Send and collect at once. Raises BusError."""
        self.discard_late()
        self.send_burst(requests, timeout_s)
        return self.collect()

    def send_burst(self, requests: Iterable[Outgoing], timeout_s: float) -> None:
        """Send one burst; what came too late for the last one is to be discarded before. Raises BusError."""
        burst = self._burst = _Burst(deadline_s=self.clock.now() + timeout_s)
        for request in requests:
            self.send(request.message, burst.deadline_s)
            burst.pending.add(request.key)
        if not burst.pending <= self._asked:
            self._asked |= burst.pending
            self._asked_ids = {key >> 8 for key in self._asked}

    def discard_late(self) -> list[int]:
        """Throw away what came after the last burst's time; the keys of its replies. Raises BusError."""
        self.drain(self._discard)
        late, self._late = self._late, []
        return late

    def collect(self) -> dict[int, Incoming]:
        """Replies to the last burst by key, collected until all are in or its time is over. Raises BusError.

        What arrived in time is taken even if this process was kept from looking until later.
        """
        clock = self.clock
        pending, deadline = self._burst.pending, self._burst.deadline_s
        replies: dict[int, Incoming] = {}
        now = clock.now()
        for _ in range(MAX_STALE_FRAMES):
            message = self.receive(max(0.0, deadline - now)) if pending else None
            if message is None:
                break
            now = clock.now()
            if not self.usable(message) or (key := self._key_of(message)) is None:
                continue
            if key in pending:
                pending.discard(key)
                replies[key] = Incoming(message.data, now)
            else:
                self._unexpected(key)
        return replies

    def _discard(self, message: can.Message) -> None:
        """What arrives between bursts: late replies, alarms, noise."""
        key = self._key_of(message)
        if key is not None:
            self._unexpected(key)

    def _unexpected(self, key: int) -> None:
        if key in self.welcome:
            self.noted.add(key)
        elif key in self._asked:
            self.counts["late reply"] += 1
            if len(self._late) < MAX_STALE_FRAMES:
                self._late.append(key)
        elif key >> 8 in self._asked_ids:
            self.counts["wrong command"] += 1
        elif key >> 8 in _REPLY_IDS:
            self.counts["reply from a motor never asked"] += 1
        else:
            self.counts["unknown id"] += 1

    def _key_of(self, message: can.Message) -> int | None:
        """Reply id << 8 | command, or None if it can be no reply."""
        if len(message.data) != 8:
            self.counts["short frame" if len(message.data) < 8 else "long frame"] += 1
            return None
        return message.arbitration_id << 8 | message.data[0]
