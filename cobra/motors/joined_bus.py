"""Several channels, of one or more protocols, as one `MotorBus`."""

import contextlib
import dataclasses
from collections import Counter
from collections.abc import Callable, Iterator
from types import TracebackType
from typing import Any, Protocol, Self

import numpy as np

from cobra.motors.bus import BusError, ChannelHealth, Feedback, Floats
from cobra.motors.cell_readings import LoadCells
from cobra.motors.channel import Record
from cobra.motors.raw_log import RawLog


class MotorChannel(Protocol):
    """The motors of one channel. Everything that talks to the channel raises BusError when it is gone."""

    counts: dict[str, int]
    indices: tuple[int, ...]

    @property
    def notes(self) -> tuple[str, ...]: ...
    @property
    def waited_s(self) -> float: ...
    @property
    def health(self) -> ChannelHealth: ...
    def record_to(self, record: Record | None) -> None: ...
    def listen_for(self, cells: LoadCells) -> None: ...
    def enable(self) -> tuple[str, ...]: ...
    def refuse_setpoints(self) -> None: ...
    def disable(self) -> None: ...
    def hold(self) -> None: ...
    def burst(self, angles: Floats | None) -> None: ...
    def gather(self) -> None: ...
    def told(self) -> Feedback: ...
    def __enter__(self) -> Self: ...
    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


class JoinedBus:
    """Several channels as one `MotorBus`: all bursts go out before the first reply is awaited."""

    def __init__(self, channels: list[MotorChannel], log: RawLog | None, cells: LoadCells) -> None:
        self._channels = channels
        self._log = log
        self._cells = cells
        for channel in channels:
            channel.listen_for(cells)
        self._scopes = [np.array(channel.indices, dtype=np.intp) for channel in channels]
        # Reading entry i of all channels one after the other gives the description's order.
        self._order = np.argsort(np.concatenate(self._scopes))
        self._stack = contextlib.ExitStack()
        self._errors: list[BusError] = []
        self._gathered: list[BusError] = []

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
        """What people should know about these drives, and of the log of their frames."""
        gap = (
            ("frames are missing in the CAN log: the disk is slow or full",) if self._log and self._log.dropped else ()
        )
        return (*(note for channel in self._channels for note in channel.notes), *gap)

    @property
    def waited_s(self) -> float:
        return sum(channel.waited_s for channel in self._channels)

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
        self._tell_each(lambda channel: channel.disable())

    def hold(self) -> None:
        """Raises BusError, after every channel was told."""
        self._tell_each(lambda channel: channel.hold())

    def exchange(self, angles: Floats | None) -> Feedback:
        """One exchange with all drives. Raises BusError if a channel is gone, after the others were served."""
        self.burst(angles)
        return self.collect()

    def burst(self, angles: Floats | None) -> None:
        """The sending half of an exchange; what is gone is raised by `told`, once its replies were gathered."""
        self._errors = []
        for channel, scope in zip(self._channels, self._scopes, strict=True):
            with _kept(self._errors):
                channel.burst(None if angles is None else angles[scope])

    def collect(self) -> Feedback:
        """The receiving half. Raises BusError if a channel is gone, after the others were served."""
        self.gather()
        return self.told()

    def gather(self) -> None:
        """Take all replies, without looking at them; what is gone is raised by `told`."""
        for channel in self._channels:
            with _kept(self._errors):
                channel.gather()
        self._gathered, self._errors = self._errors, []

    def told(self) -> Feedback:
        """What was gathered last. Raises BusError if a channel was gone."""
        errors = list(self._gathered)
        parts = []
        for channel in self._channels:
            with _kept(errors):
                parts.append(channel.told())
        if errors:
            raise errors[0]
        told = parts[0] if len(parts) == 1 else self._joined(parts)
        return dataclasses.replace(told, cells=self._cells.readings()) if len(self._cells) else told

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _tell_each(self, tell: Callable[[MotorChannel], None]) -> None:
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
