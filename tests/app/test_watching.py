"""Claims about consoles that watch: they see every robot, may STOP, and can do nothing else, whatever is sent to them."""

import contextlib
import json
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import msgspec
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from app.link.access import DIRECT
from app.link.robot_end import RobotLink
from app.people.sessions import Sessions
from app.people.users import Users
from app.runtime import any_free_port
from app.watching.feeds import Feed, WatchedRobot
from app.watching.room import Rooms
from app.watching.wall import wall_of
from app.watching.watch_door import WatchDoor
from cobra.description import RobotDescription
from cobra.kinematics.configuration import Configuration
from cobra.loading import description_text, load_description
from cobra.messages import Drives, Event, Lease, Meta, Reply, RobotState, Stop, decode
from tests.stack import wait_for


class Robot:
    """A robot that publishes 50 states a second on a link of its own and counts what it is told."""

    def __init__(self, name: str, endpoint: str | None = None) -> None:
        self.name = name
        self.endpoint = endpoint or f"tcp/127.0.0.1:{any_free_port()}"
        self.description = load_description("cobra-twist-feed")
        self.got: Counter[str] = Counter()
        self.stops: list[Stop] = []
        text = description_text("cobra-twist-feed").replace('name = "cobra-twist-feed"', f'name = "{name}"', 1)
        self.link = RobotLink(name, self.endpoint, Meta(description=text, versions={"cobra-teleop": "0"}, pid=1))
        self.state = state_of(self.description, name)
        self._quit = threading.Event()
        self._thread = threading.Thread(target=self._run)

    def __enter__(self) -> "Robot":
        self.link.start(lambda data: self._count("command"), self._stop, self._request)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._quit.set()
        self._thread.join()
        self.link.stop()

    def _run(self) -> None:
        while not self._quit.wait(0.02):
            presses = tuple(stop.press for stop in self.stops[-8:])
            self.state = msgspec.structs.replace(
                self.state, tick=self.state.tick + 1, stamp=self.state.stamp + 0.02, stops=presses
            )
            self.link.publish_state(self.state)

    def _count(self, what: str) -> None:
        self.got[what] += 1

    def _stop(self, data: bytes) -> None:
        stop = decode(data, Stop)
        if stop.press not in {known.press for known in self.stops}:
            self.stops.append(stop)

    def _request(self, data: bytes, answer: Callable[[Reply], None]) -> None:
        self._count("request")
        answer(Reply(ok=True))


def state_of(description: RobotDescription, name: str) -> RobotState:
    q = tuple(Configuration(description).rest().tolist())
    n = len(description.drives)
    zeros = (0.0,) * n
    drives = Drives(
        travel=zeros,
        setpoint=zeros,
        velocity=zeros,
        load=zeros,
        temperature=zeros,
        voltage=zeros,
        age=zeros,
        valid=(True,) * n,
        fault=("",) * n,
    )
    lease = Lease(holder="ann", since=1.0, fresh=True)
    return RobotState(
        robot=name, stamp=10.0, tick=1, phase="driving", commanded=q, measured=q, drives=drives, lease=lease
    )


class House:
    """A console that watches `endpoints`."""

    def __init__(self, endpoints: list[str], users: Users | None = None) -> None:
        self.robots: dict[str, WatchedRobot] = {}
        self.feeds = [Feed(endpoint, self.robots, DIRECT) for endpoint in endpoints]
        self.rooms = Rooms(self.robots, 10.0)
        sessions = Sessions(users, "host", most="viewer")
        self.door = WatchDoor("127.0.0.1", 0, self.robots, self.feeds, self.rooms, sessions=sessions)

    def __enter__(self) -> "House":
        for feed in self.feeds:
            feed.start()
        self.door.start()
        self.client = httpx.Client(base_url=self.door.url, follow_redirects=True)
        self.client.get("/")
        return self

    def __exit__(self, *_: object) -> None:
        self.client.close()
        self.door.stop()
        self.rooms.stop()
        for feed in self.feeds:
            feed.stop()

    def socket(self, path: str, **options: Any) -> Any:
        cookies = "; ".join(f"{name}={value}" for name, value in self.client.cookies.items())
        url = self.door.url.replace("http", "ws").rstrip("/")
        return connect(url + path, origin=self.door.url.rstrip("/"), additional_headers={"Cookie": cookies}, **options)

    def tile(self, name: str) -> dict[str, Any]:
        return next(dict(tile) for tile in wall_of(self.robots, self.feeds)["robots"] if tile["name"] == name)


