"""One CAN channel of RMD drives: opened, one burst out, all replies in, matched by (id, command). Nothing on the wire raises."""

import contextlib
import errno
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, Final

import can

from cobra.clock import Clock
from cobra.description import Bus
from cobra.motors.bus import BusError
from cobra.motors.rmd import DIALECTS, MAX_ADDRESS, REQUEST_ID, Dialect, Request, encode

CHANNEL_ERRORS: Final = (can.CanError, OSError, ValueError, ImportError, NotImplementedError)
"""What python-can's interfaces raise when a channel cannot be opened or is gone."""
SEND_TIMEOUT_S: Final = 0.005
"""An interface may wait so long for room in its transmit queue; more than a burst takes on the wire at 1 Mbit/s."""
MAX_STALE_FRAMES: Final = 4096
"""Frames thrown away at once; a flood must not keep the loop from its work."""
MAX_GARBLED: Final = 64
"""Unreadable lines in a row before waiting for the next burst."""

_REPLY_IDS = frozenset(d.reply_id + address for d in DIALECTS.values() for address in range(1, MAX_ADDRESS + 1))
_ADVICE = {
    "socketcan": "bring it up with `ip link set {channel} up type can bitrate {bitrate}` and `ip link set {channel} "
    "txqueuelen 100`; `ip link` lists what there is",
    "slcan": "check that the adapter is plugged in, its device path, and that you may open it (group dialout)",
    "gs_usb": "check that the adapter is plugged in and install the driver: pip install 'python-can[gs-usb]'",
    "pcan": "check that the adapter is plugged in and install the vendor's PCAN-Basic library",
}

Record = Callable[[can.Message, bool], None]
"""Called with every frame and whether it was received; must not keep the message, whose bytes are used again."""


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


def outgoing(dialect: Dialect, address: int, request: Request, **values: float) -> Outgoing:
    """Build a request once. Raises ValueError if a value does not fit."""
    data = encode(dialect, request, **values)
    message = can.Message(arbitration_id=REQUEST_ID + address, is_extended_id=False, is_rx=False, data=data)
    return Outgoing(reply_key(dialect, address, data[0]), message)


def reply_key(dialect: Dialect, address: int, command: int) -> int:
    return (dialect.reply_id + address) << 8 | command


