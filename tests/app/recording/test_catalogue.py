"""Claims about the catalogue: it finds what people ask for, on the command line and over HTTP, and roles decide in the server."""

import json
import os
from collections.abc import Callable, Iterator
from datetime import date
from pathlib import Path
from typing import Any, NamedTuple

import httpx
import pytest

from app.cli import main
from app.console.front_door import FrontDoor
from app.console.recordings_page import recordings_routes
from app.people.sessions import Sessions
from app.people.users import Users
from app.recording import storage
from app.recording.catalogue import Search, sessions
from app.recording.reader import Recording
from cobra.messages import Event
from tests.page_fakes import FakeSession, cookie_of
from tests.recordings import START_S, write

OLD, NEW = "2026-01-01_08-00-00_cobra", "2026-01-02_08-00-00_cobra"
STOPPED = Event(stamp=START_S + 0.1, level="alarm", text="STOP by vic")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two sessions: the older one quiet, in the newer one somebody pressed STOP, and its frames lie beside it."""
    folder = tmp_path / "recordings"
    folder.mkdir()
    write(folder / f"{OLD}.mcap", 0.2)
    write(folder / f"{NEW}.mcap", 0.2, events=[STOPPED])
    (folder / f"{NEW}.can.log").write_text("(1.0) main 141#9A\n")
    (tmp_path / "secret.mcap").write_bytes(b"outside")
    return folder


@pytest.fixture
def visit(folder: Path, tmp_path: Path, no_viewer_port: int) -> Iterator[Callable[[str], httpx.Client]]:
    """A browser that is signed in with a role."""
    users = Users(tmp_path / "users.json")
    tokens = {role: users.add(role, role) for role in ("viewer", "driver", "admin")}
    more = recordings_routes(folder)
    with FrontDoor("127.0.0.1", 0, no_viewer_port, FakeSession(), more, sessions=Sessions(users, "me")) as door:

        def client(role: str) -> httpx.Client:
            name, _, value = cookie_of(door.port, (role, tokens[role])).partition("=")
            return httpx.Client(base_url=f"{door.url}sessions/", cookies={name: value})

        yield client


@pytest.fixture
def no_viewer_port() -> int:
    return 1


def names(answer: httpx.Response) -> list[str]:
    return [session["name"].removesuffix(".mcap") for session in answer.json()["sessions"]]


# ---------------------------------------------------------------- search


@pytest.mark.parametrize(
    ("search", "found"),
    [
        ({}, [NEW, OLD]),
        ({"driver": "ADA"}, [NEW, OLD]),
        ({"driver": "vic"}, []),
        ({"robot": "cobra"}, [NEW, OLD]),
        ({"robot": "src-bot"}, []),
        ({"alarms_only": True}, [NEW]),
        ({"alarm": "stop by"}, [NEW]),
        ({"alarm": "no answer"}, []),
        ({"text": "vic"}, [NEW]),
        ({"text": "blade"}, [OLD]),
        ({"marked_only": True}, [OLD]),
        ({"since": date(2026, 9, 22)}, []),
        ({"until": date(2026, 9, 21)}, [NEW, OLD]),
        ({"since": date(2026, 9, 21), "text": "blade"}, [OLD]),
    ],
)
def test_sessions_are_found_by_date_robot_driver_alarm_and_words(
    session_folder: Path, search: dict[str, Any], found: list[str]
) -> None:
    listed = [session.name.removesuffix(".mcap") for session in sessions(session_folder, Search(**search))]
    assert listed == found


@pytest.fixture(scope="module")
def session_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Both were recorded on 21 September 2026; the older is marked and has a note."""
    folder = tmp_path_factory.mktemp("sessions")
    write(folder / f"{OLD}.mcap", 0.2)
    write(folder / f"{NEW}.mcap", 0.2, events=[STOPPED])
    storage.write_notes(folder / f"{OLD}.mcap", storage.Notes(marked=True, note="stuck at blade 7"))
    return folder


def test_of_a_session_it_tells_when_how_long_who_and_what(session_folder: Path) -> None:
    (session,) = sessions(session_folder, Search(text="vic"))
    assert (session.status, session.robot, session.drivers, session.alarms) == (
        "closed",
        "cobra",
        ("ada",),
        ("STOP by vic",),
    )
    assert session.duration_s == pytest.approx(0.18, abs=1e-6)


# ---------------------------------------------------------------- over HTTP


def test_a_viewer_looks_and_downloads_and_changes_nothing(visit: Any, folder: Path) -> None:
    with visit("viewer") as viewer:
        answer = viewer.get("list", params={"alarms_only": "1"})
        assert names(answer) == [NEW]
        assert answer.json()["may"] == {"list": True, "download": True, "change": False, "delete": False}
        assert viewer.get(f"file/{NEW}.mcap").content == (folder / f"{NEW}.mcap").read_bytes()
        assert viewer.get(f"frames/{NEW}.mcap/{NEW}.can.log").text == "(1.0) main 141#9A\n"
        for refused in (
            viewer.post(f"change/{OLD}.mcap", json={"marked": True}),
            viewer.post(f"change/{OLD}.mcap", json={"note": "mine"}),
            viewer.post(f"delete/{OLD}.mcap"),
        ):
            assert refused.status_code == 403
            assert "takes the role" in refused.json()["reasons"][0]
    assert storage.notes_of(folder / f"{OLD}.mcap") == storage.Notes()
    assert (folder / f"{OLD}.mcap").exists()