@pytest.fixture(scope="module")
def robots() -> Iterator[tuple[Robot, Robot]]:
    with Robot("left") as left, Robot("right") as right:
        yield left, right


@pytest.fixture
def house(robots: tuple[Robot, Robot]) -> Iterator[House]:
    with House([robot.endpoint for robot in robots]) as house:
        wait_for("both robots", lambda: len(house.robots) == 2 and all(r.latest() for r in house.robots.values()))
        yield house


def test_the_wall_shows_every_robot_with_its_state_driver_and_alarms(house, robots):
    robots[1].link.publish_event(Event(stamp=robots[1].state.stamp, level="alarm", text="tendon N2 is slack"))
    with house.socket("/wall") as socket:

        def told() -> dict[str, Any] | None:
            wall = json.loads(socket.recv())
            alarmed = [tile for tile in wall["robots"] if tile["alarm"]]
            return wall if alarmed and all(tile["present"] for tile in wall["robots"]) else None

        wall = wait_for("the wall", told)
    left, right = wall["robots"]
    assert (left["name"], left["phase"], left["driver"], left["fresh"]) == ("left", "driving", "ann", True)
    assert left["alarms"] == 0
    assert right["alarm"]["text"] == "tendon N2 is slack"
    assert left["since_s"] >= 9.0
    assert wall["troubles"] == []


def test_a_robots_page_tells_its_state_and_takes_nothing_but_stop(house, robots):
    left, right = robots
    before = len(left.stops)
    with house.socket("/robot/left/ws") as socket:
        welcome = json.loads(socket.recv())
        assert (welcome["robot"], welcome["role"]) == ("left", "viewer")
        controls = {
            "type": "controls",
            "seq": 1,
            "stamp": 0.0,
            "echo": json.loads(socket.recv())["stamp"],
            "left": [1, 0],
            "right": [0, 0],
            "lt": 0,
            "rt": 0,
            "buttons": [],
            "held": True,
        }
        answers = {}
        for number, what in enumerate(("arm", "disarm", "home", "clear", "quit", "restart_robot", "section", "stop")):
            socket.send(json.dumps({**controls, "seq": number}))
            socket.send(json.dumps({"type": "act", "id": number, "what": what, "value": 0}))
            while what not in answers:
                message = json.loads(socket.recv())
                if message["type"] == "reply" and message["id"] == number:
                    answers[what] = message
        snapshot = json.loads(socket.recv())
    assert [what for what, answer in answers.items() if answer["ok"]] == ["stop"]
    assert snapshot["phase"] == "driving"
    wait_for("the stop", lambda: len(left.stops) == before + 1)
    assert left.stops[-1].who == "host"
    assert not left.got
    assert not right.got
    assert not right.stops


def test_stop_on_the_wall_reaches_that_robot_and_opens_no_scene(house, robots):
    right = robots[1]
    before = len(right.stops)
    assert house.client.post("/robot/right/stop").json()["ok"]
    wait_for("the stop", lambda: len(right.stops) == before + 1)
    assert house.rooms.get("right") is None
    assert house.client.post("/robot/nobody/stop").status_code == 404


def test_two_ways_of_one_stop_count_once(house, robots):
    before = len(robots[0].stops)
    with house.socket("/robot/left/ws") as socket:
        number = json.loads(socket.recv())["page"].removeprefix("page ")
        socket.send(json.dumps({"type": "act", "id": 7, "what": "stop"}))
        while json.loads(socket.recv())["type"] != "reply":
            pass
        assert house.client.post(f"/robot/left/stop?page={number}&press=7").json()["ok"]
    wait_for("the stop", lambda: len(robots[0].stops) == before + 1)
    assert len(robots[0].stops) == before + 1


def test_a_robot_that_is_not_there_is_refused(house):
    for path in ("/robot/nobody/ws", "/robot/nobody/viewer/"):
        with pytest.raises(InvalidStatus):
            house.socket(path).close()
    assert house.client.get("/robot/nobody/viewer/").status_code == 404


def test_rooms_that_stand_empty_are_closed(house):
    with house.socket("/robot/left/ws") as socket:
        socket.recv()
        house.rooms.close_empty()
        house.rooms.close_empty()
        assert house.rooms.get("left") is not None
    wait_for("the page to be gone", lambda: house.rooms.get("left").visitors == 0)
    house.rooms.close_empty()
    assert house.rooms.get("left") is not None, "somebody may just be reloading"
    house.rooms.close_empty()
    assert house.rooms.get("left") is None


