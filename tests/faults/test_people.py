"""Several people at one robot: the real program, signed in from hand-written clients. One drives, everybody may stop."""

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from app.people.users import Users
from tests.page_fakes import cookie_of
from tests.stack import Page, Stack, wait_for

NAMES = {"anna": "driver", "bob": "driver", "eve": "admin", "vic": "viewer"}


@pytest.fixture
def users(tmp_path: Path) -> dict[str, tuple[str, str]]:
    book = Users(tmp_path / "users.json")
    return {name: (name, book.add(name, role)) for name, role in NAMES.items()}


@pytest.fixture
def stack(tmp_path: Path, users: Any) -> Iterator[Stack]:
    with Stack(tmp_path, "--twin", "ideal", "--frame-rate", "2") as stack:
        stack.start()
        yield stack


def holder(page: Page) -> str:
    return str(page.snapshot["lease"]["holder"])


def drive(page: Page) -> None:
    """Press and push a stick until the robot drives."""

    def driving() -> bool:
        page.release()
        time.sleep(0.1)
        page.hold()
        try:
            page.until_phase("driving", 1.0)
        except AssertionError:
            return False
        return True

    wait_for("the drive", driving)
    page.hold(left=[0.8, 0])


def test_one_drives_everybody_stops_and_the_controls_change_hands(stack: Stack, users: Any, tmp_path: Path) -> None:
    url, observer = stack.url, stack.observer
    assert observer is not None
    with Page(url, users["anna"]) as anna, Page(url, users["bob"]) as bob, Page(url, users["vic"]) as vic:
        # Nobody drives by just being there.
        assert holder(anna) == ""
        wait_for("all three", lambda: [p["name"] for p in anna.snapshot["people"]] == ["anna", "bob", "vic"])
        for page in (anna, bob, vic):
            page.hold(left=[1, 0])
        assert not vic.ask("acquire")["ok"]
        assert anna.ask("acquire")["ok"]
        for page in (anna, bob, vic):
            page.release()
        assert "anna drives" in bob.ask("acquire")["reasons"][0]
        assert "anna drives" in bob.ask("arm")["reasons"][0]
        anna.arm()
        assert holder(vic) == "anna"

        drive(anna)
        bob.hold(left=[-1, 0])
        observer.wait("the bend", lambda state: state.commanded[2] > 0.1)
        assert observer.state.lease.holder == "anna"
        anna.release()

        # Anna gives the controls to bob.
        assert bob.ask("ask")["ok"]
        wait_for("the question", lambda: anna.snapshot["lease"]["asking"] == ["bob"])
        assert not bob.ask("grant", text="bob")["ok"]
        assert anna.ask("grant", text="bob")["ok"]
        wait_for("bob's turn", lambda: holder(vic) == "bob")
        assert bob.snapshot["seat"]["page"] == bob.welcome["page"]
        still = observer.state.commanded
        anna.hold(left=[1, 0])
        bob.release()
        wait_for("bob ready", lambda: bob.snapshot["phase"] == "ready")
        assert observer.state.commanded == pytest.approx(still, abs=2e-2)
        anna.release()

        # The viewer stops him in the middle of a drive.
        drive(bob)
        assert vic.ask("stop")["ok"]
        state = observer.wait("the stop", lambda state: state.phase == "stopped")
        assert state.lease.holder == ""
        assert "vic" in state.cause
        assert not vic.ask("clear")["ok"]
        bob.release()
        assert bob.ask("clear")["ok"]
        observer.wait("cleared", lambda state: state.phase == "ready" and state.lease.holder == "bob")

        # An administrator takes over, with a reason; a driver cannot.
        with Page(url, users["eve"]) as eve:
            assert not anna.ask("take", text="mine")["ok"]
            assert not eve.ask("take")["ok"]
            assert eve.ask("take", text="bob is asleep")["ok"]
            wait_for("eve's turn", lambda: holder(vic) == "eve")
            assert any("bob is asleep" in event["text"] for event in vic.snapshot["events"])
            bob.hold(left=[1, 0])
        # Her page is closed: the controls are free, and the robot stands.
        observer.wait("free again", lambda state: state.lease.holder == "")
        trail = httpx.get(url + "audit", headers={"cookie": cookie_of(httpx.URL(url).port or 0, users["vic"])}).json()
    deeds = [(deed["who"], deed["what"].split(" ")[0]) for deed in trail]
    for deed in [("anna", "took"), ("anna", "armed"), ("anna", "drove"), ("anna", "gave"), ("bob", "drove"),
                 ("vic", "STOP"), ("bob", "cleared"), ("eve", "took"), ("eve", "let")]:  # fmt: skip
        assert deed in deeds, deeds
    written = "".join(path.read_text() for path in tmp_path.glob("audit-*.jsonl"))
    assert '"signed in"' in written
    assert len(json.loads(written.splitlines()[0])) == 4


def test_a_second_page_of_the_driver_takes_the_controls_along(stack: Stack, users: Any) -> None:
    with Page(stack.url, users["anna"]) as first, Page(stack.url, users["anna"]) as second:
        assert first.ask("acquire")["ok"]
        assert "another page" in second.ask("arm")["reasons"][0]
        assert second.ask("acquire")["ok"]
        wait_for("the other page", lambda: first.snapshot["seat"]["page"] == second.welcome["page"])
        assert "another page" in first.ask("disarm")["reasons"][0]
