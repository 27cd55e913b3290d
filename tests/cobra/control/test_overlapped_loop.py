"""Where the bus needs most of the period: frames go out first, and nobody speaks to the drives while replies are under way."""

from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from cobra.loading import load_description
from cobra.messages import Request, Stop, encode
from tests.obedient_bus import ObedientRobot

COBRA = load_description("cobra")


class Watched(ObedientRobot):
    """What its bus is asked, in order."""

    def __init__(self, rate_Hz: float) -> None:
        super().__init__(replace(COBRA, teleop=replace(COBRA.teleop, loop_rate_Hz=rate_Hz)))
        self.calls: list[str] = []
        for name in ("burst", "gather", "told", "exchange", "disable"):
            self._note(name)
        self.calls.clear()

    def _note(self, name: str) -> None:
        real = getattr(self.bus, name)

        def noted(*given: Any) -> Any:
            self.calls.append("reads" if name == "burst" and given[0] is None else name)
            return real(*given)

        setattr(self.bus, name, noted)

    def asked(self, request: Request | None = None) -> list[str]:
        """Of one tick."""
        self.calls.clear()
        if request is not None:
            self.ask(request)
        else:
            self.tick()
        # How this bus gathers is its own affair.
        return [call for call in self.calls if call != "exchange"]


def test_frames_go_out_before_anything_else_and_requests_wait_until_the_replies_are_in() -> None:
    robot = Watched(275.0)
    assert robot.asked() == ["burst", "told", "gather"]
    assert robot.asked(Request(what="disarm", lease=robot.lease)) == ["burst", "told", "gather", "disable"]
    assert robot.asked() == ["reads", "told", "gather"]
    assert robot.state.phase == "disarmed"


def test_a_robot_on_a_bus_with_time_to_spare_is_told_at_once() -> None:
    robot = Watched(100.0)
    robot.calls.clear()
    robot.tick()
    assert robot.calls == ["exchange"]


def test_it_drives_the_same_way_a_tick_later() -> None:
    fast, slow = Watched(275.0), Watched(100.0)
    for robot in (fast, slow):
        robot.press("section", primary=(0.0, 0.0))
        robot.drive("section", 1.0, primary=(0.5, 0.0))
    assert fast.q == pytest.approx(slow.q, abs=0.01)
    sent = np.array(fast.bus.sent)
    assert np.abs(np.diff(sent, axis=0)).max() < 0.05


def test_a_stop_holds_at_once() -> None:
    robot = Watched(275.0)
    robot.press("section", primary=(0.0, 0.0))
    robot.drive("section", 0.5, primary=(0.5, 0.0))
    robot.loop.inbox.stop(encode(Stop(who="anna")))
    for _ in range(400):
        robot.step()
    rest = robot.bus.angles.copy()
    for _ in range(20):
        robot.step()
    assert robot.state.phase == "stopped"
    assert robot.bus.angles == pytest.approx(rest, abs=1e-6)
