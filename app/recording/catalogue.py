"""The sessions of a folder: list, search, mark, annotate, delete. What people say lies beside a recording, not in it."""

from collections.abc import Sequence
from datetime import UTC, date, datetime, timedelta
from functools import lru_cache
from pathlib import Path
from typing import Final, Literal

import msgspec

from app.recording import storage
from app.recording.digest import Digest
from app.recording.glance import glance
from app.recording.storage import Notes
from cobra.errors import OperatorError

NOTE_LENGTH: Final = 2000
"""Characters of a note."""
Status = Literal["recording", "closed", "not closed", "unreadable"]


class CatalogueError(OperatorError):
    """A session that is not there, or cannot be changed. The message says why."""


class Session(msgspec.Struct, frozen=True, kw_only=True):
    """One line of the catalogue."""

    name: str
    status: Status
    robot: str = ""
    title: str = ""
    started: str = ""
    """Local time, ISO 8601."""
    duration_s: float | None = None
    drivers: tuple[str, ...] = ()
    alarms: tuple[str, ...] = ()
    markers: int = 0
    faults: int = 0
    megabytes: float = 0.0
    frames: tuple[str, ...] = ()
    """Files of raw CAN frames beside it."""
    marked: bool = False
    note: str = ""


class Search(msgspec.Struct, frozen=True, kw_only=True):
    """What is looked for; everything that is given must fit. Words are found anywhere, whatever their case."""

    text: str = ""
    """In name, robot, drivers, alarms or note."""
    since: date | None = None
    until: date | None = None
    robot: str = ""
    driver: str = ""
    alarm: str = ""
    """In an alarm's words."""
    alarms_only: bool = False
    marked_only: bool = False


def sessions(folder: Path, search: Search | None = None) -> list[Session]:
    """All sessions that fit, newest first."""
    wanted = search or Search()
    found = (session_of(path) for path in reversed(storage.recordings(folder)))
    return [session for session in found if _fits(session, wanted)]


def session_of(path: Path) -> Session:
    """One session; never raises for what is in the file."""
    notes = storage.notes_of(path)
    try:
        stat = path.stat()
        facts, digest = _glance(path, stat.st_size, stat.st_mtime_ns)
    except OSError:
        return Session(name=path.name, status="unreadable", marked=notes.marked, note=notes.note)
    if storage.being_written(path):
        status: Status = "recording"
    elif digest is not None:
        status = "closed"
    else:
        status = "not closed" if facts else "unreadable"
    digest = digest or Digest()
    started_ns = digest.started_ns or int(facts.get("started_ns", "0") or 0)
    return Session(
        name=path.name,
        status=status,
        robot=digest.robot or facts.get("robot", ""),
        title=digest.title or facts.get("title", ""),
        started=_local(started_ns).isoformat(timespec="seconds") if started_ns else "",
        duration_s=digest.duration_s if status == "closed" else None,
        drivers=tuple(dict.fromkeys(span.what for span in digest.drivers)),
        alarms=tuple(event.text for event in digest.events if event.level == "alarm"),
        markers=digest.counts.get("marker", 0),
        faults=len(digest.faults),
        megabytes=storage.size_of(path) / 1e6,
        frames=tuple(file.name for file in storage.frames_of(path)),
        marked=notes.marked,
        note=notes.note,
    )


def find(folder: Path, name: str) -> Path:
    """The recording of that name, also without its ending.

    Raises:
        CatalogueError: there is none, or the name leads out of the folder.
    """
    wanted = name if name.endswith(storage.SUFFIX) else name + storage.SUFFIX
    if not storage.NAME.fullmatch(wanted) or not (path := folder / wanted).is_file():
        raise CatalogueError(f"there is no session {name!r} in {folder}; cobra-teleop sessions lists them")
    return path


def find_frames(folder: Path, name: str, file: str) -> Path:
    """A file of raw CAN frames of the recording of that name.

    Raises:
        CatalogueError: there is no such recording, or no such file beside it.
    """
    for path in storage.frames_of(find(folder, name)):
        if path.name == file:
            return path
    raise CatalogueError(f"{name} has no CAN frames {file!r}")


def given(name: Path, folder: Path | None = None) -> Path:
    """A recording as people name it on the command line: a file, or a session of the folder.

    Raises:
        CatalogueError: there is neither.
    """
    if name.exists():
        return name
    place = folder or storage.default_folder()
    if len(name.parts) == 1 and (place / name).exists():
        return place / name
    if len(name.parts) == 1:
        return find(place, name.name)
    raise CatalogueError(f"{name}: there is no such file")


def mark(path: Path, marked: bool) -> Notes:
    """Keep a session for good, or let it go when room is needed."""
    return _change(path, msgspec.structs.replace(storage.notes_of(path), marked=marked))


def annotate(path: Path, note: str) -> Notes:
    """Replace the note of a session.

    Raises:
        CatalogueError: it is too long, or cannot be written.
    """
    if len(note) > NOTE_LENGTH:
        raise CatalogueError(f"a note of {len(note)} characters; there is room for {NOTE_LENGTH}")
    return _change(path, msgspec.structs.replace(storage.notes_of(path), note=note.strip()))


def delete(path: Path) -> None:
    """Delete a session with all that belongs to it.

    Raises:
        CatalogueError: it is marked, or being recorded at this moment, or cannot be deleted.
    """
    if storage.being_written(path):
        raise CatalogueError(f"{path.name} is being recorded now")
    if storage.notes_of(path).marked:
        raise CatalogueError(f"{path.name} is marked to be kept: take its mark away first")
    try:
        storage.delete(path)
    except OSError as error:
        raise CatalogueError(f"{path.name} cannot be deleted: {error.strerror}") from None


def table(found: Sequence[Session]) -> list[tuple[str, ...]]:
    """The catalogue in words, for a terminal: when, how long, robot, who, alarms, size, note."""
    return [
        (
            f"{'★ ' if session.marked else ''}{session.name.removesuffix(storage.SUFFIX)}",
            _clock(session.duration_s) if session.duration_s is not None else session.status,
            session.title or session.robot,
            ", ".join(session.drivers),
            str(len(session.alarms)) if session.alarms else "",
            f"{session.megabytes:.1f} MB",
            session.note,
        )
        for session in found
    ]


def _change(path: Path, notes: Notes) -> Notes:
    try:
        storage.write_notes(path, notes)
    except OSError as error:
        raise CatalogueError(f"{path.name}: the note cannot be written: {error.strerror}") from None
    return notes


def _fits(session: Session, search: Search) -> bool:
    started = datetime.fromisoformat(session.started).date() if session.started else None
    words = " ".join((session.name, session.robot, session.title, session.note, *session.drivers, *session.alarms))
    return (
        search.text.lower() in words.lower()
        and (search.since is None or (started is not None and started >= search.since))
        and (search.until is None or (started is not None and started <= search.until))
        and search.robot.lower() in f"{session.robot} {session.title}".lower()
        and search.driver.lower() in " ".join(session.drivers).lower()
        and (not search.alarm or any(search.alarm.lower() in alarm.lower() for alarm in session.alarms))
        and (bool(session.alarms) or not search.alarms_only)
        and (session.marked or not search.marked_only)
    )


@lru_cache(maxsize=1000)
def _glance(path: Path, size: int, changed_ns: int) -> tuple[dict[str, str], Digest | None]:
    """A file that has not changed is looked at once."""
    return glance(path)


def _local(ns: int) -> datetime:
    return datetime.fromtimestamp(ns / 1e9, UTC).astimezone()


def _clock(seconds: float) -> str:
    return str(timedelta(seconds=round(seconds)))
