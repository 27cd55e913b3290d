"""The door itself: what it serves, whom it lets in, and that it closes."""

import http.client
import json
import threading

import pytest
from websockets import Origin
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from app.console.front_door import FrontDoor
from tests.page_fakes import FakeSession, PageClient, cookie_of


def ask(door: FrontDoor, path: str, method: str = "GET", **headers: str) -> tuple[int, dict[str, str], str]:
    """One request of a browser that has opened the page, its path sent as it is written."""
    connection = http.client.HTTPConnection("127.0.0.1", door.port, timeout=10)
    connection.request(method, path, headers={"cookie": cookie_of(door.port), **headers})
    response = connection.getresponse()
    text = response.read().decode()
    connection.close()
    return response.status, {name.lower(): value for name, value in response.getheaders()}, text


def test_the_operators_page_may_run_only_what_comes_from_this_door(door: FrontDoor) -> None:
    status, headers, text = ask(door, "/")
    assert status == 200
    assert 'data-testid="stop"' in text
    assert "default-src 'self'" in headers["content-security-policy"]
    assert "frame-ancestors 'none'" in headers["content-security-policy"]
    assert headers["x-content-type-options"] == "nosniff"


@pytest.mark.parametrize(
    ("path", "kind"),
    [("js/page.js", "text/javascript"), ("css/base.css", "text/css"), ("icon.svg", "image/svg+xml")],
)
def test_pages_parts_are_served_with_their_types(door: FrontDoor, path: str, kind: str) -> None:
    status, headers, _ = ask(door, f"/static/{path}")
    assert status == 200
    assert headers["content-type"].startswith(kind)


@pytest.mark.parametrize(
    "path",
    [
        "/static/../pyproject.toml",
        "/static/../app/cli.py",
        "/static/%2e%2e/pyproject.toml",
        "/static/..%2f..%2fpyproject.toml",
        "/static/js/..%5c..%5c..%5cpyproject.toml",
        "/static//etc/passwd",
        "/static/%00",
        "/viewer/../../../etc/passwd",
        "/viewer/%2e%2e/%2e%2e/etc/passwd",
        "/viewer/..%5c..%5cetc/passwd",
        "/../../etc/passwd",
    ],
)
def test_no_path_leads_out_of_the_static_folder(door: FrontDoor, path: str) -> None:
    status, _, text = ask(door, path)
    assert status == 404
    assert "root:" not in text
    assert "[project]" not in text


def test_health_tells_who_is_connected(door: FrontDoor) -> None:
    with PageClient(door.port):
        status, _, text = ask(door, "/healthz")
    assert status == 200
    assert json.loads(text) == {"ok": True, "pages": 1, "viewers": 0, "counts": {}}


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example", "evil.example:80", "", "[", "[::1", "a b"])
def test_a_foreign_name_that_resolves_to_loopback_is_refused(door: FrontDoor, host: str) -> None:
    assert ask(door, "/", Host=host)[0] in (400, 403)
    assert ask(door, "/static/js/page.js", Host=host)[0] in (400, 403)


@pytest.mark.parametrize("name", ["localhost", "127.0.0.1", "[::1]", "LOCALHOST"])
def test_all_of_loopbacks_names_are_ours(door: FrontDoor, name: str) -> None:
    assert ask(door, "/", Host=f"{name}:{door.port}")[0] == 200


@pytest.mark.parametrize("path", ["/ws", "/viewer", "/viewer/"])
@pytest.mark.parametrize(
    "origin", ["http://evil.example", "null", "http://127.0.0.1:1", "ftp://{host}", "{host}", None]
)
def test_a_websocket_of_a_foreign_page_is_refused(
    door: FrontDoor, session: FakeSession, path: str, origin: str | None
) -> None:
    forged = None if origin is None else Origin(origin.format(host=f"127.0.0.1:{door.port}"))
    with pytest.raises(InvalidStatus) as refused:
        connect(f"ws://127.0.0.1:{door.port}{path}", origin=forged).close()
    assert refused.value.response.status_code == 403
    assert door.counts["foreign origin"] == 1
    assert session.ended == []


def test_stop_can_be_posted_when_the_websocket_is_dead(door: FrontDoor, session: FakeSession) -> None:
    status, _, text = ask(door, "/stop?page=3&press=1", "POST", Origin=f"http://127.0.0.1:{door.port}")
    assert (status, json.loads(text)) == (200, {"ok": True, "reasons": []})
    assert session.acts == [("page 3", "stop", None)]


def test_one_press_of_stop_that_comes_by_both_ways_counts_once(door: FrontDoor, session: FakeSession) -> None:
    with PageClient(door.port) as page:
        for press in (7, 8):
            page.send({"type": "act", "id": press, "what": "stop"})
            assert page.next("reply")["ok"]
            assert json.loads(ask(door, f"/stop?page=1&press={press}", "POST")[2])["ok"]
    assert session.acts == [("page 1", "stop", None)] * 2


def test_a_stop_that_failed_by_one_way_is_tried_again_by_the_other(door: FrontDoor, session: FakeSession) -> None:
    session.answer = lambda what, value: {"ok": False, "reasons": ["no robot"]}
    with PageClient(door.port) as page:
        page.send({"type": "act", "id": 7, "what": "stop"})
        assert not page.next("reply")["ok"]
        assert not json.loads(ask(door, "/stop?page=1&press=7", "POST")[2])["ok"]
    assert session.acts == [("page 1", "stop", None)] * 2


def test_anybody_on_this_machine_may_stop_but_no_foreign_page(door: FrontDoor, session: FakeSession) -> None:
    assert ask(door, "/stop", "POST", Origin="http://evil.example")[0] == 403
    assert ask(door, "/stop")[0] == 405
    assert session.acts == []
    for nonsense in ("", "?page=<script>", f"?page={'9' * 5000}&press={'9' * 5000}", "?page=%00&press=-1"):
        assert ask(door, f"/stop{nonsense}", "POST")[0] == 200
    assert session.acts == [("a page", "stop", None)] * 4, "nothing about the wording of a STOP can prevent it"


def test_a_taken_port_is_an_error_at_start(door: FrontDoor, session: FakeSession) -> None:
    with pytest.raises(OSError, match="in use"):
        FrontDoor("127.0.0.1", door.port, 1, session).start()


def test_after_stopping_the_port_is_free_and_every_page_is_told(door: FrontDoor, session: FakeSession) -> None:
    page = PageClient(door.port)
    door.stop()
    with pytest.raises(ConnectionClosed):
        page.read_until_closed()
    session.wait(lambda: session.ended == ["page 1"])
    with FrontDoor("127.0.0.1", door.port, 1, session) as again:
        assert ask(again, "/")[0] == 200


def test_a_page_that_does_not_read_cannot_keep_the_door_open(door: FrontDoor, session: FakeSession) -> None:
    session.changes["cause"] = "x" * 1_000_000
    # A queue of one message, and nobody who takes it: the bytes pile up to the server's own buffer.
    page = connect(
        f"ws://127.0.0.1:{door.port}/ws",
        origin=Origin(f"http://127.0.0.1:{door.port}"),
        additional_headers={"cookie": cookie_of(door.port)},
        max_queue=1,
        max_size=None,
    )
    page.recv()
    closing = threading.Thread(target=door.stop)
    closing.start()
    closing.join(10)
    assert not closing.is_alive()
    session.wait(lambda: session.ended == ["page 1"])
