"""The operator's page in a real browser, with a robot behind it that only remembers what it was told."""

import re
import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import viser

from app.console.front_door import FrontDoor
from app.console.guides import guides
from app.console.inputs import Controls
from app.console.mapping import DEAD_MAN, SHIFT
from app.console.motion_state import guide_state
from app.console.pad_profile import PadProfiles
from app.console.pad_routes import pad_routes
from cobra.loading import load_description
from tests.page_fakes import FakeSession

expect = pytest.importorskip("playwright.sync_api").expect

HELD = frozenset({DEAD_MAN})
AT_REST = Controls(buttons=HELD)


@pytest.fixture
def session() -> FakeSession:
    return FakeSession()


@pytest.fixture(autouse=True)
def a_patient_server(monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine busy with tests may not hear a page every 200 ms. That limit has its own tests, without a browser."""
    monkeypatch.setattr("app.console.page_socket.SILENCE_S", 10.0)
    monkeypatch.setattr("app.console.page_socket.MAX_ECHO_AGE_S", 10.0)


@pytest.fixture
def door(session: FakeSession, tmp_path: Path) -> Iterator[FrontDoor]:
    pads = pad_routes(PadProfiles(tmp_path / "pads.json"), lambda: False)
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))
        with FrontDoor("127.0.0.1", 0, nobody.getsockname()[1], session, pads) as door:
            yield door


@pytest.fixture
def page(tab: Any, door: FrontDoor, session: FakeSession) -> Any:
    tab.goto(door.url)
    expect(tab.get_by_test_id("state")).to_have_text("Ready")
    session.wait(lambda: session.received)  # what is held before the console has seen it let go does not drive
    return tab


def centre(page: Any, test_id: str) -> tuple[float, float]:
    box = page.get_by_test_id(test_id).bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def press(page: Any, test_id: str) -> None:
    page.mouse.move(*centre(page, test_id))
    page.mouse.down()


def is_at(session: FakeSession, **wanted: Any) -> bool:
    """The newest controls are held and read this, everything else at rest."""
    newest = session.newest
    want = {"left": (0, 0), "right": (0, 0), "left_trigger": 0, "right_trigger": 0, "buttons": HELD, **wanted}
    return all(getattr(newest, name) == value for name, value in want.items())


def first_held(session: FakeSession) -> Controls:
    return next(controls for _, _, controls in session.received if DEAD_MAN in controls.buttons)


# ---------------------------------------------------------------- what is shown


STATES = {
    "disarmed": ("Disarmed", {"arm"}),
    "homing": ("Homing", {"disarm"}),
    "ready": ("Ready", {"disarm", "home"}),
    "driving": ("Driving", {"disarm"}),
    "holding": ("Holding", {"disarm", "home"}),
    "stopped": ("Stopped", {"disarm", "clear"}),
    "fault": ("Fault", {"arm"}),
}


def test_each_state_is_a_word_a_sentence_and_the_buttons_that_make_sense(page: Any, session: FakeSession) -> None:
    for phase, (word, enabled) in STATES.items():
        session.changes.update(phase=phase, cause=f"drive S2 does not answer: {phase}")
        expect(page.get_by_test_id("state")).to_have_text(word)
        expect(page.get_by_test_id("cause")).to_have_text(f"Drive S2 does not answer: {phase}")
        buttons = ("arm", "disarm", "home", "clear")
        assert {name for name in buttons if page.get_by_test_id(name).is_enabled()} == enabled, phase
        expect(page.get_by_test_id("stop")).to_be_enabled()


def test_what_the_robot_does_is_shown_though_the_browser_draws_no_frames(page: Any, session: FakeSession) -> None:
    page.evaluate("window.requestAnimationFrame = () => 0")  # a computer whose frames all go into the 3D view
    session.changes["phase"] = "stopped"
    expect(page.get_by_test_id("state")).to_have_text("Stopped")


def test_what_prevents_arming_is_listed_beside_arm(page: Any, session: FakeSession) -> None:
    reasons = ["drive S2 does not answer", "the sticks are not centred: let them go"]
    session.changes.update(phase="disarmed", reasons=reasons)
    expect(page.get_by_test_id("reasons").locator("li")).to_have_text(reasons)
    expect(page.get_by_test_id("arm")).to_be_disabled()
    session.changes.update(reasons=[])
    expect(page.get_by_test_id("arm")).to_be_enabled()


def test_a_refused_request_says_why(page: Any, session: FakeSession) -> None:
    session.changes.update(phase="disarmed")
    session.answer = lambda what, value: {"ok": False, "reasons": ["nobody drives"]}
    page.get_by_test_id("arm").click()
    expect(page.get_by_test_id("answer")).to_have_text("Arm refused: nobody drives")
    assert session.requests == ["arm"]


def test_numbers_carry_their_units(page: Any) -> None:
    expect(page.get_by_test_id("tip")).to_have_text(re.compile(r"x\s+41\.2 mm\s*y\s+−18\.7 mm\s*z\s+262\.4 mm"))
    expect(page.locator("#twist-value")).to_have_text(re.compile(r"−31\.0 °"))
    expect(page.locator("#feed-value")).to_have_text(re.compile(r"300\.0 mm"))
    expect(page.locator(".dial output").first).to_have_text("22.5° of 90°")
    expect(page.get_by_test_id("tensions").locator("output").first).to_have_text("30.0")


def test_the_tension_along_a_tendon_is_shown_beside_its_column_when_looked_at(page: Any, session: FakeSession) -> None:
    columns, card = page.get_by_test_id("tensions").locator(".column"), page.get_by_test_id("profile")
    columns.nth(4).hover()
    expect(card).to_be_hidden()  # not known before homing
    session.changes.update(
        profiles=[[20.0, 16.0, 15.0]] * 4 + [[30.0, 24.0, 22.0, 20.5]] * 4 + [[9.0, 8.0, 7.0, 6.0, 5.0]] * 4
    )
    for column, name, rows in (
        (4, "S2", ["motor 30.0 N", "port 24.0 N", "end of base 22.0 N", "end of middle 20.5 N"]),
        (11, "W3", ["motor 9.0 N", "port 8.0 N", "end of base 7.0 N", "end of middle 6.0 N", "end of tip 5.0 N"]),
    ):
        columns.nth(column).hover()
        expect(card).to_be_visible()
        said = [re.sub(r"\s+", " ", row) for row in card.locator("p").all_inner_texts()]
        assert said == [f"Tendon {name}, along its way", *rows]
    # The mark in the column is where the tension is at the tendon's end.
    assert columns.nth(4).locator("b").evaluate("mark => mark.style.bottom") == "34%"
    page.mouse.move(5, 5)
    expect(card).to_be_hidden()
    columns.nth(0).focus()
    expect(card.locator("p").first).to_have_text("Tendon S1, along its way")


def test_unknown_numbers_are_dashes(page: Any, session: FakeSession) -> None:
    session.changes.update(tip_mm=[None, None, None], twist_deg=None, tensions=[None] * 12, timing={})
    expect(page.locator("#tip-x")).to_have_text(re.compile(r"x\s+– mm"))
    expect(page.get_by_test_id("tensions").locator("output").first).to_have_text(re.compile("–"))
    assert "NaN" not in page.locator("body").inner_text()
    assert "undefined" not in page.locator("body").inner_text()


def test_counters_are_named_in_words_when_they_are_not_zero(page: Any, session: FakeSession) -> None:
    session.changes.update(drops={"too old": 3, "wrong lease": 0}, bus={"short frame": 1})
    page.locator("#tab-health").click()
    expect(page.get_by_test_id("counters").locator("li")).to_have_text(["Commands: too old, 3", "Bus: short frame, 1"])


def test_nothing_moves_however_long_the_words_are(page: Any, session: FakeSession) -> None:
    def places() -> list[Any]:
        return [page.get_by_test_id(name).bounding_box() for name in ("stop", "hold", "tip", "arm", "stick-right")]

    before = places()
    session.changes.update(
        phase="fault",
        cause="a very long cause " * 30,
        reasons=["a long reason that goes on and on and on and on " * 3] * 9,
        tensions=[123.4] * 12,
        twist_deg=-179.9,
        lease={"holder": "somebody with a very long name indeed", "since_s": 1.0, "fresh": True},
        hints={"page 1": "let go of the hold button, centre the sticks, then press again"},
    )
    expect(page.get_by_test_id("state")).to_have_text("Fault")
    assert places() == before


def test_the_pads_picture_shows_the_pad(page: Any, session: FakeSession) -> None:
    reading = {"left": [0, -1], "right": [0, 0], "lt": 0.5, "rt": 0, "buttons": ["left_shoulder", "dpad_up"]}
    session.changes["pad"] = {"name": "Xbox pad", "connected": True, "controls": reading}
    session.changes["hints"] = {"pad": "hold LB to drive"}
    expect(page.get_by_test_id("pad")).to_have_text("Xbox pad: hold LB to drive")
    expect(page.locator("#pad-picture .cap.left")).to_have_attribute("cy", "57.0")
    lit = page.locator("#pad-picture .on").evaluate_all("all => all.map(one => one.dataset.button)")
    assert sorted(lit) == ["dpad_up", "left_shoulder"]


# ---------------------------------------------------------------- driving


def test_a_stick_drives_while_it_is_held_and_y_is_down(page: Any, session: FakeSession) -> None:
    press(page, "stick-left")
    session.wait(lambda: session.held)
    x, y = centre(page, "stick-left")
    page.mouse.move(x + 300, y - 400, steps=3)  # far outside: the pointer is captured, the stick is at its rim
    session.wait(lambda: is_at(session, left=(0.6, -0.8)))
    page.mouse.up()
    session.wait(lambda: reads(session.newest))
    assert is_at_rest(first_held(session)), "a press begins centred"


def is_at_rest(controls: Controls) -> bool:
    return reads(controls, buttons=HELD)


def reads(controls: Controls, **wanted: Any) -> bool:
    """Whether the controls are at rest but for what is wanted, whenever they came and however long that took."""
    return controls == Controls(stamp=controls.stamp, lag_s=controls.lag_s, **wanted)


HOLD_BUTTONS = {
    ("feed-in", "KeyR"): {"right_trigger": 1},
    ("feed-out", "KeyF"): {"left_trigger": 1},
    ("twist-left", "KeyQ"): {"right": (-1, 0), "buttons": HELD | {SHIFT}},
    ("twist-right", "KeyE"): {"right": (1, 0), "buttons": HELD | {SHIFT}},
}


def test_hold_buttons_and_their_keys_do_the_same(page: Any, session: FakeSession) -> None:
    for (test_id, key), reading in HOLD_BUTTONS.items():
        session.received.clear()
        press(page, test_id)
        session.wait(lambda reading=reading: is_at(session, **reading))
        assert is_at_rest(first_held(session)), "a press begins centred"
        page.mouse.up()
        session.wait(lambda: not session.held)
        page.keyboard.down("Space")
        page.keyboard.down(key)
        session.wait(lambda reading=reading: is_at(session, **reading))
        page.keyboard.up("Space")
        session.wait(lambda: reads(session.newest))
        page.keyboard.up(key)


KEYS = {
    "KeyW": {"left": (0, -1)},
    "KeyS": {"left": (0, 1)},
    "KeyA": {"left": (-1, 0)},
    "KeyD": {"left": (1, 0)},
    "KeyD KeyW": {"left": (0.707, -0.707)},
    "KeyA KeyD": {},
    "ArrowUp ArrowLeft": {"right": (-0.707, -0.707)},
    "KeyW ArrowDown KeyR": {"left": (0, -1), "right": (0, 1), "right_trigger": 1},
}


def test_keys_bend_both_sections_at_once(page: Any, session: FakeSession) -> None:
    for keys, reading in KEYS.items():
        together = ("Space", *keys.split())
        for key in together:
            page.keyboard.down(key)
        session.wait(lambda reading=reading: is_at(session, **reading))
        for key in together:
            page.keyboard.up(key)
        session.wait(lambda: not session.held)


def test_keys_without_the_space_bar_do_nothing(page: Any, session: FakeSession) -> None:
    page.keyboard.down("KeyW")
    count = len(session.received)
    session.wait(lambda: len(session.received) > count + 2)
    assert reads(session.newest)


def test_a_key_that_was_down_before_the_space_bar_must_be_pressed_anew(page: Any, session: FakeSession) -> None:
    page.keyboard.down("KeyW")
    page.keyboard.down("Space")
    session.wait(lambda: is_at(session))
    page.keyboard.up("KeyW")
    page.keyboard.down("KeyW")
    session.wait(lambda: is_at(session, left=(0, -1)))


def test_the_hold_button_with_the_pointer_and_the_keys_together(page: Any, session: FakeSession) -> None:
    press(page, "hold")
    page.keyboard.down("KeyD")
    session.wait(lambda: is_at(session, left=(1, 0)))
    page.mouse.up()
    session.wait(lambda: not session.held)


def test_while_it_drives_the_page_is_heard_many_times_a_second(page: Any, session: FakeSession) -> None:
    def rate_Hz() -> float:
        stamps = [controls.stamp for _, _, controls in session.received[-20:]]
        return 19 / (stamps[-1] - stamps[0]) if len(stamps) == 20 else 0.0

    press(page, "hold")
    session.wait(lambda: session.held and rate_Hz() > 25)
    page.mouse.up()
    session.wait(lambda: not session.held and rate_Hz() < 20)


END_OF_ATTENTION = {
    "the window loses the focus": "window.dispatchEvent(new Event('blur'))",
    "the tab is hidden": "Object.defineProperty(document, 'hidden', {value: true});"
    "document.dispatchEvent(new Event('visibilitychange'))",
    "the page is put away": "window.dispatchEvent(new PageTransitionEvent('pagehide'))",
}


@pytest.mark.parametrize("script", END_OF_ATTENTION.values(), ids=END_OF_ATTENTION.keys())
def test_a_page_that_is_not_looked_at_does_not_drive(page: Any, session: FakeSession, script: str) -> None:
    page.keyboard.down("Space")
    press(page, "stick-left")
    page.keyboard.down("ArrowUp")
    session.wait(lambda: is_at(session, right=(0, -1)))
    page.evaluate(script)
    session.wait(lambda: not session.held)
    page.mouse.move(5, 5)
    count = len(session.received)
    session.wait(lambda: len(session.received) > count + 3)
    assert not session.held, "what is still down must be let go and pressed anew"
    page.mouse.up()
    page.keyboard.up("Space")
    page.keyboard.down("Space")
    session.wait(lambda: is_at(session))


def test_leaving_the_page_ends_its_input(page: Any, session: FakeSession) -> None:
    page.keyboard.down("Space")
    session.wait(lambda: session.held)
    page.goto("about:blank")
    session.wait(lambda: "page 1" in session.ended)
    assert not session.held


def test_the_page_that_drives_is_told_what_is_missing(page: Any, session: FakeSession) -> None:
    session.changes.update(phase="stopped", hints={"page 1": "STOP is latched: clear it first"})
    expect(page.get_by_test_id("hint")).to_have_text("STOP is latched: clear it first")


def test_section_and_speed_by_click_and_by_key(page: Any, session: FakeSession) -> None:
    expect(page.get_by_test_id("section-1")).to_have_attribute("aria-pressed", "true")
    page.get_by_test_id("section-3").click()
    page.get_by_test_id("speed-1").click()
    page.keyboard.press("2")
    page.keyboard.press("-")
    page.keyboard.press("+")
    page.keyboard.press("9")  # there is no ninth section
    session.wait(lambda: len(session.acts) == 5)
    assert [(what, value) for _, what, value in session.acts] == [
        ("section", 2),
        ("speed", 0),
        ("section", 1),
        ("speed", 0),
        ("speed", 2),
    ]


def test_the_space_bar_drives_even_after_a_button_was_clicked(page: Any, session: FakeSession) -> None:
    page.get_by_test_id("home").click()
    session.wait(lambda: session.requests == ["home"])
    page.keyboard.down("Space")
    session.wait(lambda: session.held)
    page.keyboard.up("Space")
    session.wait(lambda: not session.held)
    assert session.requests == ["home"]


# ---------------------------------------------------------------- STOP


def test_stop_acts_at_the_first_touch(page: Any, session: FakeSession) -> None:
    press(page, "stop")
    session.wait(lambda: session.acts == [("page 1", "stop", None)])
    page.mouse.up()


def test_stop_arrives_when_its_websocket_is_dead_without_knowing_it(page: Any, session: FakeSession) -> None:
    page.evaluate("WebSocket.prototype.send = () => {}")
    page.get_by_test_id("stop").click()
    session.wait(lambda: session.acts == [("page 1", "stop", None)])


def test_stop_arrives_when_nothing_can_be_posted(page: Any, session: FakeSession) -> None:
    page.route("**/stop*", lambda route: route.abort())
    page.get_by_test_id("stop").click()
    session.wait(lambda: session.acts == [("page 1", "stop", None)])


def test_escape_stops_and_ends_the_drive(page: Any, session: FakeSession) -> None:
    page.keyboard.down("Space")
    page.keyboard.down("KeyW")
    session.wait(lambda: is_at(session, left=(0, -1)))
    page.keyboard.press("Escape")
    session.wait(lambda: session.requests == ["stop"] and not session.held)


def test_escape_stops_from_inside_the_3d_view_and_from_a_dialog(page: Any, session: FakeSession) -> None:
    page.mouse.move(*centre(page, "viewer"))
    page.frame_locator("#viewer").locator("body").press("Escape")
    session.wait(lambda: session.requests == ["stop"])
    page.get_by_test_id("quit").click()
    page.keyboard.press("Escape")
    session.wait(lambda: session.requests == ["stop"] * 2)


def test_stop_is_seen_and_acts_beside_an_open_dialog(page: Any, session: FakeSession) -> None:
    page.get_by_test_id("quit").click()
    x, y = centre(page, "stop")
    page.mouse.click(x, y)
    session.wait(lambda: session.requests == ["stop"])
    page.mouse.click(x - 400, y + 300)  # elsewhere behind the dialog nothing is pressed
    page.get_by_test_id("quit-cancel").press("Enter")
    assert session.requests == ["stop"]


def test_stop_by_keyboard_alone(page: Any, session: FakeSession) -> None:
    page.get_by_test_id("stop").focus()
    page.keyboard.press("Enter")
    session.wait(lambda: session.requests == ["stop"])
    page.keyboard.press("Space")
    session.wait(lambda: session.requests == ["stop"] * 2)


# ---------------------------------------------------------------- losing and finding the console


def test_when_the_line_breaks_it_says_so_and_never_drives_on_by_itself(
    page: Any, door: FrontDoor, session: FakeSession
) -> None:
    page.keyboard.down("Space")
    session.wait(lambda: session.held)
    door.stop()
    expect(page.get_by_test_id("state")).to_have_text("Cut off")
    expect(page.get_by_test_id("hold")).to_be_disabled()
    expect(page.get_by_test_id("arm")).to_be_disabled()
    before = len(session.received)
    door.start()
    expect(page.get_by_test_id("state")).to_have_text("Ready")
    session.wait(lambda: len(session.received) > before + 3)
    assert not any(DEAD_MAN in controls.buttons for _, _, controls in session.received[before:])
    page.keyboard.up("Space")
    page.keyboard.down("Space")
    session.wait(lambda: session.held)


def test_a_silent_robot_and_an_ended_one_are_told_apart(page: Any, session: FakeSession) -> None:
    restart = page.get_by_test_id("restart-robot")
    expect(restart).to_be_hidden()
    session.changes.update(link={"ok": False, "robot": True, "age_ms": 900.0})
    expect(page.get_by_test_id("state")).to_have_text("No data")
    expect(restart).to_be_hidden()
    session.changes.update(link={"ok": False, "robot": False, "age_ms": None})
    expect(page.get_by_test_id("state")).to_have_text("Robot gone")
    expect(page.get_by_test_id("arm")).to_be_disabled()
    restart.click()
    session.wait(lambda: session.requests == ["restart_robot"])


def test_quit_asks_first(page: Any, session: FakeSession) -> None:
    page.get_by_test_id("quit").click()
    # By key: a click faster than the dialog is painted falls through to the frame below it.
    page.get_by_test_id("quit-cancel").press("Enter")
    page.get_by_test_id("quit").click()
    assert session.requests == []
    page.get_by_test_id("quit-confirm").press("Enter")
    session.wait(lambda: session.requests == ["quit"])
    page.keyboard.down("Space")
    session.wait(lambda: session.held)


def test_the_3d_view_finds_viser_again_without_the_focus(tab: Any, session: FakeSession) -> None:
    viewer = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    connected = threading.Semaphore(0)
    viewer.on_client_connect(lambda client: connected.release())
    try:
        with FrontDoor("127.0.0.1", 0, viewer.get_port(), session) as door:
            tab.goto(door.url)
            assert connected.acquire(timeout=60)
            assert tab.evaluate("document.activeElement.tagName") == "BODY"
            viewer._websock_server.disconnect_all_clients()
            assert connected.acquire(timeout=60)
    finally:
        viewer.stop()


def test_where_the_3d_view_is_drawn_in_software_it_is_plain_and_leaves_the_page_time(
    tab: Any, session: FakeSession
) -> None:
    # A browser that takes 100 ms for each picture.
    tab.add_init_script("""
        window.requestAnimationFrame = (draw) => setTimeout(() => draw(performance.now()), 100);
        window.cancelAnimationFrame = clearTimeout;
    """)
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    with FrontDoor("127.0.0.1", 0, server.get_port(), session) as door:
        tab.goto(door.url)
        canvas = tab.frame_locator("#viewer").locator("canvas").first
        canvas.wait_for(state="attached")
        assert "plain" in canvas.evaluate("() => location.pathname").split("/")
        apart = canvas.evaluate("""() => new Promise((done) => {
            const times = [];
            const draw = () => times.push(performance.now()) < 5 ? requestAnimationFrame(draw) : done(times[4] - times[0]);
            requestAnimationFrame(draw);
        })""")
        assert apart > 4 * 190, "as long a pause as each took"
        assert canvas.evaluate("""() => new Promise((done) => {
            cancelAnimationFrame(requestAnimationFrame(() => done(false)));
            requestAnimationFrame(() => done(true));
        })"""), "what is cancelled is not drawn"
    server.stop()


def test_turning_the_3d_view_leaves_the_keys_with_the_robot(tab: Any, session: FakeSession) -> None:
    viewer = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    try:
        with FrontDoor("127.0.0.1", 0, viewer.get_port(), session) as door:
            tab.goto(door.url)
            tab.frame_locator("#viewer").locator("canvas[data-engine]").wait_for()
            x, y = centre(tab, "viewer")
            tab.mouse.move(x, y)
            tab.mouse.move(x + 5, y)
            tab.mouse.down()
            tab.mouse.move(x + 60, y + 30, steps=3)
            tab.mouse.up()
            tab.wait_for_function("document.activeElement.tagName === 'BODY'")
            tab.keyboard.down("Space")
            session.wait(lambda: session.held)
    finally:
        viewer.stop()


# ---------------------------------------------------------------- fit for its places


def test_the_page_fetches_nothing_from_elsewhere_and_fails_nowhere(tab: Any, door: FrontDoor) -> None:
    addresses: list[str] = []
    complaints: list[str] = []
    tab.on("request", lambda request: addresses.append(request.url))
    tab.on("pageerror", lambda error: complaints.append(str(error)))
    tab.on("console", lambda line: complaints.append(line.text) if line.type == "error" else None)
    tab.goto(door.url)
    expect(tab.get_by_test_id("state")).to_have_text("Ready")
    assert all(re.match(rf"(http|ws)://(127\.0\.0\.1|localhost):{door.port}/", address) for address in addresses)
    # The tests' door has no viser behind it, and the browser reports that.
    assert [line for line in complaints if "503" not in line] == []


@pytest.mark.parametrize("size", [(1280, 720), (1920, 1080), (1024, 768)])
def test_all_that_drives_is_in_view_without_scrolling(page: Any, size: tuple[int, int]) -> None:
    page.set_viewport_size({"width": size[0], "height": size[1]})
    names = ("state", "stop", "arm", "disarm", "home", "clear", "hold", "stick-left", "stick-right", "feed-in", "tip")
    for name in (*names, "feed-out", "twist-left", "twist-right", "section-3", "speed-1", "tensions"):
        box = page.get_by_test_id(name).bounding_box()
        assert box["x"] >= 0
        assert box["y"] >= 0
        assert box["x"] + box["width"] <= size[0], name
        assert box["y"] + box["height"] <= size[1], name
        assert page.get_by_test_id(name).evaluate("e => e.scrollWidth <= e.clientWidth + 1"), f"{name} is cut"
    view = page.get_by_test_id("viewer").bounding_box()
    assert view["width"] * view["height"] > 0.35 * size[0] * size[1], "the 3D view is the main thing"


def test_on_a_phone_the_view_and_stop_are_there(chromium: Any, door: FrontDoor, session: FakeSession) -> None:
    context = chromium.new_context(viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True)
    page = context.new_page()
    page.goto(door.url)
    expect(page.get_by_test_id("state")).to_have_text("Ready")
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    for _ in range(2):
        expect(page.get_by_test_id("stop")).to_be_in_viewport(ratio=1)
        expect(page.get_by_test_id("state")).to_be_in_viewport(ratio=1)
        page.get_by_test_id("feed-in").scroll_into_view_if_needed()
    assert page.get_by_test_id("viewer").bounding_box()["height"] > 300
    page.get_by_test_id("stop").tap()
    session.wait(lambda: session.requests == ["stop"])
    context.close()


# ---------------------------------------------------------------- modes


def choose(session: FakeSession, mode: str, **motion: Any) -> None:
    rest = {"words": [], "share": 1.0, "fallbacks": 0, "path": None, "poses": ["inspect", "home"], "pose": ""}
    session.changes.update(mode=mode, motion={**rest, "hand_feed": None, **motion})


def test_each_mode_tells_in_one_line_what_it_does_and_what_sticks_and_buttons_do(
    page: Any, session: FakeSession
) -> None:
    expect(page.get_by_test_id("mode-help")).to_contain_text("one section at a time")
    page.get_by_test_id("mode-2").click()
    session.wait(lambda: ("mode", 1) in [(what, value) for _, what, value in session.acts])
    choose(session, "tip")
    expect(page.get_by_test_id("mode-2")).to_have_attribute("aria-pressed", "true")
    expect(page.locator("#stick-left-name")).to_have_text("move tip")
    expect(page.get_by_test_id("feed-in")).to_contain_text("Advance")
    expect(page.locator("#pad-map")).to_contain_text("advance along the line of sight")
    choose(session, "following")
    expect(page.locator("#stick-right-name")).to_have_text("not used")
    choose(session, "straighten", words=["to go: 40° of bend"])
    expect(page.get_by_test_id("mode-help")).to_contain_text("To go: 40° of bend.")


def test_what_binds_and_what_is_outside_are_warned_of_in_the_place_of_the_help(page: Any, session: FakeSession) -> None:
    choose(session, "tip", words=["section tip is bent as far as it may"])
    session.changes["feed_mm"] = 342.0
    line = page.get_by_test_id("mode-help")
    expect(line).to_have_text(
        re.compile("42 mm of the passive body are outside.*Section tip is bent as far as it may\\.")
    )
    expect(line).to_have_class("warning")


def test_tip_following_shows_how_far_the_body_is_off_its_path(page: Any, session: FakeSession) -> None:
    choose(session, "following", path={"deviation_mm": 1.23, "deviation_max_mm": 3.5, "length_mm": 250.0})
    expect(page.get_by_test_id("path")).to_have_text(re.compile(r"Off the path\s+1\.2 mm at most\s+3\.5 mm"))
    choose(session, "section")
    expect(page.get_by_test_id("path")).to_be_hidden()


def test_poses_are_chosen_saved_and_deleted(page: Any, session: FakeSession) -> None:
    choose(session, "pose")
    page.get_by_test_id("pose").select_option("inspect")
    choose(session, "pose", pose="inspect")
    page.get_by_test_id("save-pose").click()
    page.get_by_test_id("pose-name").fill("blade 3")
    page.keyboard.press("Space")  # typed, not driven
    page.get_by_test_id("pose-name").fill("blade 3")
    page.get_by_test_id("save-pose-confirm").click()
    page.get_by_test_id("delete-pose").click()
    page.get_by_test_id("delete-pose-confirm").click()
    session.wait(lambda: len(session.texts) >= 3)
    asked = list(zip(session.requests, session.texts, strict=True))
    assert asked == [("pose", "inspect"), ("save_pose", "blade 3"), ("delete_pose", "inspect")]
    assert not any(DEAD_MAN in controls.buttons for _, _, controls in session.received)


@pytest.mark.parametrize(
    ("robot", "missing"),
    [
        ("cobra", set()),
        ("cobra-active", {"twist", "twist-left", "twist-right", "feed"}),
        ("cobra-twist-feed", {"stick-left", "stick-right", "section-1"}),
        ("src-bot", {"twist", "twist-left", "twist-right", "feed", "stick-right", "section-1"}),
    ],
)
def test_what_a_robot_does_not_have_has_no_control_and_no_bar(
    page: Any, session: FakeSession, robot: str, missing: set[str]
) -> None:
    description = load_description(robot)
    parts = (
        "twist",
        "feed",
        "twist-left",
        "twist-right",
        "feed-in",
        "feed-out",
        "stick-left",
        "stick-right",
        "section-1",
    )
    session.facts = {
        "modes": [guide_state(guide) for guide in guides(description)],
        "bending": list(description.active_sections),
        "hand_fed": description.hand_fed,
        "limits": {
            "twist_deg": description.twist and description.twist.range_deg,
            "feed_mm": description.feed and (0.0, 1000.0),
            "length_mm": None,
        },
    }
    page.reload()
    expect(page.get_by_test_id("state")).to_have_text("Ready")
    for part in parts:
        expect(page.get_by_test_id(part)).to_be_visible(visible=part not in missing)
    expect(page.locator("#feed-value")).to_be_visible(visible=bool(description.feed or description.hand_fed))


def test_the_length_fed_by_hand_is_typed_in_and_waits_for_the_dead_man(page: Any, session: FakeSession) -> None:
    session.facts = {"hand_fed": True}
    page.reload()
    choose(session, "section", hand_feed={"told_mm": 250.0, "used_mm": 300.0, "source": "number"})
    button = page.get_by_test_id("hand-feed")
    expect(button).to_have_text("Fed by hand: 300, told 250 mm")
    button.click()
    page.get_by_test_id("hand-feed-length").fill("240,5")
    page.get_by_test_id("hand-feed-confirm").click()
    session.wait(lambda: session.texts == ["240,5"])
    assert session.requests == ["hand_feed"]


def test_c_is_the_clutch_and_m_and_v_choose_mode_and_view(page: Any, session: FakeSession) -> None:
    page.keyboard.down("Space")
    page.keyboard.down("KeyC")
    session.wait(lambda: is_at(session, buttons=HELD | {"a"}))
    page.keyboard.up("KeyC")
    page.keyboard.up("Space")
    page.keyboard.press("m")
    page.keyboard.press("v")
    session.wait(lambda: [(what, value) for _, what, value in session.acts] == [("mode", 1), ("frame", 1)])
