"""Open the motors of a described robot, on however many channels, as one `MotorBus`."""

import contextlib
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from cobra.clock import Clock
from cobra.description import Bus, RobotDescription
from cobra.motors.bus import BusError, ChannelHealth, Feedback, Floats, MotorBus
from cobra.motors.bus_load import channel_load
from cobra.motors.raw_log import RawLog
from cobra.motors.rmd_bus import RmdBus

SIMULATED = "cobra-sim"


def open_bus(description: RobotDescription, clock: Clock, can_log: Path | None = None) -> MotorBus:
    """The motor bus of a robot; `with open_bus(...) as bus` opens and closes its channels.

    Args:
        can_log: file that gets every frame, `.log` or `.blf`.

    Raises:
        BusError: a channel could not carry the robot at its loop rate, or a drive speaks a protocol that is not known.
    """
    for drive in description.drives:
        protocol = description.motor_of(drive).protocol
        if not protocol.startswith("rmd"):
            raise BusError(f"drive {drive.name!r}: protocol {protocol!r} cannot be driven; use rmd-v1 or rmd-v3")
    used = [bus for bus in description.buses if any(drive.bus == bus.name for drive in description.drives)]
    for bus in used:
        if complaint := channel_load(description, bus).complaint():
            raise BusError(complaint)
    log = RawLog(can_log) if can_log is not None else None
    channels = []
    for bus in used:
        channel = RmdBus(description, bus, clock, _options(description, bus, clock))
        channel.record_to(log.recorder(bus.name) if log is not None else None)
        channels.append(channel)
    return JoinedBus(channels, log)


def _options(description: RobotDescription, bus: Bus, clock: Clock) -> dict[str, Any]:
    # Simulated drives live in the caller's time and are those of the very description that is driven.
    shared = {"clock": clock, "description": description} if bus.interface == SIMULATED else {}
    return {**shared, **bus.options}


class JoinedBus:
    """Several channels as one `MotorBus`: all bursts go out before the first reply is awaited."""

    def __init__(self, channels: list[RmdBus], log: RawLog | None) -> None:
        self._channels = channels
        self._log = log
        self._scopes = [np.array(channel.indices, dtype=np.intp) for channel in channels]
        # Reading entry i of all channels one after the other gives the description's order.
        self._order = np.argsort(np.concatenate(self._scopes))
        self._stack = contextlib.ExitStack()

    @property
    def counts(self) -> dict[str, int]:
        """Frames that could not be used and other misses, by reason, of all channels."""
        total: Counter[str] = Counter()
        for channel in self._channels:
            total.update(channel.counts)
        if self._log is not None and self._log.dropped:
            total["not in the CAN log"] = self._log.dropped
        return dict(total)

    @property
    def notes(self) -> tuple[str, ...]:
        """What people should know about these drives."""
        return tuple(note for channel in self._channels for note in channel.notes)

    @property
    def health(self) -> tuple[ChannelHealth, ...]:
        return tuple(channel.health for channel in self._channels)

    def open(self) -> None:
        """Raises BusError; what was opened before is closed again."""
        with contextlib.ExitStack() as stack:
            if self._log is not None:
                stack.enter_context(self._log)
            for channel in self._channels:
                stack.enter_context(channel)
            self._stack = stack.pop_all()

    def close(self) -> None:
        self._stack.close()

    def enable(self) -> tuple[str, ...]:
        """Every channel is probed even if one cannot be enabled; then none takes setpoints. Raises BusError."""
        reasons = tuple(reason for channel in self._channels for reason in channel.enable())
        if reasons:
            for channel in self._channels:
                channel.refuse_setpoints()
        return reasons

    def disable(self) -> None:
        """Raises BusError, after every channel was told."""
        self._tell_each(RmdBus.disable)

    def hold(self) -> None:
        """Raises BusError, after every channel was told."""
        self._tell_each(RmdBus.hold)

    def exchange(self, angles: Floats | None) -> Feedback:
        """One exchange with all drives. Raises BusError if a channel is gone, after the others were served."""
        errors: list[BusError] = []
        for channel, scope in zip(self._channels, self._scopes, strict=True):
            with _kept(errors):
                channel.burst(None if angles is None else angles[scope])
        parts = []
        for channel in self._channels:
            with _kept(errors):
                parts.append(channel.collect())
        if errors:
            raise errors[0]
        return parts[0] if len(parts) == 1 else self._joined(parts)

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _tell_each(self, tell: Callable[[RmdBus], None]) -> None:
        errors: list[BusError] = []
        for channel in self._channels:
            with _kept(errors):
                tell(channel)
        if errors:
            raise errors[0]

    def _joined(self, parts: list[Feedback]) -> Feedback:
        def join(name: str) -> Any:
            return np.concatenate([getattr(part, name) for part in parts])[self._order]

        faults = [fault for part in parts for fault in part.faults]
        return Feedback(
            angle=join("angle"),
            velocity=join("velocity"),
            current=join("current"),
            temperature=join("temperature"),
            voltage=join("voltage"),
            age=join("age"),
            valid=join("valid"),
            missed=join("missed"),
            faults=tuple(faults[i] for i in self._order),
        )


@contextlib.contextmanager
def _kept(errors: list[BusError]) -> Iterator[None]:
    """One dead channel must not keep the others from being told."""
    try:
        yield
    except BusError as error:
        errors.append(error)
