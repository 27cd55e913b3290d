"""Signing in and out in a real browser: what it sends of its own accord decides, not what a test's client would."""

import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from app.console.front_door import FrontDoor
from app.people.sessions import Sessions
from app.people.users import Users
from tests.browser.conftest import without_scene
from tests.page_fakes import FakeSession

expect = pytest.importorskip("playwright.sync_api").expect


@pytest.fixture
def users(tmp_path: Path) -> Users:
    return Users(tmp_path / "users.json")


@pytest.fixture
def token(users: Users) -> str:
    return users.add("eve", "admin")


@pytest.fixture
def door(users: Users, token: str) -> Iterator[FrontDoor]:
    session = FakeSession()
    session.changes["seat"] = {"shared": False, "page": "", "console_pad": False}
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))
        with FrontDoor("127.0.0.1", 0, nobody.getsockname()[1], session, sessions=Sessions(users, "me")) as door:
            yield door


def test_who_signs_in_is_in_and_who_signs_out_is_out_on_every_page(tab: Any, door: FrontDoor, token: str) -> None:
    without_scene(tab.context)
    tab.goto(door.url)
    tab.fill("#name", "eve")
    tab.fill("#token", "not it")
    tab.get_by_test_id("sign-in").click()
    expect(tab.locator("body")).to_contain_text("Name and token do not belong together.")
    expect(tab.locator("#name")).to_have_value("eve")
    tab.fill("#token", token)
    tab.get_by_test_id("sign-in").press("Enter")
    expect(tab.get_by_test_id("user")).to_have_text("eve, admin")
    other = tab.context.new_page()
    other.goto(door.url)
    expect(other.get_by_test_id("user")).to_have_text("eve, admin")
    tab.get_by_test_id("sign-out").click()
    for page in (tab, other):
        expect(page.get_by_test_id("sign-in")).to_be_visible()
    assert door.counts["foreign origin"] == 0