def test_nothing_is_shown_without_a_session(tmp_path, robots):
    users = Users(tmp_path / "users.json")
    users.add("eve", "admin")
    with House([robots[0].endpoint], users) as house:
        wait_for("the robot", lambda: house.robots)
        assert house.client.get("/").url.path == "/sign-in"
        assert house.client.get("/robot/left/").url.path == "/sign-in"
        for path in ("/robot/left/viewer/", "/robot/left/a/", "/static/js/wall.js"):
            assert house.client.get(path).status_code == 401
        assert house.client.post("/robot/left/stop").status_code == 401
        for path in ("/wall", "/robot/left/ws", "/robot/left/viewer/"):
            with pytest.raises(InvalidStatus):
                house.socket(path).close()


def test_robots_may_come_later_go_and_come_back():
    endpoint = f"tcp/127.0.0.1:{any_free_port()}"
    with House([endpoint]) as house:
        wait_for("word of it", lambda: endpoint in wall_of(house.robots, house.feeds)["troubles"][0])
        for _ in range(2):
            with Robot("late", endpoint) as robot:
                wait_for("the robot", lambda: "late" in house.robots and house.tile("late")["fresh"])
                assert wall_of(house.robots, house.feeds)["troubles"] == []
                house.robots["late"].stop("ann", "")
                wait_for("the stop", lambda robot=robot: robot.stops)
            wait_for("it to be gone", lambda: not house.tile("late")["present"])


def test_states_that_cannot_be_read_are_counted_and_the_last_good_one_stays(house, robots):
    seen = WatchedRobot("x", house.feeds[0])
    seen.take_state(msgspec.msgpack.encode(robots[0].state))
    good = seen.latest()
    seen.take_state(b"\xc1")
    assert seen.latest() is good
    assert seen.latest() is good
    assert seen.malformed == 1
    seen.take_event(b"")
    assert seen.malformed == 2


def test_without_robots_here_one_line_says_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from app.runtime import BusyError
    from app.watching.watch import WatchOptions, run_watch

    monkeypatch.setenv("COBRA_TELEOP_RUNTIME_DIR", str(tmp_path))
    with pytest.raises(BusyError, match="--robot"):
        run_watch(WatchOptions())


def test_a_robots_page_can_be_opened_without_the_wall_and_by_strangers_only_after_signing_in(house, robots, tmp_path):
    with httpx.Client(base_url=house.door.url) as bookmark:
        assert bookmark.get("/robot/left/").status_code == 200
        assert bookmark.get("/robot/left/viewer/").status_code == 200
    users = Users(tmp_path / "users.json")
    users.add("vic", "viewer")
    with House([robots[0].endpoint], users) as guarded, httpx.Client(base_url=guarded.door.url) as stranger:
        answer = stranger.get("/robot/left/")
        assert (answer.status_code, answer.headers["location"]) == (303, "/sign-in")
        for path in ("/robot/left/viewer/", "/robot/left/ws", "/robot/left/a/"):
            assert stranger.get(path).status_code == 401, path


@pytest.mark.parametrize(
    "says", [None, "hello", b"\x00" * 70_000, "seen" * 1000], ids=("nothing", "hello", "bytes", "much")
)
def test_a_wall_that_does_not_say_it_reads_is_cut_off_and_others_are_not(house, monkeypatch, says):
    monkeypatch.setattr("app.watching.watch_door.SILENT_S", 0.5)
    with house.socket("/wall") as honest, house.socket("/wall") as silent:
        if says is not None:
            silent.send(says)
        with contextlib.suppress(ConnectionClosed):
            while True:
                honest.recv()
                honest.send("seen")
                silent.recv()
        wait_for("the silent one to be gone", lambda: house.door.walls == 1)
        honest.recv()
    assert house.door.refused["wall does not read: cut off"] == 1
    assert house.door.refused["message from a wall"] == (says is not None)


def test_a_wall_that_takes_nothing_is_cut_off(house, monkeypatch):
    monkeypatch.setattr("app.console.patience.STUCK_S", 0.3)
    monkeypatch.setattr("app.watching.watch_door.WALL_PERIOD_S", 0.0)
    with house.socket("/wall", max_queue=1, close_timeout=0.1):  # and never read
        wait_for("the cut", lambda: house.door.refused["wall does not read: cut off"] == 1)
        wait_for("its end", lambda: house.door.walls == 0)
