"""What pages are sent of the robot's state: all of it, or over a slow link only what is new, less often."""

import json

import pytest

from app.console.snapshots import SLOW_PARTS, SLOW_PERIOD_S, Changes, Snapshots
from tests.page_fakes import FakeSession, PageClient


class Robot:
    def __init__(self):
        self.facts = {"phase": "ready", "tip_mm": [1.0, 2.0, 3.0], "drives": [{"load": 1.0}], "events": []}
        self.taken = 0

    def __call__(self):
        self.taken += 1
        return dict(self.facts)


@pytest.fixture
def robot():
    return Robot()


@pytest.fixture
def time():
    return [100.0]


@pytest.fixture
def snapshots(robot, time):
    return Snapshots(robot, lambda: time[0])


def test_one_snapshot_serves_all_who_ask_at_the_same_time(snapshots, robot, time):
    first = snapshots.whole()
    assert snapshots.whole() == first
    assert robot.taken == 1
    time[0] += 0.05
    assert json.loads(snapshots.whole())["stamp"] == pytest.approx(100.05)
    assert robot.taken == 2


def test_the_whole_is_the_same_facts_as_json(snapshots, robot):
    assert json.loads(snapshots.whole()) == {"type": "snapshot", "stamp": 100.0, **robot.facts}


def test_what_a_thin_page_puts_together_is_what_the_others_get(snapshots, robot, time):
    changes, known = Changes(), {}
    for i in range(50):
        time[0] += 0.2
        robot.facts["tip_mm"] = [float(i), 2.0, 3.0]
        robot.facts["phase"] = "driving" if i > 10 else "ready"
        robot.facts["drives"] = [{"load": float(i)}]
        known |= json.loads(changes.since(snapshots.parts(), time[0]))
        whole = json.loads(snapshots.whole())
        assert {name: known[name] for name in whole if name not in SLOW_PARTS} == {
            name: value for name, value in whole.items() if name not in SLOW_PARTS
        }
    time[0] += SLOW_PERIOD_S
    known |= json.loads(changes.since(snapshots.parts(), time[0]))
    assert known == json.loads(snapshots.whole())


def test_a_thin_page_is_not_told_again_what_it_knows(snapshots, robot, time):
    changes = Changes()
    assert set(json.loads(changes.since(snapshots.parts(), time[0]))) == {"type", "stamp", *robot.facts}
    time[0] += 0.2
    assert set(json.loads(changes.since(snapshots.parts(), time[0]))) == {"type", "stamp"}
    robot.facts["drives"] = [{"load": 2.0}]
    robot.facts["phase"] = "fault"
    time[0] += 0.2
    assert set(json.loads(changes.since(snapshots.parts(), time[0]))) == {"type", "stamp", "phase"}
    time[0] += SLOW_PERIOD_S
    assert set(json.loads(changes.since(snapshots.parts(), time[0]))) == {"type", "stamp", "drives"}


def test_a_page_says_that_it_wants_little_and_drives_as_before(
    door, session: FakeSession, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.console.page_socket.SILENCE_S", 10.0)  # a busy machine's stall is not what is meant here
    with PageClient(door.port) as page:
        whole = len(page.snapshot)
        page.send({"type": "pace", "thin": True, "view": "p-x"})
        page.settle()
        page.next("snapshot")
        assert len(page.next("snapshot")) < whole
        page.drive(left=[0, 0])
        page.drive(held=True, left=[1, 0])
        page.settle()
        assert session.held
        page.drive(left=[0, 0])
        page.send({"type": "pace", "thin": False})
        page.settle()
        page.next("snapshot")
        page.next("snapshot")
        page.next("snapshot")
        assert len(page.snapshot) >= whole
    assert not door.counts


@pytest.mark.parametrize("pace", [{"thin": 1}, {}, {"thin": True, "view": "x" * 41}, {"thin": True, "more": 1}])
def test_a_pace_that_is_none_is_counted(door, session, pace):
    with PageClient(door.port) as page:
        page.send({"type": "pace", **pace})
        page.settle()
    assert door.counts["message out of range or of no known kind"] == 1


def test_a_page_is_told_the_consoles_clock_and_so_knows_how_old_its_picture_is(door):
    with PageClient(door.port) as page:
        page.send({"type": "ping", "stamp": 1.0})
        pong = page.next("pong")
        assert pong["now"] >= page.snapshot["stamp"]
        assert pong["behind"] is False