def test_a_driver_marks_and_annotates_and_only_an_admin_deletes(visit: Any, folder: Path) -> None:
    with visit("driver") as driver:
        changed = driver.post(f"change/{OLD}.mcap", json={"marked": True, "note": " stuck at blade 7 "}).json()
        assert (changed["marked"], changed["note"]) == (True, "stuck at blade 7")
        assert names(driver.get("list", params={"marked_only": "1"})) == [OLD]
        assert driver.post(f"delete/{NEW}.mcap").status_code == 403
    with visit("admin") as admin:
        assert "take its mark away" in admin.post(f"delete/{OLD}.mcap").json()["reasons"][0]
        assert admin.post(f"delete/{NEW}.mcap").json() == {"ok": True}
    assert [path.name for path in sorted(folder.iterdir())] == [f"{OLD}.mcap", f"{OLD}.notes.json"]


def test_without_a_session_nothing_is_told(visit: Any) -> None:
    with visit("viewer") as viewer:
        viewer.cookies.clear()
        for path in ("list", f"file/{NEW}.mcap", f"frames/{NEW}.mcap/{NEW}.can.log"):
            assert viewer.get(path).status_code == 401
        page = viewer.get(str(viewer.base_url).rstrip("/"))
        assert (page.status_code, page.headers["location"]) == (303, "/sign-in")


OUTSIDE = ("../secret.mcap", "..%2Fsecret.mcap", "%2e%2e%2fsecret", "..%5Csecret.mcap", "%2Fetc%2Fpasswd", "none", "")


def test_no_name_leads_out_of_the_folder(visit: Any, folder: Path) -> None:
    with visit("admin") as admin:
        for answer in (
            answer
            for name in OUTSIDE
            for answer in (
                admin.get(f"file/{name}"),
                admin.get(f"frames/{NEW}.mcap/{name}"),
                admin.get(f"frames/{name}/{NEW}.can.log"),
                admin.post(f"delete/{name}"),
                admin.post(f"change/{name}", json={"marked": True}),
            )
        ):
            assert answer.status_code in (404, 405, 409), answer.url
            assert b"outside" not in answer.content
    assert (folder.parent / "secret.mcap").exists()


NONSENSE = {b"{": 400, b'{"marked": 3}': 400, b'{"owner": "me"}': 400, b'{"note": "%s"}' % (b"x" * 200_000): 413}


def test_nonsense_is_refused_in_words(visit: Any, folder: Path) -> None:
    with visit("admin") as admin:
        for body, status in NONSENSE.items():
            answer = admin.post(f"change/{OLD}.mcap", content=body)
            assert (answer.status_code, answer.json()["ok"]) == (status, False)
        assert admin.get("list", params={"since": "yesterday"}).status_code == 400
    assert storage.notes_of(folder / f"{OLD}.mcap") == storage.Notes()


def test_a_session_that_is_being_written_stays_and_its_download_is_readable(visit: Any, folder: Path) -> None:
    path = folder / f"{NEW}.mcap"
    unclosed = path.read_bytes()[:-8]
    path.write_bytes(unclosed)
    descriptor = os.open(path, os.O_WRONLY | os.O_APPEND)
    storage.lock(descriptor)
    with visit("admin") as admin:
        assert admin.get("list").json()["sessions"][0]["status"] == "recording"
        assert "being recorded now" in admin.post(f"delete/{NEW}.mcap").json()["reasons"][0]
        with admin.stream("GET", f"file/{NEW}.mcap") as answer:
            os.write(descriptor, bytes(5_000_000))  # it grows meanwhile
            (folder.parent / "copy.mcap").write_bytes(answer.read())
    os.close(descriptor)
    with Recording(folder.parent / "copy.mcap") as copy:
        assert not copy.closed
        assert len(list(copy.states())) == 10


# ---------------------------------------------------------------- on the command line


class Told(NamedTuple):
    status: int
    out: str
    error: str


@pytest.fixture
def run(folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Callable[..., Told]:
    """`cobra-teleop sessions …`."""
    monkeypatch.setenv("COLUMNS", "200")

    def sessions(*words: str) -> Told:
        with pytest.raises(SystemExit) as ended:
            main(["sessions", *words, "--record", str(folder)])
        return Told(int(ended.value.code or 0), *capsys.readouterr())

    return sessions


def test_the_command_lists_marks_annotates_and_deletes(run: Any, folder: Path) -> None:
    listed = run("--alarms").out
    assert [OLD in listed, NEW in listed] == [False, True]
    assert run("mark", OLD).status == 0
    assert run("note", OLD, "stuck at blade 7").status == 0
    assert json.loads((folder / f"{OLD}.notes.json").read_text()) == {"marked": True, "note": "stuck at blade 7"}
    kept = run("delete", OLD)
    assert (kept.status, kept.error.count("\n")) == (2, 1)
    assert "take its mark away" in kept.error
    assert run("delete", NEW).status == 0
    assert "★" in run("--marked", "--text", "blade").out
    assert not list(folder.glob(f"{NEW}*"))


@pytest.mark.parametrize("name", ["../secret", "2026-01-03_08-00-00_cobra"])
def test_a_session_that_is_not_there_is_one_clear_line(run: Any, name: str) -> None:
    missed = run("delete", name)
    assert (missed.status, missed.error.count("\n")) == (2, 1)
    assert f"there is no session '{name}'" in missed.error
