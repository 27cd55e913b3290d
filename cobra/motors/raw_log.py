"""Every frame of the motor buses into a file, written by a side thread: the control loop only appends to a bounded queue.

A file that has grown to `MAX_BYTES`, or was there before, is put aside with the time in its name, and a new one begun; the newest `KEPT` stay.

candump's text format (`.log`, for can-utils and grep) or Vector's binary one (`.blf`), whichever the file's name says.
"""

import glob
import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Final, NamedTuple, Self

import can

from cobra.motors.bus import BusError

FORMATS: Final = {".log": can.CanutilsLogWriter, ".blf": can.BLFWriter}
CAPACITY: Final = 100_000
"""Frames that may wait for the disk: over 30 s of a full bus of 14 drives at 100 Hz."""
WRITE_PERIOD_S: Final = 0.05
MAX_BYTES: Final = 200_000_000
"""About half an hour of 14 drives at 100 Hz in candump's format."""
KEPT: Final = 10
"""Files put aside; older ones are deleted."""

_log = logging.getLogger(__name__)


class _Frame(NamedTuple):
    time_s: float
    channel: int
    arbitration_id: int
    data: bytes
    received: bool
    extended: bool
    remote: bool
    error: bool


class RawLog:
    """`with RawLog(path) as log`; `log.recorder(channel)` is what a bus calls with each frame."""

    def __init__(self, path: Path, capacity: int = CAPACITY, max_bytes: int = MAX_BYTES, kept: int = KEPT) -> None:
        self.path = path
        self._max_bytes = max_bytes
        self._kept = kept
        self._aside = 0
        self.written = 0
        self.dropped = 0
        """Frames that were not written: the queue was full, or the disk failed."""
        self._capacity = capacity
        self._waiting: deque[_Frame] = deque()
        self._stopped = threading.Event()
        self._thread: threading.Thread | None = None
        self._names: list[str] = []

    def start(self) -> None:
        """Raises BusError if the file cannot be written or its name says no known format."""
        kind = FORMATS.get(self.path.suffix)
        if kind is None:
            raise BusError(f"{self.path}: a CAN log must be named {' or '.join('*' + suffix for suffix in FORMATS)}")
        try:
            if self.path.is_file() and self.path.stat().st_size:
                self._put_aside()  # of a robot process before this one
            writer = kind(self.path)
        except OSError as error:
            raise BusError(f"{self.path}: the CAN log cannot be written: {error.strerror}") from None
        self._stopped.clear()
        self._thread = threading.Thread(target=self._run, args=(writer,), name="can-log", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Write what still waits, and close the file."""
        self._stopped.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def recorder(self, name: str) -> Callable[[can.Message, bool], None]:
        """What to call with each frame of the channel `name` and whether it was received."""
        self._names.append(name)
        channel, waiting, now = len(self._names) - 1, self._waiting, time.time

        def record(message: can.Message, received: bool) -> None:
            if len(waiting) >= self._capacity:
                self.dropped += 1
                return
            frame = _Frame(
                now(),
                channel,
                message.arbitration_id,
                bytes(message.data),
                received,
                message.is_extended_id,
                message.is_remote_frame,
                message.is_error_frame,
            )
            waiting.append(frame)

        return record

    def _run(self, writer: can.CanutilsLogWriter | can.BLFWriter) -> None:
        try:
            last = False
            while not last:
                # What is appended before the flag is seen is still written.
                last = self._stopped.wait(WRITE_PERIOD_S)
                self._write_waiting(writer)
                if writer.file_size() > self._max_bytes and not last:
                    writer.stop()
                    self._put_aside()
                    writer = FORMATS[self.path.suffix](self.path)
            writer.stop()
        except OSError as error:
            _log.error("%s: the CAN log ends here: %s", self.path, error)
            self._capacity = 0
            self.dropped += len(self._waiting)
            self._waiting.clear()

    def _write_waiting(self, writer: can.CanutilsLogWriter | can.BLFWriter) -> None:
        text = isinstance(writer, can.CanutilsLogWriter)
        while self._waiting:
            frame = self._waiting.popleft()
            writer.on_message_received(_message(frame, self._names[frame.channel] if text else frame.channel))
            self.written += 1
        writer.file.flush()

    def _put_aside(self) -> None:
        stem, suffix = self.path.stem, self.path.suffix
        self._aside += 1
        aside = self.path.with_name(f"{stem}-{time.strftime('%Y%m%d-%H%M%S')}-{self._aside:04d}{suffix}")
        self.path.rename(aside)
        for old in sorted(self.path.parent.glob(f"{glob.escape(stem)}-*-*-????{suffix}"))[: -self._kept]:
            old.unlink()


def _message(frame: _Frame, channel: str | int) -> can.Message:
    return can.Message(
        timestamp=frame.time_s,
        arbitration_id=frame.arbitration_id,
        is_extended_id=frame.extended,
        is_remote_frame=frame.remote,
        is_error_frame=frame.error,
        is_rx=frame.received,
        channel=channel,
        data=frame.data,
    )
