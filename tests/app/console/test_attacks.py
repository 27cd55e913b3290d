"""What somebody on the network may try. Each is refused and counted, and nothing reaches the robot."""

import contextlib
import http.client
import json
import logging
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import pytest
from websockets import Origin
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from app.console.front_door import FrontDoor
from app.people.sessions import Sessions
from app.people.users import Users
from tests.page_fakes import FakeSession, PageClient, cookie_of

STOP_ONLY = ("arm", "disarm", "home", "clear", "quit", "restart_robot", "section", "speed")


@pytest.fixture
def users(tmp_path: Path) -> Users:
    return Users(tmp_path / "users.json")


@pytest.fixture
def people(users: Users) -> dict[str, tuple[str, str]]:
    return {role: (role, users.add(role, role)) for role in ("viewer", "driver", "admin")}


@pytest.fixture
def door(
    people: dict[str, tuple[str, str]], users: Users, session: FakeSession, no_viewer_port: int
) -> Iterator[FrontDoor]:
    with FrontDoor("127.0.0.1", 0, no_viewer_port, session, sessions=Sessions(users, "me")) as door:
        yield door


def fetch(door: FrontDoor, method: str, path: str, body: str | bytes = b"", **headers: str) -> Any:
    connection = http.client.HTTPConnection("127.0.0.1", door.port, timeout=20)
    connection.request(method, path, body, {name.replace("_", "-"): value for name, value in headers.items()})
    response = connection.getresponse()
    text = response.read().decode()
    connection.close()
    return response.status, response, text


def sign_in(door: FrontDoor, name: str, token: str) -> Any:
    return fetch(door, "POST", "/sign-in", urlencode({"name": name, "token": token}))


def nothing_moved(session: FakeSession) -> bool:
    return (session.received, session.acts) == ([], [])


@pytest.mark.parametrize("cookie", ["", "cobra-0=x", "{name}=", "{name}=forged", "{name}=\u00e9", "=;=;=", "x" * 8000])
def test_without_a_session_no_page_no_socket_and_no_scene(door: FrontDoor, session: FakeSession, cookie: str) -> None:
    shown = cookie.format(name=f"cobra-{door.port}")
    for path in ("/viewer/", "/viewer/index.html", "/static/js/page.js", "/static/index.html", "/ws", "/nothing"):
        assert fetch(door, "GET", path, cookie=shown)[0] == 401, path
    status, response, text = fetch(door, "GET", "/", cookie=shown)
    assert (status, response.getheader("location"), text) == (303, "/sign-in", "")
    for path in ("/ws", "/viewer", "/viewer/", "/viewer/~/", "/viewer/~forged/", "/viewer/~forged"):
        with pytest.raises(InvalidStatus) as refused:
            connect(
                f"ws://127.0.0.1:{door.port}{path}",
                origin=Origin(f"http://127.0.0.1:{door.port}"),
                additional_headers={"cookie": shown},
            ).close()
        assert refused.value.response.status_code == 403
    assert fetch(door, "POST", "/stop", cookie=shown)[0] == 401
    assert door.counts["no session"] == 13
    assert nothing_moved(session)


def test_to_a_stranger_health_says_that_it_is_up_and_no_more(door: FrontDoor) -> None:
    assert json.loads(fetch(door, "GET", "/healthz")[2]) == {"ok": True}


def test_signing_in_gives_a_cookie_that_scripts_cannot_read(door: FrontDoor, people: Any, session: FakeSession) -> None:
    status, response, _ = sign_in(door, *people["driver"])
    assert (status, response.getheader("location")) == (303, "/")
    cookie = response.getheader("set-cookie")
    assert "HttpOnly" in cookie
    assert "SameSite=Lax" in cookie
    shown = cookie.partition(";")[0]
    assert fetch(door, "GET", "/", cookie=shown)[0] == 200
    with PageClient(door.port, shown) as page:
        assert (page.welcome["user"], page.welcome["role"]) == ("driver", "driver")
        page.drive()
        page.settle()
    assert len(session.received) == 1
    assert session.signed == [("signed in", "driver")]


def test_signing_out_ends_the_session_wherever_its_cookie_went(door: FrontDoor, people: Any) -> None:
    cookie = cookie_of(door.port, people["driver"])
    with PageClient(door.port, cookie) as page:
        ticket = "/" + page.welcome["view"]
        assert fetch(door, "POST", "/sign-out", cookie=cookie)[0] == 303
        assert fetch(door, "GET", "/", cookie=cookie)[0] == 303
        assert fetch(door, "GET", ticket)[0] == 401
        with pytest.raises(ConnectionClosed) as closed:
            page.read_until_closed()
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 4401


