"""Setting a pad up in a real browser: what is tried there moves nothing, and what is applied is kept for that device alone."""

import json
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from app.console.front_door import FrontDoor
from app.console.mapping import DEAD_MAN
from app.console.pad_profile import PadProfiles
from app.console.pad_routes import pad_routes
from tests.browser.conftest import PAD, without_scene
from tests.page_fakes import FakeSession, cookie_of

expect = pytest.importorskip("playwright.sync_api").expect

DEVICE = "Test Pad (STANDARD GAMEPAD)"
LB, A, X = 4, 0, 2
REST_MS, SWEEP_MS = 1000, 5000
EDGE_MS = 400
"""The page's time goes on by itself beside what a test adds to it: on a busy machine seconds pass between two steps."""


@pytest.fixture
def session() -> FakeSession:
    session = FakeSession()
    session.changes["phase"] = "disarmed"
    return session


@pytest.fixture
def kept(tmp_path: Path) -> Path:
    return tmp_path / "pads.json"


@pytest.fixture
def door(session: FakeSession, kept: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[FrontDoor]:
    # A machine busy with tests may not hear a page every 200 ms; that limit has its own tests, without a browser.
    monkeypatch.setattr("app.console.page_socket.SILENCE_S", 10.0)
    monkeypatch.setattr("app.console.page_socket.MAX_ECHO_AGE_S", 10.0)
    profiles = PadProfiles(kept)
    profiles.start()
    pads = pad_routes(profiles, lambda: session.changes["phase"] != "disarmed")
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))
        with FrontDoor("127.0.0.1", 0, nobody.getsockname()[1], session, pads) as door:
            yield door


@pytest.fixture
def page(tab: Any, door: FrontDoor, session: FakeSession) -> Any:
    without_scene(tab.context)
    tab.add_init_script(PAD)
    tab.goto(door.url)
    expect(tab.get_by_test_id("state")).to_have_text("Disarmed")
    session.wait(lambda: session.received)
    return tab


@pytest.fixture
def dialog(page: Any) -> Any:
    page.get_by_test_id("pad-setup-here").click()
    expect(page.locator("#setup-device")).to_have_text(DEVICE)
    return page


def shows(page: Any, side: str, x: float, y: float) -> None:
    origin = {"left": (62, 66), "right": (150, 101)}[side]
    cap = page.locator(f"#setup-picture .cap.{side}")
    expect(cap).to_have_attribute("cx", f"{origin[0] + 9 * x:.1f}")
    expect(cap).to_have_attribute("cy", f"{origin[1] + 9 * y:.1f}")


def move(page: Any, *axes: float) -> None:
    page.evaluate("axes => thePad.axes.splice(0, axes.length, ...axes)", list(axes))


def drag(page: Any, test_id: str, value: float) -> None:
    page.get_by_test_id(test_id).evaluate(
        "(slider, value) => { slider.value = value; slider.dispatchEvent(new Event('input')); }", value
    )


def lit(page: Any) -> list[str]:
    return sorted(page.locator("#setup-picture .on").evaluate_all("all => all.map(one => one.dataset.button)"))


def apply(page: Any) -> None:
    page.get_by_test_id("setup-apply").click()
    expect(page.get_by_test_id("setup-message")).to_have_text("Applied, and kept for this device.")


def test_the_picture_lives_and_nothing_that_is_tried_there_drives(page: Any, session: FakeSession) -> None:
    page.get_by_test_id("pad-use-here").click()
    page.get_by_test_id("pad-setup-here").click()
    move(page, 0.5, -1.0, 0.2, 0.0)
    page.evaluate(f"press({LB}, true); press({A}, true); press(7, true)")
    shows(page, "left", 0.5, -1.0)
    shows(page, "right", 0.2, 0.0)
    expect(page.locator("#setup-picture .pull.rt")).to_have_attribute("width", "34.0")
    assert lit(page) == ["a", "left_shoulder"]
    page.keyboard.down("Space")
    page.keyboard.down("KeyW")
    count = len(session.received)
    session.wait(lambda: len(session.received) > count + 5)
    at_rest = [(c.left, c.right, DEAD_MAN in c.buttons) for _, _, c in session.received]
    assert set(at_rest) == {((0, 0), (0, 0), False)}
    assert session.requests == []
    # What is still held when the dialog closes does not drive either; let go and pressed anew it does.
    page.keyboard.up("KeyW")
    page.keyboard.up("Space")
    page.get_by_test_id("setup-close").click()
    count = len(session.received)
    session.wait(lambda: len(session.received) > count + 5)
    assert not session.held
    page.evaluate(f"press({LB}, false)")
    count = len(session.received)
    session.wait(lambda: len(session.received) > count + 5)  # it was seen to be up
    page.evaluate(f"press({LB}, true)")
    session.wait(lambda: session.held)
    assert session.newest.left == (0.5, -1.0)