class RmdChannel:
    """Requests out in one burst, replies collected until all are in or the time is over."""

    def __init__(self, bus: Bus, clock: Clock, options: dict[str, Any], counts: Counter[str]) -> None:
        self._described = bus
        self._clock = clock
        self._options = options
        self._counts = counts
        self._bus: can.BusABC | None = None
        self._asked: set[int] = set()
        self._asked_ids: set[int] = set()
        self._burst = _Burst()
        self.welcome: set[int] = set()
        """Keys of frames that are noted though nobody asked: alarms, and the other dialect's answer to a probe."""
        self.noted: set[int] = set()
        """Those of them that came; whoever reads it clears it."""
        self.record: Record | None = None

    @property
    def label(self) -> str:
        return f"bus {self._described.name!r} ({self._described.interface} {self._described.channel})"

    def open(self) -> None:
        """Raises BusError."""
        bus = self._described
        try:
            self._bus = can.Bus(
                interface=bus.interface, channel=bus.channel, bitrate=bus.bitrate, ignore_config=True, **self._options
            )
        except CHANNEL_ERRORS as error:
            advice = _ADVICE.get(bus.interface, "check buses.interface, buses.channel and buses.options")
            advice = advice.format(channel=bus.channel, bitrate=bus.bitrate)
            raise BusError(f"{self.label} cannot be opened: {_one_line(error)}; {advice}") from error

    def close(self) -> None:
        bus, self._bus = self._bus, None
        if bus is not None:
            with contextlib.suppress(*CHANNEL_ERRORS):  # an adapter that was pulled out cannot be closed in order
                bus.shutdown()

    def purge(self) -> None:
        """Throw away what still waits to be sent, and what was received. Raises BusError."""
        bus = self._open_bus()
        try:
            # Most interfaces cannot: those that queue in the kernel drop the queue when the channel goes down.
            with contextlib.suppress(NotImplementedError):
                bus.flush_tx_buffer()
        except CHANNEL_ERRORS as error:
            raise self._gone("purging", error) from error
        self._drain(bus)

    def transact(self, requests: Iterable[Outgoing], timeout_s: float) -> dict[int, Incoming]:
        """Send and collect at once. Raises BusError."""
        self.send(requests, timeout_s)
        return self.collect()

    def send(self, requests: Iterable[Outgoing], timeout_s: float) -> None:
        """Send one burst, after what came too late for the last one is discarded. Raises BusError."""
        bus, clock, record = self._open_bus(), self._clock, self.record
        self._drain(bus)
        burst = self._burst = _Burst(deadline_s=clock.now() + timeout_s)
        for request in requests:
            self._send(bus, request.message, burst.deadline_s)
            if record is not None:
                record(request.message, False)
            burst.pending.add(request.key)
        if not burst.pending <= self._asked:
            self._asked |= burst.pending
            self._asked_ids = {key >> 8 for key in self._asked}

    def collect(self) -> dict[int, Incoming]:
        """Replies to the last burst by key, collected until all are in or its time is over. Raises BusError.

        What arrived in time is taken even if this process was kept from looking until later.
        """
        bus, clock = self._open_bus(), self._clock
        pending, deadline = self._burst.pending, self._burst.deadline_s
        replies: dict[int, Incoming] = {}
        now = clock.now()
        for _ in range(MAX_STALE_FRAMES):
            message = self._receive(bus, max(0.0, deadline - now)) if pending else None
            if message is None:
                break
            now = clock.now()
            key = self._key_of(message)
            if key in pending:
                pending.discard(key)
                replies[key] = Incoming(message.data, now)
            elif key is not None:
                self._unexpected(key)
        return replies

    def _open_bus(self) -> can.BusABC:
        if self._bus is None:
            raise BusError(f"{self.label} is not open; open it first")
        return self._bus

    def _send(self, bus: can.BusABC, message: can.Message, deadline_s: float) -> None:
        while True:
            try:
                return bus.send(message, SEND_TIMEOUT_S)
            except CHANNEL_ERRORS as error:
                # A kernel queue shorter than a burst drains as the frames go out.
                full = (
                    getattr(error, "error_code", None) == errno.ENOBUFS
                    or getattr(error, "errno", None) == errno.ENOBUFS
                )
                now = self._clock.now()
                if not full or now >= deadline_s:
                    raise self._gone("sending", error) from error
                self._counts["transmit queue full"] += 1
                self._clock.sleep_until(now + 0.0002)

    def _receive(self, bus: can.BusABC, timeout_s: float) -> can.Message | None:
        for _ in range(MAX_GARBLED):
            try:
                message = bus.recv(timeout_s)
            except (ValueError, IndexError):
                # A serial adapter's line that is no frame.
                self._counts["garbled frame"] += 1
                timeout_s = 0.0
                continue
            except CHANNEL_ERRORS as error:
                raise self._gone("receiving", error) from error
            if message is not None and self.record is not None:
                self.record(message, True)
            return message
        return None

    def _drain(self, bus: can.BusABC) -> None:
        """What arrives between bursts: late replies, alarms, noise."""
        for _ in range(MAX_STALE_FRAMES):
            message = self._receive(bus, 0.0)
            if message is None:
                return
            key = self._key_of(message)
            if key is not None:
                self._unexpected(key)

    def _unexpected(self, key: int) -> None:
        if key in self.welcome:
            self.noted.add(key)
        elif key in self._asked:
            self._counts["late reply"] += 1
        elif key >> 8 in self._asked_ids:
            self._counts["wrong command"] += 1
        elif key >> 8 in _REPLY_IDS:
            self._counts["reply from a motor never asked"] += 1
        else:
            self._counts["unknown id"] += 1

    def _key_of(self, message: can.Message) -> int | None:
        """Reply id << 8 | command, or None if it can be no reply."""
        if message.is_error_frame:
            self._counts["error frame"] += 1
        elif message.is_remote_frame:
            self._counts["remote frame"] += 1
        elif message.is_extended_id:
            self._counts["extended frame"] += 1
        elif message.is_fd:
            self._counts["FD frame"] += 1
        elif not message.is_rx:
            self._counts["own frame"] += 1
        elif len(message.data) != 8:
            self._counts["short frame" if len(message.data) < 8 else "long frame"] += 1
        else:
            return message.arbitration_id << 8 | message.data[0]
        return None

    def _gone(self, doing: str, error: BaseException) -> BusError:
        return BusError(
            f"{self.label}: {doing} failed: {_one_line(error)}; check the adapter, the cable, the drives' power and the "
            "termination, then open it again"
        )


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__
