"""Claims about the folder: room is made by deleting the oldest sessions, and never one that is marked or being written."""

import os
import time

import pytest

from app.recording import storage
from app.recording.storage import Notes


@pytest.fixture
def folder(tmp_path):
    """Five recordings of 1000 bytes, oldest first."""
    for day in range(1, 6):
        (tmp_path / f"2026-01-0{day}_08-00-00_cobra.mcap").write_bytes(bytes(1000))
    return tmp_path


def names(folder) -> list[str]:
    return [path.name[9:10] for path in storage.recordings(folder)]


def test_the_oldest_go_until_the_budget_holds(folder):
    gone = storage.make_room(folder, 3000)
    assert names(folder) == ["3", "4", "5"]
    assert [path.name[9:10] for path in gone] == ["1", "2"]
    assert storage.make_room(folder, 3000) == []


def test_marked_sessions_stay_and_the_shortage_is_told(folder):
    for path in storage.recordings(folder)[:4]:
        storage.write_notes(path, Notes(marked=True))
    storage.make_room(folder, 2000)
    assert names(folder) == ["1", "2", "3", "4"]
    assert "of the 0.0 GB they may" in storage.shortage(folder, 2000)


def test_one_that_is_being_written_stays(folder):
    oldest = storage.recordings(folder)[0]
    descriptor = os.open(oldest, os.O_WRONLY)
    storage.lock(descriptor)
    storage.make_room(folder, 1000)
    os.close(descriptor)
    assert "1" in names(folder)
    storage.make_room(folder, 0)
    assert names(folder) == []


def test_notes_that_cannot_be_read_count_as_a_mark(folder):
    oldest = storage.recordings(folder)[0]
    storage.write_notes(oldest, Notes())
    next(folder.glob("*.notes.json")).write_text("{marked: tr")
    storage.make_room(folder, 0)
    assert names(folder) == ["1"]


def test_a_session_goes_with_all_that_belongs_to_it(folder):
    path = storage.recordings(folder)[0]
    storage.write_notes(path, Notes(note="bore 3"))
    for name in ("can.log", "can-20260101-080500-0001.log"):
        (folder / f"2026-01-01_08-00-00_cobra.{name}").write_bytes(bytes(500))
    assert storage.size_of(path) > 2000
    storage.delete(path)
    assert not list(folder.glob("2026-01-01*"))


def test_a_nearly_full_disk_makes_old_sessions_go_whatever_the_budget(folder, monkeypatch):
    monkeypatch.setattr(storage, "free_bytes", lambda _: 400_000_000 + 1000 * (5 - len(storage.recordings(folder))))
    storage.make_room(folder, 10**12)
    assert names(folder) == []
    assert "the disk has only" in storage.shortage(folder, 10**12)


def test_names_are_sorted_by_time_and_never_taken_twice(tmp_path):
    now = time.time()
    first = storage.new_path(tmp_path, "cobra", now)
    first.touch()
    second = storage.new_path(tmp_path, "cobra", now)
    assert first != second
    assert storage.NAME.fullmatch(first.name)
    assert storage.NAME.fullmatch(second.name)
    assert not storage.NAME.fullmatch("../" + first.name)


def test_the_users_folder_follows_xdg(monkeypatch, tmp_path):
    monkeypatch.delenv("COBRA_TELEOP_DATA_DIR", raising=False)
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert storage.default_folder() == tmp_path / "cobra-teleop" / "recordings"
    monkeypatch.delenv("XDG_DATA_HOME")
    monkeypatch.setenv("HOME", "/home/ada")
    assert str(storage.default_folder()) == "/home/ada/.local/share/cobra-teleop/recordings"