def test_dead_zone_expo_inversion_exchange_and_assignment_are_kept_for_the_device(
    dialog: Any, session: FakeSession, kept: Path
) -> None:
    page = dialog
    drag(page, "dead-zone", 0.2)
    drag(page, "trigger-zone", 0.1)
    drag(page, "expo", 0.75)
    expect(page.locator("#dead-zone-value")).to_have_text("20 %")
    page.get_by_label("invert left stick, up/down").check()
    move(page, 0.0, 1.0, 0.0, 0.0)
    shows(page, "left", 0.0, -1.0)
    page.get_by_test_id("swap").check()
    shows(page, "right", 0.0, -1.0)
    page.locator("#exchange-a").select_option("a")
    page.locator("#exchange-b").select_option("x")
    page.get_by_test_id("exchange").click()
    expect(page.get_by_test_id("assigned").locator("li")).to_have_text(["a does what x did", "x does what a did"])
    page.evaluate(f"press({A}, true)")
    expect(page.locator("#setup-picture [data-button=x]")).to_have_class("button on")
    page.evaluate(f"press({A}, false)")
    assert not kept.exists(), "nothing takes effect before Apply"
    apply(page)
    profile = json.loads(kept.read_text())[DEVICE]
    assert profile["shape"] == {"stick_dead_zone": 0.2, "trigger_dead_zone": 0.1, "expo": 0.75}
    assert (profile["invert"], profile["swap_sticks"]) == (["left_y"], True)
    assert profile["assign"] == {"a": "x", "x": "a"}

    # It is there again after a reload, acts when the pad drives, and another device has none of it.
    page.reload()
    page.get_by_test_id("pad-use-here").click()
    move(page, 0.0, 0.0, 0.0, 0.0)
    session.wait(lambda: session.newest.device == DEVICE)
    count = len(session.received)
    session.wait(lambda: len(session.received) > count + 5)  # it was seen to be up
    page.evaluate(f"press({LB}, true)")
    session.wait(lambda: session.held)
    move(page, 0.0, 0.5, 0.0, 0.0)
    session.wait(lambda: session.newest.right == (0, -0.5))
    page.evaluate(f"press({LB}, false); press({X}, true)")
    session.wait(lambda: "a" in session.newest.buttons)
    page.get_by_test_id("pad-setup-here").click()
    expect(page.get_by_test_id("dead-zone")).to_have_value("0.2")
    page.get_by_test_id("setup-close").click()
    page.evaluate("thePad.id = 'Another pad'")
    expect(page.get_by_test_id("pads")).to_contain_text("Another pad")
    page.get_by_test_id("pad-setup-here").click()
    expect(page.get_by_test_id("dead-zone")).to_have_value("0.12")
    expect(page.get_by_test_id("swap")).not_to_be_checked()


def test_nothing_is_applied_while_the_robot_is_armed(
    dialog: Any, session: FakeSession, door: FrontDoor, kept: Path
) -> None:
    for phase in ("homing", "ready", "driving", "holding", "stopped", "fault"):
        session.changes["phase"] = phase
        expect(dialog.get_by_test_id("setup-apply")).to_be_disabled()
        expect(dialog.get_by_test_id("setup-armed")).to_be_visible()
    # The console decides, whatever the page offers.
    body = json.dumps({"device": DEVICE, "profile": {"swap_sticks": True}})
    answer = httpx.post(f"{door.url}pads", content=body, headers={"cookie": cookie_of(door.port)})
    assert answer.status_code == 409
    assert "disarm it first" in answer.json()["reasons"][0]
    assert not kept.exists()
    session.changes["phase"] = "disarmed"
    expect(dialog.get_by_test_id("setup-apply")).to_be_enabled()
    apply(dialog)


def test_calibration_finds_centre_and_reach_and_says_when_it_cannot(dialog: Any, kept: Path) -> None:
    page = dialog
    page.clock.install()

    def calibrate(*edges: tuple[float, float]) -> None:
        page.get_by_test_id("calibrate").click()
        page.clock.run_for(REST_MS + 50)
        for x, y in edges:
            move(page, 0.1 + x, y, x, y)
            page.clock.run_for(EDGE_MS)
        move(page, 0.1, 0.0, 0.0, 0.0)
        page.clock.run_for(SWEEP_MS)

    move(page, 0.1, 0.0, 0.0, 0.0)
    calibrate((0, 0))  # somebody who turns nothing
    expect(page.get_by_test_id("setup-message")).to_contain_text("That did not work")
    calibrate((0.8, 0), (-0.8, 0), (0, 0.8), (0, -0.8))
    expect(page.get_by_test_id("setup-message")).to_have_text("Calibrated. Try it, then apply.")
    shows(page, "left", 0.0, 0.0)
    move(page, 0.5, 0.0, 0.0, 0.0)
    page.clock.run_for(100)
    shows(page, "left", 0.5, 0.0)
    apply(page)
    profile = json.loads(kept.read_text())[DEVICE]
    assert profile["centre"] == [0.1, 0, 0, 0]
    assert profile["reach"] == [0.8, 0.8, 0.8, 0.8]
    page.get_by_test_id("setup-reset").click()
    page.clock.run_for(100)
    shows(page, "left", 0.5, 0.0)
    apply(page)
    assert json.loads(kept.read_text())[DEVICE]["centre"] == [0, 0, 0, 0]
