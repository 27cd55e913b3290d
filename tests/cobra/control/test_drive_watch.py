"""What a drive does not tell by itself: near its limits it is called so, blocked or lost it stops the robot."""

import numpy as np

from cobra.control.drive_watch import DriveWatch, Watched
from cobra.loading import load_description
from cobra.messages import Intent
from cobra.motors.bus import Feedback
from cobra.simulation.drives import world_of
from tests.bench import CHANNEL, Bench

D = load_description("cobra")
N = len(D.drives)


def feedback(current: float = 0.2, temperature: float = 30.0, angle: float = 0.0) -> Feedback:
    """Of drives that are fine but for the first."""
    rest = np.zeros(N)
    first = np.eye(N)[0]
    return Feedback(
        angle=angle * first,
        velocity=rest,
        current=rest + current * first,
        temperature=25.0 + (temperature - 25.0) * first,
        voltage=rest + 36.0,
        age=rest,
        valid=np.ones(N, dtype=bool),
        missed=np.zeros(N, dtype=np.int64),
        faults=("",) * N,
    )


def after(seconds: float, told: Feedback, setpoint: np.ndarray | None = None) -> Watched:
    watch = DriveWatch(D)
    for _ in range(round(seconds / 0.01)):
        watched = watch.step(told, setpoint, 0.01)
    return watched


def test_a_drive_near_its_temperature_is_called_hot_before_it_fails() -> None:
    watched = after(0.1, feedback(temperature=72.0))
    assert watched.warnings[0] == "72 °C, limit 80 °C: let it rest"
    assert not any(watched.warnings[1:])
    assert not any(watched.faults)


def test_current_counts_when_it_lasts() -> None:
    setpoint = np.zeros(N)
    assert not any(after(0.1, feedback(current=-4.0), setpoint).warnings), "a short push is none"
    assert after(3.0, feedback(current=3.4), setpoint).warnings[0] == "3.4 A, limit 4 A: is it blocked?"
    assert not any(after(1.5, feedback(current=3.4), setpoint).faults)
    assert "draws all the current it may (4 A)" in after(2.0, feedback(current=-4.0), setpoint).faults[0]


def test_a_drive_that_stays_behind_its_setpoint_does_not_follow() -> None:
    setpoint = np.zeros(N)
    assert not any(after(0.3, feedback(angle=1.0), setpoint).faults)
    assert "does not follow its setpoint" in after(0.6, feedback(angle=1.0), setpoint).faults[0]
    assert not any(after(2.0, feedback(angle=0.4), setpoint).faults)
    assert not any(after(2.0, feedback(angle=1.0), None).faults), "where nothing is commanded nothing is behind"


def test_what_is_not_read_yet_says_nothing() -> None:
    nothing = np.full(N, np.nan)
    told = Feedback(
        nothing, nothing, nothing, nothing, nothing, nothing, np.zeros(N, dtype=bool), np.ones(N, dtype=np.int64),
        ("",) * N,
    )  # fmt: skip
    watched = after(2.0, told, np.zeros(N))
    assert not any(watched.faults + watched.warnings)


def test_a_blocked_drive_stops_the_robot_and_is_named() -> None:
    with Bench(1, twin="ideal") as bench:
        bench.home()
        bench.tick()
        world_of(CHANNEL).servos.stalled.add(0)
        for _ in range(200):
            state = bench.tick(Intent(primary=(0.0, 1.0)))
            if state.phase != "driving" and state.tick > 5 and state.phase != "ready":
                break
        assert state.phase == "fault"
        assert "drive S1: it draws all the current it may" in state.cause
        assert "S1" in D.drives[0].name
        assert state.channels[0].name == "main"
        assert any("no watchdog" in note for note in state.notes)
