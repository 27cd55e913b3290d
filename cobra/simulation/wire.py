"""The medium of one simulated bus: who hears whom, how long frames take, and what goes wrong on the way.

With timing "instant" a frame is through as soon as it is sent. With "bit-true" it takes its exact bits at the bus's bit rate,
stuffing and interframe space included; senders that wait arbitrate, the lowest id first, and each sender's own frames keep
their order. Frames that are corrupted on a real bus are repeated by the controllers; what `corrupt` changes is what an
adapter hands on wrongly.
"""

import copy
import math
import random
import threading
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final, Literal, Protocol

import can

from cobra.motors.frame_bits import frame_bits
from cobra.simulation.node import Frame, Node

Timing = Literal["instant", "bit-true"]

ADAPTER_QUEUE_FRAMES: Final = 64
"""Frames that an adapter keeps while the bus is busy."""
BUS_OFF_ID: Final = 0x040
"""Of the error frame that tells it (linux/can/error.h)."""


class Adapter(Protocol):
    """A program's end of the bus."""

    def receive(self, frame: can.Message) -> None: ...

    def nudge(self) -> None:
        """A frame is on its way now: look again when the next one will be through."""


@dataclass(slots=True)
class WireFaults:
    """What is wrong with a bus, by drive: probabilities 0…1 for each frame, delays of replies [s]."""

    drop: dict[str, float] = field(default_factory=dict)
    corrupt: dict[str, float] = field(default_factory=dict)
    duplicate: dict[str, float] = field(default_factory=dict)
    delay_s: dict[str, float] = field(default_factory=dict)
    off: bool = False
    """The programs' adapters are bus-off: they neither send nor receive."""
    jammed: bool = False
    """Nothing gets through; what is sent waits."""

    @property
    def any(self) -> bool:
        return bool(self.drop or self.corrupt or self.duplicate or self.delay_s or self.off or self.jammed)


@dataclass(slots=True)
class _Waiting:
    ready_s: float
    frame: Frame
    sender: Adapter | str
    """An adapter, or a drive's name."""
    message: can.Message | None
    """As the adapter sent it."""
    seconds: float


