"""Where recordings lie, what belongs to each, which is being written, and which may go when the disk budget is used up."""

import contextlib
import glob
import logging
import os
import re
import shutil
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import msgspec

from app import places

try:
    import fcntl
except ImportError:  # Windows refuses to delete what is open anyway
    fcntl = None  # type: ignore[assignment]

_log = logging.getLogger(__name__)

SUFFIX: Final = ".mcap"
NOTES_SUFFIX: Final = ".notes.json"
LOG_SUFFIXES: Final = (".can.log", ".can.blf")
"""The raw CAN frames beside a recording."""
RESERVE_BYTES: Final = 500_000_000
"""With less than this free on the disk, old sessions go …"""
LAST_BYTES: Final = 100_000_000
"""… and with less than this nothing more is recorded: others need the disk, too."""
NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9._+-]{0,199}\.mcap")


class Notes(msgspec.Struct, frozen=True, kw_only=True):
    """What people said of a session. Beside the recording, which itself is never changed."""

    marked: bool = False
    """Kept: never deleted to make room."""
    note: str = ""


def default_folder() -> Path:
    """`~/.local/share/cobra-teleop/recordings`, or where the environment says. Not made here."""
    return places.data_folder() / "recordings"


def new_path(folder: Path, robot: str, now_s: float) -> Path:
    """A name that is not taken, sorted by time: 2026-11-22_07-26-37_cobra.mcap."""
    stem = f"{time.strftime('%Y-%m-%d_%H-%M-%S', time.localtime(now_s))}_{robot}"
    names = (f"{stem}{'' if n == 1 else f'-{n}'}{SUFFIX}" for n in range(1, 1000))
    return next(path for name in names if not (path := folder / name).exists())


def recordings(folder: Path) -> list[Path]:
    """All recordings of a folder, oldest first. A folder that is not there has none."""
    with contextlib.suppress(OSError):
        return sorted(path for path in folder.iterdir() if path.suffix == SUFFIX and path.is_file())
    return []


def belongings(path: Path) -> list[Path]:
    """What lies beside a recording and goes with it."""
    notes = _notes_path(path)
    return [*([notes] if notes.exists() else []), *frames_of(path)]


def frames_of(path: Path) -> list[Path]:
    """The raw CAN frames beside a recording, oldest first: a long session's are in several files."""
    found = []
    for suffix in LOG_SUFFIXES:
        newest = path.with_name(path.name.removesuffix(SUFFIX) + suffix)
        if newest.exists():
            found += [*sorted(path.parent.glob(f"{glob.escape(newest.stem)}-*{newest.suffix}")), newest]
    return found


def size_of(path: Path) -> int:
    """Bytes of a recording with all that belongs to it."""
    total = 0
    for file in (path, *belongings(path)):
        with contextlib.suppress(OSError):
            total += file.stat().st_size
    return total


def notes_of(path: Path) -> Notes:
    """What people said of it; nothing when there is no such file or it cannot be read."""
    try:
        return msgspec.json.decode(_notes_path(path).read_bytes(), type=Notes)
    except FileNotFoundError:
        return Notes()
    except (OSError, msgspec.MsgspecError) as error:
        # Whoever cannot read the notes must not take the session for unmarked.
        _log.warning("%s: the notes cannot be read (%s): the session counts as marked", path.name, error)
        return Notes(marked=True)


def write_notes(path: Path, notes: Notes) -> None:
    """Replace what people said of it, in one step.

    Raises:
        OSError: it cannot be written.
    """
    target = _notes_path(path)
    fresh = target.with_suffix(f".{os.getpid()}")
    fresh.write_bytes(msgspec.json.format(msgspec.json.encode(notes)) + b"\n")
    fresh.replace(target)


def lock(descriptor: int) -> None:
    """Say that this process writes the open file; the system takes it back when the process ends, however it ends."""
    if fcntl is not None:
        with contextlib.suppress(OSError):  # a file system without locks
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def being_written(path: Path) -> bool:
    """Whether a recorder writes it at this moment."""
    if fcntl is None:
        return False
    try:
        descriptor = os.open(path, os.O_RDONLY)
    except OSError:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    finally:
        os.close(descriptor)
    return False


def delete(path: Path) -> None:
    """Delete a recording with all that belongs to it; the recording first, so that nothing is left half.

    Raises:
        OSError: it cannot be deleted.
    """
    beside = belongings(path)
    path.unlink()
    for file in beside:
        file.unlink(missing_ok=True)


def make_room(folder: Path, budget_bytes: int) -> list[Path]:
    """Delete the oldest unmarked sessions until the folder keeps its budget and the disk its reserve.

    Never one that is marked, never one that is being written. Returns what was deleted; when that is not enough the
    folder simply stays over its budget, and `shortage` says so.
    """
    gone = []
    for path in _expendable(folder):
        if not shortage(folder, budget_bytes):
            break
        try:
            delete(path)
        except OSError as error:
            _log.warning("%s cannot be deleted to make room: %s", path, error.strerror)
        else:
            gone.append(path)
    return gone


def shortage(folder: Path, budget_bytes: int) -> str:
    """Why there is no room, in words; empty when there is."""
    used = sum(map(size_of, recordings(folder)))
    if used > budget_bytes:
        return f"the recordings take {_gigabytes(used)} of the {_gigabytes(budget_bytes)} they may"
    free = free_bytes(folder)
    return f"the disk has only {_gigabytes(free)} left" if free < RESERVE_BYTES else ""


def free_bytes(folder: Path) -> int:
    """What the disk has left; plenty when it cannot be told."""
    with contextlib.suppress(OSError):
        return shutil.disk_usage(folder).free
    return sys.maxsize


def _expendable(folder: Path) -> Iterator[Path]:
    return (path for path in recordings(folder) if not notes_of(path).marked and not being_written(path))


def _notes_path(path: Path) -> Path:
    return path.with_name(path.name.removesuffix(SUFFIX) + NOTES_SUFFIX)


def _gigabytes(count: int) -> str:
    return f"{count / 1e9:.1f} GB"
