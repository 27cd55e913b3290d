"""Claims about the replay: it shows what was recorded, and there is no way from it to a motor."""

import json
import re
import subprocess
import sys
from contextlib import ExitStack

import httpx
import pytest
from websockets.sync.client import connect

from app.cli import main
from app.recording.player import Player
from app.recording.reader import Recording
from app.recording.replay import start_server
from cobra.clock import SystemClock
from cobra.messages import Event
from tests.recordings import START_S, moving, write

ALARM = Event(stamp=START_S + 2.0, level="alarm", text="STOP by ada")

NO_WAY_TO_A_MOTOR = """
import socket, sys, threading
from contextlib import ExitStack
from pathlib import Path
opened = []
def watch(event, arguments):
    if event == "socket.bind" or event == "socket.connect":
        opened.append(arguments[1])
    elif event == "open" and str(arguments[0]).startswith("/dev/") and "null" not in str(arguments[0]):
        opened.append(arguments[0])
sys.addaudithook(watch)
from app.recording.reader import Recording
from app.cli import main
from app.recording.player import Player
from app.recording.replay import start_server
from cobra.clock import SystemClock
with ExitStack() as stack:
    recordings = [stack.enter_context(Recording(Path(name))) for name in sys.argv[1:]]
    player = Player(recordings, SystemClock())
    server = start_server(player, 0, stack)
    player.play()
    import time
    deadline = time.monotonic() + 20
    while player.time_s < 1.0 and time.monotonic() < deadline:
        time.sleep(0.01)
    player.seek(2.0)
    assert player.state() is not None and player.other_state() is not None
ways = ("can", "serial", "canopen", "zenoh", "app.link", "app.robot_process", "cobra.simulation.drives",
        "cobra.control.loop", "cobra.control.drivetrain", "cobra.motors", "app.console.driver", "app.console.pilot")
loaded = [name for name in sys.modules if any(name == way or name.startswith(way + ".") for way in ways)]
assert not loaded, f"loaded: {loaded}"
strange = [where for where in opened if not (isinstance(where, tuple) and where[0] in ("127.0.0.1", "localhost"))]
assert not strange, f"opened: {strange}"
print("nothing opened but loopback")
"""


def test_a_replay_opens_no_bus_and_does_not_even_load_what_could(tmp_path):
    for name in "ab":
        write(tmp_path / f"{name}.mcap", 3.0)
    done = subprocess.run(
        [sys.executable, "-c", NO_WAY_TO_A_MOTOR, str(tmp_path / "a.mcap"), str(tmp_path / "b.mcap")],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    assert "nothing opened but loopback" in done.stdout


@pytest.fixture
def page(tmp_path):
    """A replay of two recordings, the second a little ahead, and its websocket."""
    write(tmp_path / "a.mcap", 4.0, events=[ALARM])
    write(tmp_path / "b.mcap", 4.0, change=lambda s: moving(s.stamp - START_S + 0.2, stamp=s.stamp, tick=s.tick))
    with ExitStack() as stack:
        recordings = [stack.enter_context(Recording(tmp_path / f"{name}.mcap")) for name in "ab"]
        server = start_server(Player(recordings, SystemClock()), 0, stack)
        yield stack.enter_context(visit(server))


def visit(server):
    """The page's websocket, with the cookie that its page gave."""
    cookies = "; ".join(f"{name}={value}" for name, value in httpx.get(server.url).cookies.items())
    url, origin = server.url.replace("http", "ws") + "replay", server.url.rstrip("/")
    return connect(url, origin=origin, additional_headers={"Cookie": cookies})


def until(page, condition):
    for _ in range(200):
        message = json.loads(page.recv(10))
        if condition(message):
            return message
    raise AssertionError("it did not come")


def test_the_page_gets_the_time_line_and_what_was_there_at_a_time(page):
    facts = json.loads(page.recv(10))
    first = facts["recordings"][0]
    assert first["duration"] == pytest.approx(3.98)
    assert [(event["level"], event["text"]) for event in first["events"]] == [("alarm", "STOP by ada")]
    assert [span["what"] for span in first["phases"]] == ["ready", "driving"]
    page.send(json.dumps({"what": "seek", "value": 2.5}))
    shown = until(page, lambda m: m["t"] == 2.5)
    assert (shown["phase"], shown["driver"], shown["playing"]) == ("driving", "ada", False)
    assert shown["other"]["apart_mm"] > 1.0


def test_two_of_the_same_moved_against_each_other_are_one(page):
    page.send(json.dumps({"what": "seek", "value": 2.0}))
    page.send(json.dumps({"what": "offset", "value": -0.2}))
    shown = until(page, lambda m: m.get("offset") == -0.2)
    assert shown["other"]["apart_mm"] == pytest.approx(0.0, abs=1e-6)


def test_playing_goes_on_and_nonsense_is_passed_over(page):
    page.send("{nonsense")
    page.send(json.dumps({"what": "arm", "value": 1}))
    page.send(json.dumps({"what": "speed", "value": 10.0}))
    page.send(json.dumps({"what": "play"}))
    until(page, lambda m: m.get("playing") and m["t"] > 1.0)
    ended = until(page, lambda m: m.get("t", 0.0) > 3.9 and not m["playing"])
    assert ended["t"] == pytest.approx(3.98)


def test_a_recording_without_description_is_played_without_a_view(tmp_path):
    from tests.recordings import facts

    write(tmp_path / "a.mcap", 1.0, given=facts(text="nonsense ["))
    with ExitStack() as stack:
        recording = stack.enter_context(Recording(tmp_path / "a.mcap"))
        server = start_server(Player((recording,), SystemClock()), 0, stack)
        page = stack.enter_context(visit(server))
        told = json.loads(page.recv(10))
        assert told["view"] is False
        assert any("no 3D view" in warning for warning in told["recordings"][0]["warnings"])
        assert until(page, lambda m: m["type"] == "snapshot")["phase"] == "ready"


@pytest.mark.parametrize(
    "command", [["replay"], ["recover"], ["export"], ["--no-open", "--port", "0", "--drive-from"]], ids=lambda c: c[-1]
)
def test_what_is_no_recording_is_one_line_and_exit_status_2(tmp_path, command, capsys, monkeypatch):
    monkeypatch.setenv("COBRA_TELEOP_RUNTIME_DIR", str(tmp_path))
    (tmp_path / "x.mcap").write_text("tick,phase\n")
    for name, words in (("x.mcap", "not a recording: it does not begin"), ("none.mcap", "there is no such file")):
        with pytest.raises(SystemExit) as ended:
            main([*command, str(tmp_path / name)])
        assert ended.value.code == 2
        told = capsys.readouterr().err
        assert re.fullmatch(rf"cobra-teleop: .*{name}: {words}.*\n", told), told


def test_of_a_truncated_file_what_is_whole_is_exported_and_a_line_says_the_rest(tmp_path, capsys):
    write(tmp_path / "a.mcap", 2.0)
    whole = (tmp_path / "a.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[:-5000])
    with pytest.raises(SystemExit) as ended:
        main(["export", str(tmp_path / "cut.mcap"), "--to", "csv", "--channels", "state.tick"])
    assert ended.value.code == 0
    told = capsys.readouterr()
    assert "cut.mcap was not closed" in told.err
    assert told.out == f"{tmp_path / 'cut' / 'state.csv'}\n"
    assert len((tmp_path / "cut" / "state.csv").read_text().splitlines()) == 101