def test_a_stolen_viewers_cookie_can_look_and_stop_and_nothing_else(
    door: FrontDoor, people: Any, session: FakeSession
) -> None:
    with PageClient(door.port, cookie_of(door.port, people["viewer"])) as page:
        for number in range(1, 6):
            page.drive(held=number > 2, left=[1, 0])
        for number, what in enumerate(STOP_ONLY):
            page.send({"type": "act", "id": number, "what": what, "value": 0})
            reply = page.next("reply")
            assert not reply["ok"]
            assert "viewer" in reply["reasons"][0]
        page.settle()
        assert nothing_moved(session)
        assert door.counts["controls of somebody who may not drive"] == 5
        assert door.counts["request beyond the role"] == len(STOP_ONLY)
        page.send({"type": "act", "id": 99, "what": "stop"})
        assert page.next("reply")["ok"]
    assert session.acts == [("page 1", "stop", None)]
    assert session.askers == ["viewer"]


def test_a_driver_who_becomes_a_viewer_stops_driving_in_the_same_moment(
    door: FrontDoor, people: Any, users: Users, session: FakeSession
) -> None:
    with PageClient(door.port, cookie_of(door.port, people["driver"])) as page:
        page.drive()
        page.settle()
        users.change_role("driver", "viewer")
        page.drive(held=True)
        page.send({"type": "act", "id": 1, "what": "arm"})
        page.settle()
        assert len(session.received) == 1
        assert session.acts == []
        with pytest.raises(ConnectionClosed):
            page.read_until_closed()


def test_a_removed_user_is_out_at_once(door: FrontDoor, people: Any, users: Users, session: FakeSession) -> None:
    with PageClient(door.port, cookie_of(door.port, people["driver"])) as page:
        users.remove("driver")
        page.drive(held=False)
        page.send({"type": "act", "id": 1, "what": "stop"})
        assert page.next("reply")["reasons"] == ["your session is over: sign in again"]
    assert nothing_moved(session)


def test_a_driver_may_not_quit_for_everybody(door: FrontDoor, people: Any, session: FakeSession) -> None:
    with PageClient(door.port, cookie_of(door.port, people["driver"])) as page:
        page.send({"type": "act", "id": 1, "what": "quit"})
        assert not page.next("reply")["ok"]
    assert nothing_moved(session)


def test_a_thousand_tries_to_sign_in_cost_five_checks_and_disturb_nobody(
    door: FrontDoor, people: Any, session: FakeSession, monkeypatch: pytest.MonkeyPatch
) -> None:
    checked = []
    usual = Users.check
    monkeypatch.setattr(Users, "check", lambda self, *pair: checked.append(pair) or usual(self, *pair))
    with PageClient(door.port, cookie_of(door.port, people["driver"])) as page:
        with ThreadPoolExecutor(16) as crowd:
            tries = crowd.map(lambda number: sign_in(door, "admin", f"guess {number}")[0], range(1000))
            statuses = list(tries)
        page.drive()
        page.settle()
    assert set(statuses) <= {401, 429}
    assert 200 not in statuses
    assert len(checked) <= 7
    assert door.counts["sign-in: too many tries"] == statuses.count(429) > 990
    assert len(session.received) == 1, "whoever was in drives on"
    status, response, _ = sign_in(door, *people["admin"])
    assert status == 429
    assert int(response.getheader("retry-after")) >= 1


def test_neither_tokens_nor_cookies_are_logged(
    door: FrontDoor, people: Any, caplog: pytest.LogCaptureFixture, session: FakeSession
) -> None:
    caplog.set_level(logging.DEBUG)
    name, token = people["driver"]
    cookie = cookie_of(door.port, (name, token))
    sign_in(door, token, name)  # in the wrong fields
    with PageClient(door.port, cookie) as page:
        fetch(door, "GET", "/" + page.welcome["view"])
    ours = "\n".join(record.getMessage() for record in caplog.records if not record.name.startswith("websockets"))
    for secret in (token, cookie.partition("=")[2], page.welcome["view"].strip("/").rpartition("~")[2]):
        assert secret not in ours
    assert ("sign-in refused", "") in session.signed, "a name that is none may be a token: it is not written down"


@pytest.mark.parametrize(
    "body", [b"", b"\xff\xfe", b"name=a&token=" + b"x" * 100_000, b"&" * 5000, b"name=%00&token=%ff"]
)
def test_a_form_that_is_none_is_a_refusal(door: FrontDoor, body: bytes) -> None:
    assert fetch(door, "POST", "/sign-in", body)[0] == 401


