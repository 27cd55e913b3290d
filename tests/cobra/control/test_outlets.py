"""Claims about those who listen to the loop: none of them can end it, and what fails is counted."""

from collections import Counter

import pytest

from cobra.clock import ManualClock
from cobra.control.loop import RobotLoop
from cobra.control.outlets import guarded
from cobra.loading import load_description
from cobra.messages import Stop, encode
from tests.cobra.motors.idle_bus import IdleBus


def test_a_failure_is_counted_and_the_next_call_is_made():
    failures: Counter[str] = Counter()
    heard = []

    def listen(value: int) -> None:
        heard.append(value)
        if value < 3:
            raise KeyError(value)

    call = guarded("listening", listen, failures)
    for value in range(1, 5):
        call(value)
    assert heard == [1, 2, 3, 4]
    assert failures == {"listening failed: KeyError": 2}


@pytest.mark.parametrize("who", ["publish", "announce", "testify"])
def test_a_loop_goes_on_whoever_of_its_listeners_fails(who):
    def fail(value: object) -> None:
        raise RuntimeError("no")

    description = load_description("cobra-twist-feed")
    states = []
    outlets = {"publish": states.append, "announce": lambda event: None, "testify": lambda heard: None, who: fail}
    loop = RobotLoop(description, IdleBus(description), ManualClock(), **outlets)
    loop.inbox.stop(encode(Stop(who="ann")))
    for _ in range(3):
        state = loop.tick()
    assert state.phase == "stopped"
    if who != "testify":  # a recorder is told only when there was something to hear
        assert any("RuntimeError" in reason for reason in state.drops)
