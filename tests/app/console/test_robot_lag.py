"""Claims about how far away the robot is taken to be."""

import pytest

from app.console.robot_lag import RobotLag


def stream(
    lag: RobotLag, trip_s: float, count: int = 100, period_s: float = 0.02, first: int = 1, begin_s: float = 0.0
) -> float:
    """A driver's stream to a robot that is `trip_s` away; returns when it ended."""
    now = begin_s
    for sequence in range(first, first + count):
        now += period_s
        accepted = sequence - 1 - int(trip_s / period_s)
        if accepted >= first:
            lag.taken(accepted, begin_s + (accepted - first + 1) * period_s + trip_s)
        lag.sent(sequence, now)
    return now


@pytest.mark.parametrize("trip_s", [0.004, 0.05, 0.3])
def test_it_is_the_round_trip(trip_s: float) -> None:
    lag = RobotLag()
    assert lag.seconds == 0.0, "nothing is known yet"
    stream(lag, trip_s)
    assert lag.seconds == pytest.approx(trip_s, abs=1e-9)


def test_it_follows_a_network_that_gets_slower() -> None:
    lag = RobotLag()
    end_s = stream(lag, 0.01)
    stream(lag, 0.25, first=101, begin_s=end_s)
    assert lag.seconds == pytest.approx(0.25, abs=0.02)


def test_another_lease_begins_anew_and_a_lost_command_counts_for_nothing() -> None:
    lag = RobotLag()
    lag.sent(500, 1.0)
    lag.sent(1, 2.0)
    lag.taken(500, 2.1)
    assert lag.seconds == 0.0
    lag.sent(2, 3.0)
    lag.sent(4, 3.04)
    lag.taken(3, 3.06)
    assert lag.seconds == 0.0, "of number 3 nobody knows when it left"
    lag.taken(4, 3.07)
    assert lag.seconds == pytest.approx(0.03)
