"""No path leads out of what a server serves, however it is written: pages' files, recordings, viser's files, replays."""

import contextlib
import socket
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
import viser

from app.console.front_door import FrontDoor
from app.console.recordings_page import recordings_routes
from app.recording.player import Player
from app.recording.reader import Recording
from app.recording.replay import start_server
from cobra.clock import SystemClock
from tests.page_fakes import FakeSession, cookie_of
from tests.recordings import write

SECRET = "a secret that lies beside the folder"
UP = (
    "..",
    "%2e%2e",
    ".%2e",
    "%2E%2E%2F..",
    "..%2f..",
    "..%5c..",
    "..\\..",
    "%252e%252e",
    "....//..",
    "..;/..",
    "%c0%ae%c0%ae",
    "..%00",
    "~/..",
    "%2e%2e%2f%2e%2e",
)


def raw(port: int, path: str, cookie: str) -> tuple[int, bytes]:
    """Status and body of a request whose path no client tidied up."""
    with socket.create_connection(("127.0.0.1", port), timeout=10) as line:
        head = f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nCookie: {cookie}\r\nConnection: close\r\n\r\n"
        line.sendall(head.encode())
        answer = b""
        with contextlib.suppress(ConnectionResetError):
            while piece := line.recv(65536):
                answer += piece
    status, _, body = answer.partition(b"\r\n\r\n")
    return int(status.split()[1]), body


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    around = tmp_path_factory.mktemp("around")
    (around / "secret").write_text(SECRET)
    (around / "secret.mcap").write_text(SECRET)
    inside = around / "recordings"
    inside.mkdir()
    write(inside / "2026-01-03_08-00-00_cobra.mcap")
    return inside


@pytest.fixture(scope="module")
def door(folder: Path) -> Iterator[FrontDoor]:
    viewer = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    with FrontDoor("127.0.0.1", 0, viewer.get_port(), FakeSession(), recordings_routes(folder)) as door:
        yield door
    viewer.stop()


@pytest.fixture(scope="module")
def replay(folder: Path) -> Iterator[int]:
    with ExitStack() as stack:
        recording = stack.enter_context(Recording(next(folder.glob("*.mcap"))))
        yield start_server(Player([recording], SystemClock()), 0, stack).port


@pytest.mark.parametrize("up", UP)
@pytest.mark.parametrize("room", ["static", "viewer", "viewer/thin", "sessions/file", "sessions/frames/a", "sessions"])
def test_no_way_leads_out_of_a_room_of_the_front_door(door: FrontDoor, folder: Path, room: str, up: str) -> None:
    cookie = cookie_of(door.port)
    for steps in (1, 8):
        for target in ("secret.mcap", "etc/passwd", str(folder.parent / "secret")):
            status, body = raw(door.port, f"/{room}/{'/'.join([up] * steps)}/{target}", cookie)
            assert status in (400, 401, 404, 405, 409), (room, up, steps, target, status)
            assert not any(word in body for word in (SECRET.encode(), b"root:", b"[project]")), (room, up, target)
    assert raw(door.port, "/static/icon.svg", cookie)[0] == 200, "what is there is served"


@pytest.mark.parametrize("up", UP)
def test_no_way_leads_out_of_a_replay(replay: int, folder: Path, up: str) -> None:
    cookie = cookie_of(replay)
    for room in ("static", "viewer"):
        for target in ("secret", "etc/passwd", str(folder / "2026-01-03_08-00-00_cobra.mcap")):
            status, body = raw(replay, f"/{room}/{'/'.join([up] * 8)}/{target}", cookie)
            assert status in (400, 401, 404), (room, up, target)
            assert b"root:" not in body


def test_with_a_session_or_without_a_robots_pages_lead_nowhere_else(door: FrontDoor) -> None:
    for path in (
        "/static/../ws",
        "/static/%2e%2e/audit",
        "//audit",
        "/./audit",
        "/viewer/~/../../audit",
        "/sign-in/../audit",
    ):
        assert raw(door.port, path, "")[0] in (401, 404), path