def test_what_was_typed_comes_back_as_text_and_never_as_markup(door: FrontDoor) -> None:
    _, response, text = sign_in(door, '"><script>alert(1)</script>', "x")
    assert "<script" not in text
    assert "form-action 'self'" in response.getheader("content-security-policy")


def test_replayed_controls_move_nothing(door: FrontDoor, people: Any, session: FakeSession) -> None:
    cookie = cookie_of(door.port, people["driver"])
    with PageClient(door.port, cookie) as page:
        captured = [page.controls(), page.controls(held=True, left=[1, 0])]
        for message in captured * 3:
            page.send(message)
        page.settle()
        assert len(session.received) == 2
        assert door.counts["repeated or older controls"] == 4
    with PageClient(door.port, cookie) as later:
        later.snapshot = {}
        # In another connection they come as a dead-man that was held from the start, of a picture long gone.
        later.send({**captured[1], "echo": captured[1]["echo"] - 60})
        later.settle()
    assert len(session.received) == 2
    assert door.counts["controls that were too long on their way"] == 1


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "https://127.0.0.1", None])
def test_a_foreign_page_gets_no_websocket_even_with_the_cookie(
    door: FrontDoor, people: Any, session: FakeSession, origin: str | None
) -> None:
    cookie = cookie_of(door.port, people["admin"])
    for path in ("/ws", "/viewer/"):
        with pytest.raises(InvalidStatus):
            connect(
                f"ws://127.0.0.1:{door.port}{path}",
                origin=Origin(origin) if origin else None,
                additional_headers={"cookie": cookie},
            ).close()
    if origin:
        for path in ("/stop", "/sign-out", "/sign-in"):
            assert fetch(door, "POST", path, cookie=cookie, origin=origin)[0] == 403
    assert fetch(door, "GET", "/", cookie=cookie)[0] == 200, "and it could not sign anybody out"
    assert door.counts["foreign origin"] == (5 if origin else 2)
    assert nothing_moved(session)


@pytest.mark.parametrize("frame", ["x" * 5000, "x" * 1_500_000, b"\x00" * 70_000, "[" * 4000], ids=len)
def test_oversized_and_malformed_frames_are_counted_and_the_page_lives_on(
    door: FrontDoor, people: Any, session: FakeSession, frame: str | bytes
) -> None:
    with PageClient(door.port, cookie_of(door.port, people["driver"])) as page:
        page.send_raw(frame)
        page.settle()
        assert sum(door.counts.values()) == 1
        assert nothing_moved(session)


def test_a_frame_too_large_for_any_use_ends_its_connection(door: FrontDoor, people: Any, session: FakeSession) -> None:
    with PageClient(door.port, cookie_of(door.port, people["driver"])) as page:
        with contextlib.suppress(ConnectionClosed):
            page.send_raw("x" * 20_000_000)
        with pytest.raises(ConnectionClosed):
            page.read_until_closed()
    assert nothing_moved(session)


def test_a_reader_that_takes_nothing_is_cut_off_and_holds_nobody_up(
    door: FrontDoor, people: Any, session: FakeSession, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.console.patience.STUCK_S", 0.3)
    session.changes["cause"] = "x" * 200_000
    cookie = cookie_of(door.port, people["viewer"])
    slow = connect(
        f"ws://127.0.0.1:{door.port}/ws",
        origin=Origin(f"http://127.0.0.1:{door.port}"),
        additional_headers={"cookie": cookie},
        max_queue=1,
        max_size=None,
        close_timeout=0.1,
    )
    with PageClient(door.port, cookie_of(door.port, people["driver"])) as page:
        session.wait(lambda: door.counts["page does not read: cut off"] == 1)
        page.drive()
        page.settle()
    assert len(session.received) == 1
    assert session.ended[0] == "page 1"
    slow.close()


def test_the_views_ticket_opens_the_view_and_nothing_else(door: FrontDoor, people: Any) -> None:
    with PageClient(door.port, cookie_of(door.port, people["viewer"])) as page:
        ticket = "/" + page.welcome["view"]
        assert fetch(door, "GET", ticket)[0] == 503, "let in; there is no viser behind this door"
        for path in (f"{ticket}../../static/js/page.js", f"{ticket}..%2f..%2fws", "/ws" + ticket, "/static" + ticket):
            assert fetch(door, "GET", path)[0] in (401, 404)
        with pytest.raises(InvalidStatus):
            connect(
                f"ws://127.0.0.1:{door.port}/ws",
                origin=Origin(f"http://127.0.0.1:{door.port}"),
                additional_headers={"cookie": f"cobra-{door.port}={ticket.strip('/').rpartition('~')[2]}"},
            )
