"""Recordings for tests: sessions of a robot that moves, written by the real writer, and a disk that fills up."""

import errno
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import msgspec

from app.recording import channels
from app.recording.channels import Facts, Input
from app.recording.writer import SessionWriter
from cobra.description import RobotDescription
from cobra.loading import description_text, load_description
from cobra.messages import Command, Event, Heard, Intent, Judged, Lease, RobotState, Timing, encode
from tests.app.console.scene_fakes import state_of

COBRA = load_description("cobra")
BEGIN_NS = 1_790_000_000_000_000_000
"""Wall clock of the first message."""
START_S = 500.0
"""The robot's own clock then."""


def facts(description: RobotDescription = COBRA, text: str | None = None, **more: bytes) -> Facts:
    content = {
        channels.DESCRIPTION: (text or description_text(description.name)).encode(),
        channels.VERSIONS: b'{"cobra-teleop": "0.1.0"}',
        channels.SETTINGS: b"{}",
    }
    return Facts(description.name, description, content | more)


def moving(t: float, rate_Hz: float = 50.0, **changes: Any) -> RobotState:
    """The state of a robot that drives, `t` seconds after the start."""
    values: dict[str, Any] = {
        "stamp": START_S + t,
        "tick": round(t * rate_Hz),
        "phase": "driving" if t > 1.0 else "ready",
        "lease": Lease(holder="ada", since=START_S, fresh=True),
        "timing": Timing(rate_Hz=rate_Hz, period_p50=0.02, period_p99=0.021, period_max=0.03),
    }
    return state_of(t=t, **(values | changes))


def judged(sequence: int, t: float, dropped: str = "") -> Judged:
    command = Command(
        lease="abcd0123", epoch=3, sequence=sequence, echo=START_S + t, held=True, intent=Intent(primary=(0.5, -0.25))
    )
    return Judged(stamp=START_S + t, command=command, dropped=dropped)


def write(
    path: Path,
    seconds: float = 3.0,
    *,
    rate_Hz: float = 50.0,
    events: Sequence[Event] = (),
    change: Callable[[RobotState], RobotState] = lambda state: state,
    given: Facts | None = None,
    **options: Any,
) -> list[RobotState]:
    """A session as the real writer writes it; gives its states."""
    states = [change(moving(i / rate_Hz, rate_Hz)) for i in range(round(seconds * rate_Hz))]
    writer = SessionWriter(path, given or facts(), **options)
    writer.start()
    for i, state in enumerate(states):
        arrival = BEGIN_NS + round((state.stamp - START_S) * 1e9)
        writer.put("state", arrival, encode(state))
        heard = Heard(commands=(judged(i, i / rate_Hz, "" if i % 10 else "too old"),))
        writer.put("heard", arrival, encode(heard))
        left = (0.5 if state.phase == "driving" else 0.0, 0.0)
        writer.put("input", arrival, Input(stamp=float(i), source="pad", left=left, buttons=("left_shoulder",)))
    for event in events:
        writer.put("event", BEGIN_NS + round((event.stamp - START_S) * 1e9), encode(event))
    writer.stop()
    return states


class Disk:
    """Stands before `os.write`: takes so many bytes, then says that it is full."""

    def __init__(self, room: int) -> None:
        self.room = room
        self._write = os.write

    def write(self, descriptor: int, data: Any) -> int:
        if self.room <= 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        taken = self._write(descriptor, bytes(data[: self.room]))
        self.room -= taken
        return taken


def same(one: RobotState, other: RobotState) -> bool:
    """Equal, with NaN equal to NaN."""
    return msgspec.msgpack.encode(one) == msgspec.msgpack.encode(other)
