"""Logs: one folder for all processes, one JSON object a line, rotating; what matters goes to the terminal too."""

import atexit
import json
import logging
import logging.handlers
import os
import queue
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from app import places
from cobra.errors import OperatorError

MAX_BYTES, KEPT = 5_000_000, 3
LEVELS = ("debug", "info", "warning", "error")
DIM, PLAIN = "\x1b[2m", "\x1b[0m"
_writers: list[logging.handlers.QueueListener] = []
PLAIN_FIELDS = frozenset(logging.makeLogRecord({}).__dict__) | {"message", "asctime", "taskName"}
"""Fields of every record; what else a record has is its writer's own and is kept."""


def folder() -> Path:
    """Where the logs lie."""
    path = places.state_folder() / "log"
    path.mkdir(mode=0o700, exist_ok=True)
    return path


def start(process: str, level: str | None = None) -> None:
    """Log to a file of this process ("console-cobra") from now on.

    Args:
        level: of the file; by default that of COBRA_TELEOP_LOG_LEVEL, or info.

    Raises:
        OperatorError: there is no such level.
    """
    wanted = (level or os.environ.get("COBRA_TELEOP_LOG_LEVEL") or "info").lower()
    if wanted not in LEVELS:
        raise OperatorError(f"log level {wanted!r}: must be one of {', '.join(LEVELS)}")
    root = logging.getLogger()
    try:
        file = logging.handlers.RotatingFileHandler(
            folder() / f"{process}.jsonl", maxBytes=MAX_BYTES, backupCount=KEPT, encoding="utf-8"
        )
    except OSError as error:
        logging.getLogger("cobra.log").warning("no log file: %s", error)
        return
    file.setFormatter(JsonLines(process))
    file.setLevel(wanted.upper())
    for handler in root.handlers:
        handler.setLevel(logging.WARNING)
    # Whoever logs must not wait for a disk, least of all the control loop.
    lines: queue.SimpleQueue[logging.LogRecord] = queue.SimpleQueue()
    root.addHandler(logging.handlers.QueueHandler(lines))
    writer = logging.handlers.QueueListener(lines, file, respect_handler_level=True)
    writer.start()
    _writers.append(writer)
    atexit.register(stop)
    # Libraries keep to warnings; our own parts say more.
    logging.getLogger("cobra").setLevel(wanted.upper())


def stop() -> None:
    """Write what is still waiting. At the end of the process this happens by itself."""
    while _writers:
        _writers.pop().stop()


class JsonLines(logging.Formatter):
    """A record as one line of JSON: time [s, UNIX], level, process, part, text, and what its writer added."""

    def __init__(self, process: str) -> None:
        super().__init__()
        self._process = process

    def format(self, record: logging.LogRecord) -> str:
        line: dict[str, Any] = {
            "time": round(record.created, 3),
            "level": record.levelname.lower(),
            "process": self._process,
            "part": record.name,
            "text": record.getMessage(),
        }
        line |= {key: value for key, value in record.__dict__.items() if key not in PLAIN_FIELDS}
        if record.exc_info:
            line["trace"] = self.formatException(record.exc_info)
        return json.dumps(line, default=str, ensure_ascii=False)


def read(level: str = "info", since_s: float = 0.0) -> Iterator[dict[str, Any]]:
    """All processes' lines of at least this level and not older than `since_s` [s, UNIX], in the order of time."""
    wanted = (*LEVELS[LEVELS.index(level) :], "critical")
    lines = []
    for path in sorted(folder().glob("*.jsonl*")):
        for text in path.read_text("utf-8", errors="replace").splitlines():
            try:
                line = json.loads(text)
            except ValueError:
                continue  # the last line of a process that was killed
            if isinstance(line, dict) and line.get("level") in wanted and line.get("time", 0.0) >= since_s:
                lines.append(line)
    yield from sorted(lines, key=lambda line: line["time"])


def shown(line: dict[str, Any]) -> str:
    """A line for people."""
    at = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(line["time"]))
    text = f"{at} {line['level']:<7} {line['process']}: {line['text']}"
    trace = line.get("trace", "")
    return f"{text}\n{trace}" if trace else text


def show(level: str, hours: float) -> int:
    """Print the logs of the last hours, coloured on a terminal. Returns the exit status."""
    colours = {"warning": "\x1b[33m", "error": "\x1b[31m", "critical": "\x1b[31m", "debug": DIM}
    terminal = sys.stdout.isatty()
    for line in read(level, time.time() - 3600.0 * hours):
        colour = colours.get(line["level"], "") if terminal else ""
        print(f"{colour}{shown(line)}{PLAIN if colour else ''}")
    if terminal:
        print(f"{DIM}Files: {folder()}{PLAIN}")
    return 0
