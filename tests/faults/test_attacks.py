"""What somebody on the network may try against the real program, one after the other: refused, counted, nothing moves.

Each attack has quick tests of its own beside the room that refuses it; here the robot stands ready behind all of them.
Who reads nothing is cut off from the real program in `tests/benchmarks/test_viewers.py`: that takes a robot that moves.
"""

import json
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx
import pytest
from websockets import Origin
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from app.console.sign_in import TRY_EVERY_S
from app.link.keys import key
from app.people.users import Users
from cobra.messages import Command, Intent, encode
from tests.page_fakes import PageClient, cookie_of
from tests.stack import Page, Stack, wait_for

pytestmark = pytest.mark.long
NAMES = {"anna": "driver", "vic": "viewer"}
TRIES = 1000
GUESS = """
import http.client, json, sys
from concurrent.futures import ThreadPoolExecutor
from urllib.parse import urlencode
port, tries = map(int, sys.argv[1:])
def attempt(number):
    line = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    line.request("POST", "/sign-in", urlencode({"name": "anna", "token": f"guess {number}"}))
    status = line.getresponse().status
    line.close()
    return status
with ThreadPoolExecutor(8) as crowd:
    print(json.dumps(list(crowd.map(attempt, range(tries)))))
"""


class Fort:
    """The program with a robot that is ready, its driver's page, and what an attacker may have got hold of."""

    def __init__(self, stack: Stack, anna: Page, users: dict[str, tuple[str, str]]) -> None:
        self.stack, self.anna, self.users = stack, anna, users
        self.port = urlsplit(stack.url).port or 0
        assert stack.observer is not None
        self.observer = stack.observer
        self.cookies = {name: cookie_of(self.port, user) for name, user in users.items()}

    def counts(self) -> dict[str, int]:
        """What was refused so far, by reason."""
        answer = httpx.get(f"{self.stack.url}healthz", headers={"cookie": self.cookies["anna"]}).json()
        return dict(answer["counts"])

    def refused(self, path: str, **options: Any) -> None:
        with pytest.raises(InvalidStatus):
            connect(f"ws://127.0.0.1:{self.port}{path}", **options).close()


@pytest.fixture(scope="module")
def fort(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Fort]:
    folder: Path = tmp_path_factory.mktemp("fort")
    book = Users(folder / "users.json")
    users = {name: (name, book.add(name, role)) for name, role in NAMES.items()}
    with Stack(folder, "--twin", "ideal", "--frame-rate", "2", "--no-record") as stack:
        stack.start()
        with Page(stack.url, users["anna"]) as anna:
            assert anna.ask("acquire")["ok"]
            anna.arm()
            yield Fort(stack, anna, users)


@pytest.fixture(autouse=True)
def nothing_moves(fort: Fort) -> Iterator[None]:
    before = fort.observer.state
    yield
    tick = fort.observer.state.tick
    after = fort.observer.wait("some ticks more", lambda state: state.tick > tick + 30)
    assert after.commanded == pytest.approx(before.commanded, abs=1e-6)
    assert (after.phase, after.lease.holder, after.epoch) == ("ready", "anna", before.epoch)


def test_no_cookie_and_a_forged_one(fort: Fort) -> None:
    before = fort.counts().get("no session", 0)
    for cookie in ("", f"cobra-{fort.port}=forged"):
        for path in ("/ws", "/viewer/", "/viewer/~forged/"):
            fort.refused(path, origin=Origin(f"http://127.0.0.1:{fort.port}"), additional_headers={"cookie": cookie})
        assert httpx.post(f"{fort.stack.url}stop", headers={"cookie": cookie}).status_code == 401
    assert fort.counts()["no session"] == before + 8


def test_a_stolen_viewers_cookie_with_forged_messages(fort: Fort) -> None:
    with PageClient(fort.port, fort.cookies["vic"]) as thief:
        for number in range(1, 20):
            thief.drive(held=number > 5, left=[1, 0])
        for number, what in enumerate(("acquire", "take", "arm", "disarm", "home", "quit", "restart_robot", "grant")):
            thief.send({"type": "act", "id": number, "what": what, "text": "vic"})
            assert not thief.next("reply")["ok"]
        for forged in ({"type": "snapshot"}, {"type": "act", "id": 1, "what": "fly"}, {"type": "controls", "seq": 1}):
            thief.send(forged)
        thief.settle()
    counts = fort.counts()
    assert counts["controls of somebody who may not drive"] == 19
    assert counts["request beyond the role"] == 8
    assert counts["message out of range or of no known kind"] == 3


