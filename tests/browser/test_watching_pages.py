"""A viewer's pages in a real browser: the wall, a robot's page without anything that drives, a phone, the keyboard, a slow link."""

import socket
from collections.abc import Iterator
from typing import Any

import pytest

from app.console.front_door import FrontDoor
from tests.app.test_watching import House, Robot
from tests.browser.conftest import without_scene
from tests.page_fakes import FakeSession
from tests.stack import wait_for

expect = pytest.importorskip("playwright.sync_api").expect
expect.set_options(timeout=30_000)
PHONE = {"width": 390, "height": 844}


@pytest.fixture(scope="module")
def robots() -> Iterator[tuple[Robot, Robot]]:
    with Robot("left") as left, Robot("right") as right:
        yield left, right


@pytest.fixture(scope="module")
def house(robots: tuple[Robot, Robot]) -> Iterator[House]:
    with House([robot.endpoint for robot in robots]) as house:
        wait_for("both robots", lambda: len(house.robots) == 2 and all(r.latest() for r in house.robots.values()))
        yield house


@pytest.fixture
def session() -> FakeSession:
    return FakeSession()


@pytest.fixture
def door(session: FakeSession) -> Iterator[FrontDoor]:
    with (
        socket.create_server(("127.0.0.1", 0)) as nobody,
        FrontDoor("127.0.0.1", 0, nobody.getsockname()[1], session) as door,
    ):
        yield door


@pytest.fixture
def calm(tab: Any) -> Any:
    without_scene(tab.context)
    return tab


def test_a_robot_opens_from_the_wall_and_leads_back_there(calm: Any, house: House) -> None:
    calm.goto(house.door.url)
    calm.get_by_role("link", name="left").click()
    expect(calm.get_by_test_id("state")).to_have_text("Driving")
    expect(calm.get_by_test_id("driver")).to_have_text("ann")
    calm.get_by_test_id("to-wall").click()
    expect(calm.get_by_test_id("robot-right")).to_contain_text("Driving")
    expect(calm.get_by_test_id("summary")).to_have_text("2 robots, 2 driven")


def test_a_viewers_page_offers_stop_and_nothing_that_drives(calm: Any, house: House, robots: Any) -> None:
    calm.goto(f"{house.door.url}robot/left/")
    expect(calm.get_by_test_id("state")).to_have_text("Driving")
    for name in ("arm", "disarm", "home", "clear", "hold", "stick-left", "quit", "mark", "note"):
        expect(calm.get_by_test_id(name)).to_be_hidden()
    assert not [button for button in calm.locator(".modes button").all() if button.is_visible() and button.is_enabled()]
    before = len(robots[0].stops)
    calm.get_by_test_id("stop").click()
    wait_for("the stop", lambda: len(robots[0].stops) > before)
    assert not robots[0].got["command"]
    assert not robots[0].got["request"]


def test_by_keyboard_alone_a_viewer_gets_from_the_wall_to_a_robot_and_stops_it(
    calm: Any, house: House, robots: Any
) -> None:
    calm.goto(house.door.url)
    expect(calm.get_by_test_id("robot-right")).to_be_visible()
    for _ in range(8):
        calm.keyboard.press("Tab")
        if calm.evaluate("document.activeElement.textContent") == "right":
            break
    calm.keyboard.press("Enter")
    expect(calm.get_by_test_id("state")).to_have_text("Driving")
    assert calm.url.endswith("/robot/right/")
    before = len(robots[1].stops)
    calm.keyboard.press("Escape")
    wait_for("the stop", lambda: len(robots[1].stops) > before)
    # And the keys that would drive do nothing here.
    calm.keyboard.down("Space")
    calm.keyboard.press("d")
    calm.keyboard.up("Space")
    assert not robots[1].got["command"]


def test_on_a_phone_a_viewer_sees_the_robot_and_can_stop_it(chromium: Any, house: House, robots: Any) -> None:
    context = chromium.new_context(viewport=PHONE, has_touch=True, is_mobile=True)
    without_scene(context)
    page = context.new_page()
    page.goto(f"{house.door.url}robot/left/")
    expect(page.get_by_test_id("state")).to_have_text("Driving")
    assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
    assert page.get_by_test_id("viewer").bounding_box()["height"] > 300
    expect(page.get_by_test_id("stop")).to_be_in_viewport(ratio=1)
    expect(page.get_by_test_id("to-wall")).to_be_visible()
    before = len(robots[0].stops)
    page.get_by_test_id("stop").tap()
    wait_for("the stop", lambda: len(robots[0].stops) > before)
    page.get_by_test_id("to-wall").click()
    expect(page.get_by_test_id("robot-left")).to_be_visible()
    assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
    context.close()


def test_the_thin_view_is_chosen_kept_and_left_again(calm: Any, house: House) -> None:
    calm.goto(f"{house.door.url}robot/left/")
    toggle = calm.get_by_test_id("thin-toggle")
    expect(toggle).to_have_attribute("aria-pressed", "false")

    def thin() -> bool:
        return "thin" in str(calm.get_by_test_id("viewer").get_attribute("src")).partition("#")[2].split("/")

    assert not thin()
    toggle.click()
    expect(toggle).to_have_attribute("aria-pressed", "true")
    wait_for("the thin view", thin)
    calm.reload()
    expect(toggle).to_have_attribute("aria-pressed", "true")
    wait_for("the thin view", thin)
    expect(calm.get_by_test_id("state")).to_have_text("Driving")
    toggle.click()
    wait_for("the full view", lambda: not thin())


def test_a_page_that_hears_late_goes_thin_by_itself(calm: Any, door: FrontDoor, session: FakeSession) -> None:
    session.changes["link"] = {"ok": True, "robot": True, "age_ms": 1300.0}
    calm.goto(door.url)
    expect(calm.get_by_test_id("thin-toggle")).to_have_attribute("aria-pressed", "true")
    expect(calm.get_by_test_id("answer")).to_contain_text("thin one")