class Wire:
    """Drives by name, adapters that come and go. Any thread may call it."""

    def __init__(
        self,
        drives: Mapping[str, Node],
        now: Callable[[], float],
        bitrate: int,
        timing: Timing,
        latency_s: float,
        seed: int,
    ) -> None:
        """`latency_s`: how long a drive thinks before it answers."""
        self.adapters: tuple[Adapter, ...] = ()
        self.faults = WireFaults()
        self._now = now
        self._bitrate = bitrate
        self._timed = timing == "bit-true"
        self._latency_s = latency_s
        self._listeners: dict[int, list[tuple[str, Node]]] = {}
        for name, drive in drives.items():
            for arbitration_id in drive.listens:
                self._listeners.setdefault(arbitration_id, []).append((name, drive))
        self._random = random.Random(seed)
        self._lock = threading.RLock()
        self._queues: dict[int | str, deque[_Waiting]] = {}
        """Frames that wait, by sender: each sends its own in their order."""
        self._free_s = -math.inf

    def send(self, sender: Adapter, message: can.Message) -> None:
        """A program's frame. Raises can.CanOperationError when the adapter's queue is full."""
        with self._lock:
            if self.faults.off:
                sender.receive(can.Message(arbitration_id=BUS_OFF_ID, is_error_frame=True, is_extended_id=False, dlc=8))
                return
            frame = (message.arbitration_id, bytes(message.data))
            if not self._timed and not self.faults.jammed:
                self._pass(frame, sender, message, self._now())
                return
            self.settle()
            if len(self._queues.get(id(sender), ())) >= ADAPTER_QUEUE_FRAMES:
                raise can.CanOperationError("Transmit buffer full", 105)  # ENOBUFS
            self._wait(id(sender), _Waiting(self._now(), frame, sender, message, self._seconds(frame)))

    def say(self, drive: str, frames: list[Frame]) -> None:
        """What a drive sends by itself."""
        if frames:
            with self._lock:
                self._reply(drive, frames, self._now())

    def settle(self) -> None:
        """Let everything pass that is through by now."""
        with self._lock:
            now = self._now()
            while (waiting := self._winner()) is not None:
                end_s = max(self._free_s, waiting.ready_s) + waiting.seconds
                if end_s > now:
                    return
                self._free_s = end_s
                self._queues[self._key(waiting)].popleft()
                if not self.faults.off:
                    self._pass(waiting.frame, waiting.sender, waiting.message, end_s)

    @property
    def next_s(self) -> float:
        """When the next frame will be through; inf if none is on its way."""
        with self._lock:
            waiting = self._winner()
            return math.inf if waiting is None else max(self._free_s, waiting.ready_s) + waiting.seconds

    def leave(self, adapter: Adapter) -> None:
        """An adapter is closed; what it still had to send is gone with it."""
        with self._lock:
            self.adapters = tuple(other for other in self.adapters if other is not adapter)
            self.purge(adapter)

    def purge(self, adapter: Adapter) -> None:
        with self._lock:
            self._queues.pop(id(adapter), None)

    # ---------------------------------------------------------------------------------------------------------------

    def _seconds(self, frame: Frame) -> float:
        return frame_bits(frame[0], frame[1][:8]) / self._bitrate if self._timed else 0.0

    def _wait(self, key: int | str, waiting: _Waiting) -> None:
        self._queues.setdefault(key, deque()).append(waiting)
        for adapter in self.adapters:
            adapter.nudge()

    def _key(self, waiting: _Waiting) -> int | str:
        return waiting.sender if isinstance(waiting.sender, str) else id(waiting.sender)

    def _winner(self) -> _Waiting | None:
        """The frame that is, or will be next, on the bus: the lowest id of those that wait when it becomes free."""
        if self.faults.jammed:
            return None
        heads = [queue[0] for queue in self._queues.values() if queue]
        if not heads:
            return None
        start_s = max(self._free_s, min(head.ready_s for head in heads))
        return min((head for head in heads if head.ready_s <= start_s), key=lambda head: head.frame[0])

    def _pass(self, frame: Frame, sender: Adapter | str, message: can.Message | None, time_s: float) -> None:
        """A frame is through: everybody but its sender has it."""
        self._show(frame, sender, message, time_s)
        if message is not None and (
            message.is_error_frame or message.is_remote_frame or message.is_extended_id or message.is_fd
        ):
            return
        drop = self.faults.drop
        for name, drive in self._listeners.get(frame[0], ()):
            if name == sender or (drop and self._random.random() < drop.get(name, 0.0)):
                continue
            replies = drive.hear(*frame)
            if replies:
                self._reply(name, replies, time_s)

    def _reply(self, drive: str, frames: list[Frame], time_s: float) -> None:
        faults = self.faults
        if faults.any:
            frames = [each for frame in frames for each in self._damaged(drive, frame)]
        delay_s = self._latency_s + faults.delay_s.get(drive, 0.0)
        for frame in frames:
            if self._timed or delay_s or faults.jammed:
                self._wait(drive, _Waiting(time_s + delay_s, frame, drive, None, self._seconds(frame)))
            elif not faults.off:
                self._pass(frame, drive, None, time_s)

    def _damaged(self, drive: str, frame: Frame) -> list[Frame]:
        faults, dice = self.faults, self._random.random
        if dice() < faults.drop.get(drive, 0.0):
            return []
        arbitration_id, data = frame
        if data and dice() < faults.corrupt.get(drive, 0.0):
            at = self._random.randrange(len(data))
            data = data[:at] + bytes([data[at] ^ self._random.randrange(1, 256)]) + data[at + 1 :]
        return [(arbitration_id, data)] * (2 if dice() < faults.duplicate.get(drive, 0.0) else 1)

    def _show(self, frame: Frame, sender: Adapter | str, message: can.Message | None, time_s: float) -> None:
        for adapter in self.adapters:
            if adapter is sender:
                continue
            if message is None:
                shown = can.Message(timestamp=time_s, arbitration_id=frame[0], is_extended_id=False, data=frame[1])
            else:
                shown = copy.deepcopy(message)
                shown.timestamp, shown.is_rx = time_s, True
            adapter.receive(shown)
