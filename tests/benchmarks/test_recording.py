"""What recording costs and how fast a recording is: 14 drives at 250 Hz, an hour of it. Prints; asserts no time."""

import statistics
import time

import msgspec
import numpy as np
import psutil
import pytest

from app import runtime
from app.link import RobotLink
from app.recording import channels
from app.recording.channels import DESCRIPTION, DIGEST, STATE
from app.recording.digest import Digester
from app.recording.mcap_file import McapFile
from app.recording.reader import Recording
from app.recording.writer import topics
from cobra.messages import Heard, Meta
from tests.app.recording.test_recorder import start_process
from tests.recordings import BEGIN_NS, COBRA, facts, judged, moving
from tests.stack import wait_for

pytestmark = pytest.mark.benchmark
RATE_Hz = 250.0
SECONDS = 12.0


class Publisher:
    """A robot's end of the link, and how long each tick's publishing takes."""

    def __init__(self) -> None:
        self.endpoint = f"tcp/127.0.0.1:{runtime.any_free_port()}"
        self.link = RobotLink(
            "cobra", self.endpoint, Meta(description=facts().attachments[DESCRIPTION].decode(), versions={}, pid=1)
        )
        self.link.start(lambda data: None, lambda data: None, lambda data, answer: None)
        self._states = [moving(i / RATE_Hz, RATE_Hz) for i in range(1000)]
        self.tick = 0

    def run(self, seconds: float) -> list[float]:
        """Publish at the rate; gives the seconds that each tick's publishing took."""
        took, deadline = [], time.monotonic()
        for _ in range(round(seconds * RATE_Hz)):
            now = time.monotonic()
            state = msgspec.structs.replace(self._states[self.tick % 1000], stamp=now, tick=self.tick)
            heard = Heard(commands=(judged(self.tick, 0.0),)) if self.tick % 5 == 0 else None
            begin = time.perf_counter()
            self.link.publish_state(state)
            if heard:
                self.link.publish_heard(heard)
            took.append(time.perf_counter() - begin)
            self.tick += 1
            deadline += 1.0 / RATE_Hz
            time.sleep(max(deadline - time.monotonic(), 0.0))
        return took


def test_recording_costs_the_loop_and_a_core_little(tmp_path):
    robot = Publisher()
    alone = robot.run(SECONDS)
    process = start_process(robot, tmp_path / "a.mcap")
    wait_for("the file", lambda: (robot.run(0.2), (tmp_path / "a.mcap").exists())[1])
    robot.run(3.0)
    watched, size = psutil.Process(process.pid), (tmp_path / "a.mcap").stat().st_size
    cpu, begin = sum(watched.cpu_times()[:2]), time.monotonic()
    recorded = robot.run(SECONDS)
    span = time.monotonic() - begin
    core = (sum(watched.cpu_times()[:2]) - cpu) / span
    grown = ((tmp_path / "a.mcap").stat().st_size - size) / span
    process.terminate()
    process.wait(15)
    robot.link.stop()
    p99 = [float(np.percentile(times, 99)) for times in (alone, recorded)]
    with Recording(tmp_path / "a.mcap") as recording:
        missed = recording.digest.missed
    print(
        f"\nrecording 14 drives at {RATE_Hz:.0f} Hz: publishing takes p50 {1e6 * statistics.median(alone):.0f} -> "
        f"{1e6 * statistics.median(recorded):.0f} us, p99 {1e6 * p99[0]:.0f} -> {1e6 * p99[1]:.0f} us, "
        f"that is {100 * (p99[1] - p99[0]) * RATE_Hz:+.2f} % of the period; recorder {100 * core:.1f} % of a core; "
        f"{60 * grown / 1e6:.1f} MB a minute; {missed} states missed"
    )


def test_an_hour_opens_and_seeks(tmp_path):
    path, rate, step = tmp_path / "hour.mcap", 100.0, 40
    file = McapFile(path, topics(), durable=False)
    file.start({"format": "1", "robot": "cobra", "title": "COBRA"})
    file.attach(DESCRIPTION, "application/toml", facts().attachments[DESCRIPTION], BEGIN_NS)
    encoded = [channels.encode(moving(i / rate, rate)) for i in range(2000)]
    digester = Digester("cobra", COBRA)
    for tick in range(round(3600 * rate)):
        now = BEGIN_NS + round(tick / rate * 1e9)
        file.add(STATE, now, now, encoded[tick % 2000], tick)
        if tick % step == step - 1:
            file.flush()
        if tick % 500 == 0:
            digester.state(moving(tick / rate, rate), now)
    file.attach(DIGEST, "application/json", channels.encode(digester.result()), BEGIN_NS)
    file.finish()
    file.close()
    begin = time.perf_counter()
    with Recording(path) as recording:
        recording.state_at(0.0)
        opened = time.perf_counter() - begin
        seeks = []
        for t in np.random.default_rng(0).uniform(0.0, recording.duration_s, 200):
            begin = time.perf_counter()
            assert recording.state_at(float(t)) is not None
            seeks.append(time.perf_counter() - begin)
    print(
        f"\nan hour at {rate:.0f} Hz ({path.stat().st_size / 1e6:.0f} MB, {3600 * rate / step:.0f} chunks): opened in "
        f"{opened:.2f} s; a seek takes p50 {1e3 * statistics.median(seeks):.1f} ms, longest {1e3 * max(seeks):.1f} ms"
    )
