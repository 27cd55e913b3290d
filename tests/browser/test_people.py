"""Real people's day in a real browser: sign in, take the controls, drive with keys and a pad, be watched, be stopped."""

import contextlib
from typing import Any

import pytest

from app.people.users import Users
from tests.browser.conftest import PAD, without_scene
from tests.stack import Stack, wait_for

expect = pytest.importorskip("playwright.sync_api").expect

CALM = ("--twin", "ideal", "--frame-rate", "2")


def sign_in(tab: Any, stack: Stack, user: tuple[str, str]) -> None:
    tab.goto(stack.url)
    tab.fill("#name", user[0])
    tab.fill("#token", user[1])
    tab.get_by_test_id("sign-in").click()
    expect(tab.get_by_test_id("user")).to_have_text(f"{user[0]}, {ROLES[user[0]]}")


ROLES = {"anna": "driver", "vic": "viewer", "eve": "admin"}


def driven(stack: Stack, press: Any, release: Any, until: Any) -> None:
    """Press, steer until it holds, let go. A stalled machine makes a press void, as it must: then press again."""
    observer = stack.observer
    assert observer is not None

    def done() -> bool:
        press()
        with contextlib.suppress(AssertionError):
            observer.wait("the bend", until, 6.0)
        release()
        observer.wait("rest", lambda state: state.phase == "ready")
        return bool(until(observer.state))

    wait_for("the bend", done, 90.0)


# Three pages drawn in software need more than two cores: such a machine's stalls end the drive.
@pytest.mark.long
def test_a_drive_by_keys_and_pad_watched_stopped_and_taken_over(chromium: Any, tmp_path: Any) -> None:
    book = Users(tmp_path / "users.json")
    users = {name: (name, book.add(name, role)) for name, role in ROLES.items()}
    tabs = {}
    with Stack(tmp_path, *CALM) as stack:
        stack.start()
        observer = stack.observer
        assert observer is not None

        def page_of(name: str) -> Any:
            context = chromium.new_context(viewport={"width": 1280, "height": 720})
            context.set_default_timeout(60_000)
            without_scene(context)
            if name == "anna":
                context.add_init_script(PAD)
            return context.new_page()

        for name in ("anna", "vic"):
            tabs[name] = page_of(name)
            sign_in(tabs[name], stack, users[name])
        anna, vic = tabs["anna"], tabs["vic"]

        # Nobody drives before somebody takes the controls.
        expect(anna.get_by_test_id("holder")).to_have_text("Nobody has the controls")
        anna.get_by_test_id("controls-acquire").click()
        expect(vic.get_by_test_id("holder")).to_contain_text("anna has the controls")
        expect(anna.get_by_test_id("arm")).to_be_enabled()
        anna.get_by_test_id("arm").click()
        observer.wait("ready", lambda state: state.phase == "ready", 60.0)

        # The viewer has no controls; STOP is there.
        assert not vic.locator(".dock").is_visible()
        assert not vic.get_by_test_id("arm").is_visible()
        assert vic.get_by_test_id("stop").is_enabled()
        refused = vic.evaluate("fetch('/healthz').then((answer) => answer.json())")["counts"]
        assert "controls of somebody who may not drive" not in refused, "its page does not even try"

        # Keys.
        def keys_down() -> None:
            anna.keyboard.down("Space")
            anna.wait_for_timeout(150)
            anna.keyboard.down("d")

        def keys_up() -> None:
            anna.keyboard.up("d")
            anna.keyboard.up("Space")

        driven(stack, keys_down, keys_up, lambda state: state.commanded[2] > 0.15)

        # A pad that nobody chose does nothing; chosen, it drives.
        anna.evaluate("press(4, true)")
        anna.wait_for_timeout(300)
        assert observer.state.phase == "ready"
        anna.evaluate("press(4, false)")
        anna.get_by_test_id("pad-use-here").click()

        def pad_down() -> None:
            anna.evaluate("press(4, true)")
            anna.wait_for_timeout(150)
            anna.evaluate("thePad.axes[0] = -0.9")

        def pad_up() -> None:
            anna.evaluate("press(4, false); thePad.axes[0] = 0")

        driven(stack, pad_down, pad_up, lambda state: state.commanded[2] < 0.05)

        def pad_drives() -> bool:
            """A press while the machine stalls is void: then a person presses again."""
            anna.evaluate("press(4, false)")
            anna.wait_for_timeout(150)
            anna.evaluate("press(4, true)")
            with contextlib.suppress(AssertionError):
                observer.wait("driving", lambda state: state.phase == "driving", 2.0)
            return observer.state.phase == "driving"

        # Away from the page, everything is let go: the tab is hidden while the pad is held.
        wait_for("the drive", pad_drives, 60.0)
        anna.evaluate(
            "Object.defineProperty(document, 'hidden', { value: true, configurable: true });"
            "document.dispatchEvent(new Event('visibilitychange'))"
        )
        observer.wait("let go", lambda state: state.phase == "ready", 5.0)
        anna.evaluate("Object.defineProperty(document, 'hidden', { value: false, configurable: true })")
        anna.wait_for_timeout(200)
        assert observer.state.phase == "ready", "it must be let go and pressed anew"
        anna.evaluate("press(4, false)")

        # Unplugged in the middle of a drive.
        anna.wait_for_timeout(100)
        wait_for("the drive", pad_drives, 60.0)
        anna.evaluate("thePad.connected = false")
        observer.wait("let go", lambda state: state.phase != "driving", 5.0)
        anna.evaluate("thePad.connected = true")
        anna.wait_for_timeout(200)
        assert observer.state.phase == "ready", "a pad that comes back does not take over"

        # The viewer stops; everybody hears who.
        vic.get_by_test_id("stop").click()
        observer.wait("stopped", lambda state: state.phase == "stopped")
        expect(anna.get_by_test_id("cause")).to_contain_text("STOP by vic")
        expect(anna.get_by_test_id("alarms")).to_be_visible()
        anna.keyboard.press("k")
        expect(anna.get_by_test_id("alarms")).to_be_hidden()
        expect(anna.get_by_test_id("clear")).to_be_enabled()
        anna.get_by_test_id("clear").click()
        observer.wait("cleared", lambda state: state.phase == "ready" and state.lease.holder == "anna")

        # An administrator takes over in the middle of a drive; not without a reason, which everybody is told.
        vic.context.close()
        eve = tabs["vic"] = page_of("eve")
        sign_in(eve, stack, users["eve"])
        anna.evaluate("thePad.axes[0] = 0; press(4, false)")

        def anna_drives() -> bool:
            keys_up()
            anna.wait_for_timeout(150)
            anna.keyboard.down("Space")
            with contextlib.suppress(AssertionError):
                observer.wait("driving", lambda state: state.phase == "driving", 2.0)
            return observer.state.phase == "driving"

        wait_for("the drive", anna_drives, 60.0)
        eve.get_by_test_id("controls-take").click()
        eve.get_by_test_id("take-confirm").click()
        expect(eve.get_by_test_id("take-confirm")).to_be_visible()
        assert observer.state.lease.holder == "anna"
        eve.get_by_test_id("take-reason").fill("she fell asleep")
        eve.get_by_test_id("take-confirm").click()
        state = observer.wait("the take-over", lambda state: state.lease.holder == "eve")
        assert state.phase != "driving"
        expect(anna.get_by_test_id("holder")).to_contain_text("eve has the controls")
        expect(anna.get_by_test_id("alarms")).to_contain_text("eve took the controls from anna: she fell asleep")
        expect(anna.get_by_test_id("cause")).to_have_text("eve has the controls.")
        anna.locator("#tab-events").click()
        expect(anna.get_by_test_id("events")).to_contain_text("she fell asleep")
        anna.keyboard.up("Space")
        anna.keyboard.down("Space")
        anna.wait_for_timeout(300)
        assert observer.state.phase != "driving", "who lost the controls cannot drive"

        # Who signs out lets go of everything.
        eve.get_by_test_id("sign-out").click()
        expect(eve.get_by_test_id("sign-in")).to_be_visible()
        observer.wait("free again", lambda state: state.lease.holder == "")
        for tab in tabs.values():
            tab.context.close()


