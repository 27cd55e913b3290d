"""A STOP that is said again counts once; another press counts again, and one that cannot be read is obeyed."""

import pytest

from cobra.clock import ManualClock
from cobra.control.loop import RobotLoop
from cobra.loading import load_description
from cobra.messages import Event, Stop, encode
from tests.cobra.motors.idle_bus import IdleBus


@pytest.fixture
def events() -> list[Event]:
    return []


@pytest.fixture
def loop(events: list[Event]) -> RobotLoop:
    description = load_description("cobra-twist-feed")
    return RobotLoop(description, IdleBus(description), ManualClock(), lambda state: None, events.append)


@pytest.mark.parametrize(
    ("presses", "counted", "told"),
    [
        (("a", "a", "a"), 1, ("a",)),
        (("a", "b", "a"), 2, ("a", "b")),
        (("", ""), 2, ()),  # from a program that does not mark them
    ],
)
def test_each_press_counts_once_and_is_confirmed(loop, events, presses, counted, told):
    for press in presses:
        loop.inbox.stop(encode(Stop(who="ann", press=press)))
    state = loop.tick()
    assert state.phase == "stopped"
    assert state.stops == told
    assert sum(event.level == "alarm" for event in events) == counted


def test_one_that_is_heard_again_after_clearing_stops_nothing(loop, events):
    loop.inbox.stop(encode(Stop(who="ann", press="a")))
    loop.tick()
    loop.supervisor.clear()
    loop.inbox.stop(encode(Stop(who="ann", press="a")))
    assert loop.tick().phase != "stopped"


def test_a_damaged_one_is_obeyed_and_counted(loop):
    loop.inbox.stop(b"\xc1")
    state = loop.tick()
    assert state.phase == "stopped"
    assert state.drops["malformed stop (obeyed)"] == 1
