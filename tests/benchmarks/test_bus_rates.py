"""The loop on a bus that takes its time: exact bits at 1 Mbit/s, 14 drives, frames that arbitrate.

pytest -m benchmark -s tests/benchmarks/test_bus_rates.py
"""

import threading
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import msgspec
import numpy as np
import pytest

from cobra.clock import SystemClock
from cobra.control.loop import RobotLoop
from cobra.description import RobotDescription
from cobra.loading import load_description
from cobra.messages import RobotState
from cobra.motors.bus_load import channel_load
from cobra.motors.open_bus import open_bus
from cobra.simulation.drives import world_of
from tests.crowd import Crowd
from tests.page_fakes import cookie_of
from tests.served import Drives
from tests.stack import Page, running

pytestmark = pytest.mark.benchmark

WATCHED_S = 12.0
LATE = 0.5
"""A cycle that begins half a period too late, or whose replies are not all in by its end, counts as late."""


def cobra(rate_Hz: float, **options: Any) -> RobotDescription:
    d = load_description("cobra")
    given = {"twin": "none", "stepping": "inline", "timing": "bit-true", "latency_ms": 0.02, **options}
    bus = msgspec.structs.replace(d.buses[0], options=given)
    return msgspec.structs.replace(d, buses=(bus,), teleop=msgspec.structs.replace(d.teleop, loop_rate_Hz=rate_Hz))


class Result:
    """What a run of the loop showed; times in seconds."""

    def __init__(self, description: RobotDescription, seconds: float) -> None:
        states: list[tuple[float, bool, float]] = []
        starts: list[float] = []
        self.load = 0.0
        self.state: RobotState | None = None

        def keep(state: RobotState) -> None:
            self.state = state
            states.append((state.stamp, all(state.drives.valid), state.channels[0].load))

        clock = SystemClock()
        with open_bus(description, clock) as bus:
            assert bus.enable() == ()
            loop = RobotLoop(description, bus, clock, keep, lambda event: None)
            loop.drivetrain.exchange(None)
            feedback = loop.drivetrain.feedback
            assert feedback is not None
            # Standing setpoints, as while holding: frames are those of driving.
            loop.setpoints.start(feedback)
            loop.supervisor.homed = True
            loop.supervisor.armed()
            tick = loop.tick

            def timed() -> RobotState:
                starts.append(clock.now())
                return tick()

            loop.tick = timed  # type: ignore[method-assign]
            done = threading.Event()
            threading.Timer(seconds, done.set).start()
            runner = threading.Thread(target=loop.run, args=(done,))
            runner.start()
            runner.join()
            self.counts = dict(bus.counts)
            self.world = world_of(description.buses[0].channel)
        warm = int(len(starts) * 0.02) + 5
        self.periods = np.diff(starts[warm:])
        self.answered = np.array([answered for _, answered, _ in states[warm:]])
        self.load = float(np.median([load for _, _, load in states[warm:]]))
        self.nominal = loop.period_s

    @property
    def late(self) -> int:
        return int(np.sum(self.periods > (1 + LATE) * self.nominal) + np.sum(~self.answered))


def test_275_cycles_a_second_for_a_minute(capsys: pytest.CaptureFixture[str]) -> None:
    description = cobra(275.0)
    planned = channel_load(description, description.buses[0])
    limit = description.buses[0].bitrate / planned.setpoint_bits
    r = Result(description, 60.0)
    n = len(r.periods)
    assert r.state is not None
    with capsys.disabled():
        print(
            f"\n14 drives, 1 Mbit/s, setpoints and replies {planned.setpoint_bits} bits: at most {limit:.0f} cycles/s"
        )
        print(
            f"  asked 275 Hz = {275 / limit:.0%}; had {1 / r.periods.mean():.2f} Hz over {r.periods.sum():.1f} s, {n} cycles"
        )
        print(f"  late {r.late} ({r.late / n:.3%}), longest {1e3 * r.periods.max():.2f} ms; bus load {r.load:.1%}")
        print(f"  period p50 {1e3 * np.median(r.periods):.3f}  p99 {1e3 * np.percentile(r.periods, 99):.3f} ms")
        print(
            f"  computation p99 {1e3 * r.state.timing.compute_p99:.2f} ms; real-time {r.state.timing.realtime}; {r.counts}"
        )
    assert n > 1000


def test_100_cycles_a_second_stay_under_60_percent(capsys: pytest.CaptureFixture[str]) -> None:
    r = Result(cobra(100.0), 15.0)
    assert r.state is not None
    jitter = np.abs(r.periods - r.nominal)
    with capsys.disabled():
        print(
            f"\n100 Hz: bus load {r.load:.1%}, late {r.late} of {len(r.periods)}, longest {1e3 * r.periods.max():.2f} ms"
        )
        print(
            f"  jitter p99 {1e3 * np.percentile(jitter, 99):.3f} ms, computation p99 {1e3 * r.state.timing.compute_p99:.2f} ms"
        )
    assert r.load < 0.60


@pytest.mark.parametrize("drives", ["in the robot process", "a process of their own"])
def test_jitter_beside_the_console_and_five_viewers(
    drives: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The program as a user starts it, homed and standing; as with hardware, the drives need not share its process."""
    with ExitStack() as open_now:
        routes: list[str] = []
        if drives == "a process of their own":
            served = Drives(tmp_path, "--slcan", "tcp:0")
            open_now.callback(served.end)
            routes = ["--bus", f"main=slcan:{served.channels['main']}?sleep_after_open=0"]
        stack = open_now.enter_context(running(tmp_path, *routes))
        page = open_now.enter_context(Page(stack.url))
        page.arm()
        open_now.enter_context(Crowd(stack.url, cookie_of(urlsplit(stack.url).port or 0), 5))
        time.sleep(WATCHED_S)  # the loop's timing is of its last seconds
        assert stack.observer is not None
        timing = stack.observer.state.timing
    jitter = timing.period_p99 - 0.01
    with capsys.disabled():
        print(f"\n100 Hz beside console and five viewers, drives {drives}: jitter p99 {1e3 * jitter:.3f} ms, ", end="")
        print(
            f"longest period {1e3 * timing.period_max:.2f} ms, computation p99 {1e3 * timing.compute_p99:.2f} ms, ",
            end="",
        )
        print(f"late {timing.late}, real-time {timing.realtime}")
    assert timing.rate_Hz > 0