def test_a_cut_network_holds_the_robot_and_the_page_says_so(chromium: Any, tmp_path: Any) -> None:
    with Stack(tmp_path, *CALM) as stack:
        stack.start()
        observer = stack.observer
        assert observer is not None
        context = chromium.new_context(viewport={"width": 1280, "height": 720})
        context.set_default_timeout(60_000)
        without_scene(context)
        context.add_init_script(
            "(() => { const Real = WebSocket; window.sockets = [];"
            "window.WebSocket = class extends Real { constructor(...a) { super(...a); sockets.push(this); }"
            "send(data) { if (!window.cut) super.send(data); } }; })();"
        )
        tab = context.new_page()
        tab.goto(stack.url)
        tab.get_by_test_id("arm").click()
        observer.wait("ready", lambda state: state.phase == "ready", 60.0)

        def driving() -> bool:
            tab.keyboard.down("Space")
            with contextlib.suppress(AssertionError):
                observer.wait("driving", lambda state: state.phase == "driving", 2.0)
            if observer.state.phase != "driving":
                tab.keyboard.up("Space")
            return observer.state.phase == "driving"

        wait_for("the drive", driving)
        tab.evaluate("window.cut = true")  # what is sent gets lost; the socket stays open
        observer.wait("held", lambda state: state.phase != "driving", 2.0)
        tab.evaluate("window.cut = false; sockets.at(-1).close()")
        expect(tab.get_by_test_id("alarms")).to_contain_text("connection to the console was lost")
        wait_for("the drive stays ended", lambda: observer.state.phase == "ready")
        context.close()
