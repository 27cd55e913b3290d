"""The replay's page and the catalogue's in a real browser: what an operator does with a recording."""

import json
import re
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from app.console.front_door import FrontDoor
from app.console.recordings_page import recordings_routes
from app.people.sessions import Sessions
from app.people.users import Users
from app.recording import storage
from app.recording.player import Player
from app.recording.reader import Recording
from app.recording.replay import start_server
from cobra.clock import SystemClock
from cobra.messages import Event
from tests.page_fakes import FakeSession
from tests.recordings import START_S, facts, write

expect = pytest.importorskip("playwright.sync_api").expect

EVENTS = [
    Event(stamp=START_S + 2.0, level="alarm", text="STOP by ada"),
    Event(stamp=START_S + 0.5, level="marker", text="blade 7"),
]
OLD, NEW = "2026-01-01_08-00-00_cobra.mcap", "2026-01-02_08-00-00_cobra.mcap"


# ---------------------------------------------------------------- the replay


@pytest.fixture(scope="module")
def motions(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two recordings of the same motion, the second shorter."""
    folder = tmp_path_factory.mktemp("motions")
    for name, seconds in (("a", 4.0), ("b", 3.0)):
        write(folder / f"{name}.mcap", seconds, events=EVENTS)
    return sorted(folder.iterdir())


@pytest.fixture
def player(motions: list[Path]) -> Iterator[Player]:
    with ExitStack() as stack:
        yield Player([stack.enter_context(Recording(path)) for path in motions], SystemClock())


@pytest.fixture
def replay(tab: Any, player: Player, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    with ExitStack() as stack:
        server = start_server(player, 0, stack)
        # The 3D view, which a browser without a GPU draws slowly, has tests of its own.
        tab.route("**/viewer/**", lambda route: route.fulfill(body=""))
        tab.goto(server.url)
        expect(tab.get_by_test_id("phase")).to_have_text("Ready")
        yield tab


def at(page: Any, seconds: str) -> None:
    expect(page.get_by_test_id("clock")).to_have_text(re.compile(rf"^{re.escape(seconds)} / 0:04\.0$"))


def test_a_recording_is_played_hurried_paused_and_set(replay: Any, player: Player) -> None:
    at(replay, "0:00.0")
    replay.get_by_test_id("speed").select_option("10")
    replay.get_by_test_id("play").click()
    at(replay, "0:04.0")
    assert player.speed == 10.0
    expect(replay.get_by_test_id("play")).to_have_text("Play")
    replay.keyboard.press("ArrowLeft")
    at(replay, "0:00.0")
    replay.get_by_test_id("speed").select_option("0.1")
    replay.locator("body").press("Space")
    expect(replay.get_by_test_id("play")).to_have_text("Pause")
    replay.get_by_test_id("play").click()
    expect(replay.get_by_test_id("play")).to_have_text("Play")
    assert not player.playing
    assert player.time_s > 0.0


def test_the_time_line_shows_what_the_robot_did_and_goes_where_it_is_pointed(replay: Any, player: Player) -> None:
    line = replay.get_by_test_id("line")
    box = line.bounding_box()
    replay.mouse.click(box["x"] + box["width"] / 2, box["y"] + 30)
    at(replay, "0:02.0")
    expect(replay.get_by_test_id("phase")).to_have_text("Driving")
    expect(replay.get_by_test_id("driver")).to_have_text("ada")
    expect(line).to_have_attribute("aria-valuenow", "2.0")
    ticks = line.locator(".tick")
    assert [tick.get_attribute("class") for tick in ticks.all()] == ["tick marker", "tick alarm"]
    # A second of ready, then driving: the band of phases at the bottom has the colours of the legend.
    for share, word in ((0.12, "ready"), (0.6, "driving")):
        painted = replay.evaluate(
            """share => { const c = document.getElementById("curves");
              return [...c.getContext("2d").getImageData(share * c.width, c.height - 4, 1, 1).data.slice(0, 3)].join(); }""",
            share,
        )
        legend = replay.evaluate(
            "word => getComputedStyle(document.querySelector(`.k.${word}`), '::before').backgroundColor", word
        )
        assert painted == ",".join(re.findall(r"\d+", legend)[:3]), word
    events = replay.get_by_test_id("events").locator("li")
    expect(events).to_have_text(["0:00.5blade 7", "0:02.0STOP by ada"])
    expect(events.nth(1).locator("button")).to_have_class("past")
    events.nth(0).click()
    at(replay, "0:00.5")
    expect(events.nth(1).locator("button")).not_to_have_class("past")


def test_two_recordings_lie_over_each_other_and_can_be_moved(replay: Any, player: Player) -> None:
    player.seek(2.0)
    expect(replay.get_by_test_id("apart")).to_have_text(re.compile(r"^\s*0\.0 mm$"))
    replay.get_by_test_id("offset").fill("0.5")
    replay.keyboard.press("Enter")
    expect(replay.get_by_test_id("apart")).to_have_text(re.compile(r"^\s*[1-9][\d.]* mm$"))
    assert player.offset_s == -0.5
    replay.get_by_test_id("align").click()
    expect(replay.get_by_test_id("offset")).to_have_value("0")
    player.seek(3.9)
    expect(replay.get_by_test_id("apart")).to_have_text("not there")


def test_what_is_wrong_with_a_recording_is_told_on_the_page(tab: Any, tmp_path: Path) -> None:
    write(tmp_path / "a.mcap", 1.0, given=facts(text="nonsense ["))
    whole = (tmp_path / "a.mcap").read_bytes()
    (tmp_path / "a.mcap").write_bytes(whole[:-8])
    with ExitStack() as stack:
        recording = stack.enter_context(Recording(tmp_path / "a.mcap"))
        tab.goto(start_server(Player((recording,), SystemClock()), 0, stack).url)
        expect(tab.get_by_test_id("warnings").locator("li")).to_have_count(2)
        expect(tab.get_by_test_id("warnings")).to_contain_text("was not closed")
        expect(tab.locator("#no-view")).to_be_visible()
        expect(tab.get_by_test_id("offset")).to_be_hidden()


# ---------------------------------------------------------------- the operator's page


def test_the_operator_is_told_when_the_disk_refuses_and_what_was_lost(tab: Any) -> None:
    session = FakeSession()
    tab.route("**/viewer/**", lambda route: route.fulfill(body=""))
    with FrontDoor("127.0.0.1", 0, 1, session) as door:
        tab.goto(door.url)
        shown = tab.get_by_test_id("recording")
        expect(shown).to_have_text("Not recorded")
        for problem, lost, words in (
            ("", 0, "Recording"),
            ("the disk has taken nothing for 3 s", 0, "the disk has taken nothing for 3 s"),
            ("", 120, "Recording; 120 messages lost"),
        ):
            session.changes["recording"] = {"name": "a.mcap", "problem": problem, "megabytes": 1.0, "lost": lost}
            expect(shown).to_have_text(words)
        tab.keyboard.press("n")
        tab.keyboard.type("blade 7")
        tab.keyboard.press("Enter")
        session.wait(lambda: "mark" in session.requests)
        assert session.texts[session.requests.index("mark")] == "blade 7"


# ---------------------------------------------------------------- the catalogue


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    folder = tmp_path_factory.mktemp("recorded")
    write(folder / OLD, 0.2)
    write(folder / NEW, 0.2, events=[Event(stamp=START_S + 0.1, level="alarm", text="STOP by vic")])
    return {name: (folder / name).read_bytes() for name in (OLD, NEW)}


@pytest.fixture
def folder(recorded: dict[str, bytes], tmp_path: Path) -> Path:
    for name, content in recorded.items():
        (tmp_path / name).write_bytes(content)
    return tmp_path


@pytest.fixture
def sessions(tab: Any, folder: Path) -> Iterator[Any]:
    with FrontDoor("127.0.0.1", 0, 1, FakeSession(), recordings_routes(folder)) as door:
        tab.goto(f"{door.url}sessions")
        expect(rows(tab)).to_have_count(2)
        yield tab


def rows(page: Any) -> Any:
    return page.locator("#rows tr")


def row(page: Any, name: str) -> Any:
    return page.locator(f'#rows tr[data-name="{name}"]')


def test_sessions_are_searched_as_one_types(sessions: Any) -> None:
    expect(rows(sessions).first).to_contain_text("STOP by vic")
    sessions.get_by_test_id("text").fill("vic")
    expect(rows(sessions)).to_have_count(1)
    sessions.get_by_test_id("text").fill("")
    expect(rows(sessions)).to_have_count(2)
    sessions.get_by_test_id("alarms-only").check()
    expect(rows(sessions)).to_have_count(1)
    sessions.get_by_test_id("since").fill("2027-01-01")
    expect(sessions.get_by_text("No session fits.")).to_be_visible()


def test_a_session_is_marked_annotated_downloaded_and_deleted(sessions: Any, folder: Path) -> None:
    old = row(sessions, OLD)
    old.locator(".star").click()
    expect(old.locator(".star")).to_have_text("★")
    expect(old.get_by_text("Delete")).to_be_disabled()
    old.locator("input").fill("stuck at blade 7")
    sessions.keyboard.press("Enter")
    expect(old.locator("input")).not_to_be_focused()
    sessions.reload()
    expect(row(sessions, OLD).locator("input")).to_have_value("stuck at blade 7")
    assert json.loads(next(folder.glob("*.notes.json")).read_text()) == {"marked": True, "note": "stuck at blade 7"}
    with sessions.expect_download() as download:
        row(sessions, NEW).get_by_text("Download").click()
    assert download.value.path().read_bytes() == (folder / NEW).read_bytes()
    row(sessions, NEW).get_by_text("Delete").click()
    sessions.get_by_text("Keep it").click()
    assert (folder / NEW).exists()
    row(sessions, NEW).get_by_text("Delete").click()
    sessions.get_by_test_id("delete-confirm").click()
    expect(rows(sessions)).to_have_count(1)
    assert not (folder / NEW).exists()


def test_a_viewer_is_shown_what_there_is_and_nothing_to_change_it(tab: Any, folder: Path) -> None:
    users = Users(folder / "users.json")
    token = users.add("vic", "viewer")
    with FrontDoor("127.0.0.1", 0, 1, FakeSession(), recordings_routes(folder), sessions=Sessions(users, "me")) as door:
        tab.goto(f"{door.url}sessions")
        tab.fill("#name", "vic")
        tab.fill("#token", token)
        tab.get_by_test_id("sign-in").click()
        tab.goto(f"{door.url}sessions")
        expect(rows(tab)).to_have_count(2)
        for control in ("button", "input"):
            for element in rows(tab).locator(control).all():
                expect(element).to_be_disabled()


def test_a_session_that_is_recorded_now_says_so(sessions: Any, folder: Path) -> None:
    with (folder / NEW).open("ab") as file:
        storage.lock(file.fileno())
        sessions.reload()
        expect(row(sessions, NEW)).to_contain_text("recording")
        expect(row(sessions, NEW).get_by_text("Delete")).to_be_disabled()
