"""What arrives from other threads, handed to the loop: it alone decodes, judges and answers."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from cobra.messages import Reply

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Asked:
    """A request as it arrived, and where its answer goes."""

    data: bytes
    answer: Callable[[Reply], None]


class Inbox:
    """Bounded queues, so that a flood cannot grow memory; what does not fit is counted. Safe from any thread."""

    def __init__(self, size: int = 256) -> None:
        self.commands: deque[bytes] = deque(maxlen=size)
        self.requests: deque[Asked] = deque(maxlen=size)
        self.stops: deque[bytes] = deque(maxlen=size)
        self.lengths: deque[bytes] = deque(maxlen=size)
        self.overflow = 0

    def command(self, data: bytes) -> None:
        self._put(self.commands, data)

    def stop(self, data: bytes) -> None:
        self._put(self.stops, data)

    def length(self, data: bytes) -> None:
        self._put(self.lengths, data)

    def request(self, data: bytes, answer: Callable[[Reply], None]) -> None:
        self._put(self.requests, Asked(data, answer))

    def _put(self, queue: deque[T], item: T) -> None:
        if len(queue) == queue.maxlen:
            self.overflow += 1
        queue.append(item)
