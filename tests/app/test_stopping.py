"""A STOP is said until the robot confirms it, whatever the link loses."""

import threading

import pytest
import zenoh

from app.link import stopping
from app.link.stopping import MAX_AT_ONCE, Stopping
from cobra.messages import Drives, RobotState, Stop, decode
from tests.stack import wait_for


class LossyRobot:
    """Hears only the messages from number `first` on, and confirms those."""

    def __init__(self, first: int = 0) -> None:
        self.first = first
        self.sent: list[Stop] = []
        self.state: RobotState | None = None

    def put(self, data: bytes) -> None:
        self.sent.append(decode(data, Stop))
        if len(self.sent) > self.first:
            lists = ("travel", "setpoint", "velocity", "load", "temperature", "voltage", "age", "valid", "fault")
            drives = Drives(**dict.fromkeys(lists, ()))
            marks = tuple(dict.fromkeys(stop.press for stop in self.sent[self.first :]))
            self.state = RobotState(robot="r", stamp=0.0, tick=0, phase="stopped", drives=drives, stops=marks)


@pytest.mark.parametrize("lost", [0, 1, 7])
def test_it_is_said_until_it_is_confirmed_and_then_no_more(lost):
    robot = LossyRobot(first=lost)
    confirmed = Stopping(robot.put, lambda: robot.state).say("ann", "smoke")
    assert robot.sent, "the first leaves at once"
    assert confirmed.result(5) is True
    wait_for("it to be silent", _silent)
    assert lost < len(robot.sent) <= lost + 3
    assert {(stop.who, stop.reason, stop.press) for stop in robot.sent} == {("ann", "smoke", robot.sent[0].press)}


def test_every_press_is_a_stop_of_its_own():
    robot = LossyRobot()
    saying = Stopping(robot.put, lambda: robot.state)
    for _ in range(2):
        assert saying.say("ann", "").result(5)
    assert len({stop.press for stop in robot.sent}) == 2


def test_who_pressed_is_told_when_nobody_confirms_and_it_is_said_on(monkeypatch):
    monkeypatch.setattr(stopping, "CONFIRM_S", 0.1)
    robot = LossyRobot(first=10**6)
    confirmed = Stopping(robot.put, lambda: robot.state).say("ann", "")
    assert confirmed.result(5) is False
    told = len(robot.sent)
    wait_for("more", lambda: len(robot.sent) > told + 3)
    robot.first = 0
    wait_for("it to be silent", _silent)


def test_a_link_that_closes_under_it_does_not_end_it():
    robot = LossyRobot()

    def put(data: bytes) -> None:
        robot.put(data)
        if len(robot.sent) < 3:
            robot.state = None
            raise zenoh.ZError("closed")

    assert Stopping(put, lambda: robot.state).say("ann", "").result(5) is True


def test_a_flood_stays_bounded(monkeypatch):
    monkeypatch.setattr(stopping, "GIVE_UP_S", 0.3)
    robot = LossyRobot(first=10**6)
    saying = Stopping(robot.put, lambda: robot.state)
    for _ in range(1000):
        saying.say("eve", "")
    assert len({stop.press for stop in robot.sent}) == MAX_AT_ONCE
    wait_for("it to give up", _silent)
    saying.say("ann", "")
    assert robot.sent[-1].who == "ann", "and then it works as before"
    wait_for("it to give up", _silent)


def _silent() -> bool:
    return not any(thread.name == "stop" for thread in threading.enumerate())