def test_replayed_commands_of_the_driver(fort: Fort) -> None:
    """From the page's websocket, and from the link behind the console, with lease and all."""
    with PageClient(fort.port, fort.cookies["anna"]) as other:
        captured = [other.controls(held=False), other.controls(held=True, left=[1, 0])]
        for message in captured * 20:
            other.send(message)
        other.settle()
    assert fort.counts()["repeated or older controls"] == 38
    heard: list[bytes] = []
    session = fort.observer.link._session
    assert session is not None
    name = key("cobra", "command")
    with_ears = session.declare_subscriber(name, lambda sample: heard.append(sample.payload.to_bytes()))
    wait_for("the driver's own commands", lambda: len(heard) > 10)
    with_ears.undeclare()
    before = fort.observer.state.drops
    for data in heard[:10]:
        session.put(name, data)
    for lease in ("", "guessed"):
        session.put(name, encode(Command(lease=lease, epoch=99, sequence=10**9, echo=fort.observer.state.stamp, held=True,
                                         intent=Intent(primary=(1.0, 0.0)))))  # fmt: skip
    wait_for("the count", lambda: sum(fort.observer.state.drops.values()) >= sum(before.values()) + 12)


def test_oversized_and_malformed_frames(fort: Fort) -> None:
    frames = ["x" * 5000, "x" * 1_000_000, b"\x00" * 70_000, "[" * 4000, '{"type":"controls","seq":NaN}', "{}", ""]
    before = sum(fort.counts().values())
    with PageClient(fort.port, fort.cookies["anna"]) as page:
        for frame in frames:
            page.send_raw(frame)
        page.settle()
    session = fort.observer.link._session
    assert session is not None
    for data in (b"", b"\xc1", b"\x91" * 5000, bytes(100_000)):
        drops = fort.observer.state.drops.get("malformed message", 0)
        session.put(key("cobra", "command"), data)
        fort.observer.wait("the count", lambda state, n=drops: state.drops.get("malformed message", 0) == n + 1)
    assert sum(fort.counts().values()) == before + len(frames)


def test_paths_that_lead_out(fort: Fort) -> None:
    for path in (
        "/static/..%2f..%2fusers.json",
        "/viewer/..%2fws",
        "/sessions/file/..%2fusers.json",
        "/static/%2e%2e/ws",
    ):
        with socket.create_connection(("127.0.0.1", fort.port), timeout=10) as line:
            head = f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1:{fort.port}\r\nCookie: {fort.cookies['vic']}\r\n"
            line.sendall(f"{head}Connection: close\r\n\r\n".encode())
            assert line.recv(64).split()[1] in (b"404", b"409"), path


def test_a_foreign_page_with_the_drivers_cookie(fort: Fort) -> None:
    before = fort.counts().get("foreign origin", 0)
    for origin in ("http://evil.example", "null", None):
        for path in ("/ws", "/viewer/"):
            options = {"origin": Origin(origin)} if origin else {}
            fort.refused(path, additional_headers={"cookie": fort.cookies["anna"]}, **options)
    posted = httpx.post(
        f"{fort.stack.url}stop", headers={"cookie": fort.cookies["anna"], "origin": "http://evil.example"}
    )
    assert posted.status_code == 403
    assert fort.counts()["foreign origin"] == before + 7


def test_a_thousand_tries_to_sign_in_while_somebody_drives(fort: Fort) -> None:
    """The driver's stream goes on: no press is lost, no drive ends."""
    fort.anna.press()
    ended = threading.Event()
    phases = []

    def look() -> None:
        while not ended.wait(0.02):
            phases.append(fort.observer.state.phase)

    looking = threading.Thread(target=look)
    looking.start()
    began = time.monotonic()

    # A process of its own, behind the others: whoever attacks takes no time from the driver's page.
    crowd = subprocess.run(
        ["nice", "-n", "15", sys.executable, "-c", GUESS, str(fort.port), str(TRIES)],
        check=True, capture_output=True, text=True, timeout=150,
    )  # fmt: skip
    statuses = json.loads(crowd.stdout)
    took_s = time.monotonic() - began
    ended.set()
    looking.join()
    fort.anna.release()
    fort.anna.until_phase("ready")
    assert set(statuses) == {401, 429}
    counts = fort.counts()
    assert counts["sign-in: too many tries"] == statuses.count(429)
    assert statuses.count(401) <= 6 + took_s / TRY_EVERY_S
    assert set(phases) == {"driving"}, json.dumps(counts)
