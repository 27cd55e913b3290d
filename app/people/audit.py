"""The audit trail: who signed in, took the controls, armed, drove, stopped and cleared. One JSON object a line, one file a month.

Lines are only ever appended, in one write each, so that robot process and console may share the file. Its owner alone
can read it. No secrets get in: leases and tokens are not among a deed's fields.
"""

import logging
import os
import queue
import threading
from collections import deque
from datetime import UTC, datetime
from pathlib import Path

import msgspec

from app.places import state_folder

KEPT = 200
"""Deeds that pages can ask for."""
MAX_WAITING = 1000
MAX_TEXT = 300

log = logging.getLogger("cobra.audit")


class Deed(msgspec.Struct, frozen=True, kw_only=True):
    """Somebody did something."""

    time: str
    """UTC, ISO 8601 with milliseconds."""
    who: str
    what: str
    detail: str = ""


class AuditTrail:
    """Writes deeds in a thread of its own: whoever reports one never waits for a disk."""

    def __init__(self, robot: str, folder: Path | None = None) -> None:
        self._robot = robot
        self._folder = folder or state_folder()
        self._queue: queue.Queue[Deed | None] = queue.Queue(MAX_WAITING)
        self._thread: threading.Thread | None = None
        self._newest: deque[Deed] = deque(maxlen=KEPT)
        self.lost = 0
        """Deeds that could not be written down."""

    def start(self) -> None:
        self._newest.extend(read(self._file()))
        self._thread = threading.Thread(target=self._run, name="audit", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Write what is left."""
        if self._thread is not None:
            self._queue.put(None)
            self._thread.join(2.0)
            self._thread = None

    def note(self, who: str, what: str, detail: str = "") -> None:
        """Write a deed down. Never blocks, never raises; safe from any thread."""
        time = datetime.now(UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
        deed = Deed(time=time, who=who[:MAX_TEXT] or "somebody", what=what[:MAX_TEXT], detail=detail[:MAX_TEXT])
        self._newest.append(deed)
        try:
            self._queue.put_nowait(deed)
        except queue.Full:
            self.lost += 1

    def tail(self) -> list[Deed]:
        """The newest deeds, oldest first."""
        return list(self._newest)

    def _file(self) -> Path:
        return self._folder / f"audit-{self._robot}-{datetime.now(UTC):%Y-%m}.jsonl"

    def _run(self) -> None:
        while (deed := self._queue.get()) is not None:
            try:
                handle = os.open(self._file(), os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o600)
                try:
                    os.write(handle, msgspec.json.encode(deed) + b"\n")
                finally:
                    os.close(handle)
            except OSError as error:
                if not self.lost:
                    log.error("the audit trail cannot be written: %s", error)
                self.lost += 1


def read(path: Path) -> list[Deed]:
    """The newest deeds of a file; lines that cannot be read are passed over."""
    try:
        lines = path.read_bytes().splitlines()[-KEPT:]
    except OSError:
        return []
    deeds = []
    for line in lines:
        try:
            deeds.append(msgspec.json.decode(line, type=Deed))
        except msgspec.MsgspecError:
            continue
    return deeds
