"""What recording costs and how fast a recording is: 14 drives at 250 Hz, an hour of it. Prints; asserts no time."""

import os
import statistics
import subprocess
import sys
import threading
import time
from pathlib import Path

import msgspec
import numpy as np
import psutil
import pytest

from app.recording import channels
from app.recording.channels import COMMAND, DESCRIPTION, DIGEST, STATE
from app.recording.digest import Digester
from app.recording.foxglove import JOINTS, SCENE, FoxgloveView
from app.recording.mcap_file import McapFile
from app.recording.reader import Recording
from app.recording.writer import topics
from app.runtime import Running
from cobra.loading import description_text
from cobra.messages import Command, Intent, Reply, Request
from tests.app.recording.test_recorder import start_process
from tests.recordings import BEGIN_NS, COBRA, facts, judged, moving
from tests.stack import Observer, wait_for

pytestmark = pytest.mark.benchmark
RATE_Hz = 250.0
SECONDS = 8.0
ROUNDS = 4


class Driven:
    """A robot process of its own on its twin, driven to and fro by a stream of commands at 50 Hz."""

    def __init__(self, folder: Path) -> None:
        description = folder / "cobra.toml"
        rate = f"loop_rate_Hz = {RATE_Hz}"
        description.write_text(description_text("cobra").replace("loop_rate_Hz = 100.0", rate), "utf-8")
        command = [sys.executable, "-m", "app", "robot", "--robot", str(description), "--twin", "ideal"]
        places = dict.fromkeys((f"COBRA_TELEOP_{kind}_DIR" for kind in ("RUNTIME", "DATA", "STATE")), str(folder))
        self.process = subprocess.Popen(command, env={**os.environ, **places}, stdout=subprocess.DEVNULL)
        entry = folder / "robot-cobra.json"
        wait_for("the robot process", entry.exists, 60.0)
        self.endpoint = msgspec.json.decode(entry.read_bytes(), type=Running).endpoint
        self.observer = Observer("cobra", self.endpoint)
        self._held, self._done = False, threading.Event()
        self._lease = self.ask("acquire").lease
        self._thread = threading.Thread(target=self._stream, daemon=True)
        self._thread.start()
        wait_for("arming", lambda: self.ask("arm").ok, 60.0)
        self.observer.wait("homing", lambda state: state.phase == "ready", 60.0)

    def ask(self, what: str) -> Reply:
        return self.observer.link.request(Request(what=what, lease=getattr(self, "_lease", ""), who="test"))

    def measured(self, seconds: float) -> tuple[list[float], list[float]]:
        """Drive for so long; gives p99 of what a tick computes and of the period, once a second [s]."""
        self._held = False
        self.observer.wait("ready", lambda state: state.phase == "ready")
        self._held = True
        self.observer.wait("driving", lambda state: state.phase == "driving")
        # The loop's summary looks back 2 s.
        begin, seen = time.monotonic(), {}
        while (spent := time.monotonic() - begin) < seconds:
            timing = self.observer.state.timing
            if spent > 2.0 and self.observer.state.phase == "driving":
                seen[timing.compute_p99] = timing.period_p99
            time.sleep(0.1)
        return list(seen), list(seen.values())

    def cpu_s(self) -> float:
        return sum(psutil.Process(self.process.pid).cpu_times()[:2])

    def close(self) -> None:
        self._done.set()
        self._thread.join()
        self.observer.close()
        self.process.terminate()
        self.process.wait(15)

    def _stream(self) -> None:
        sequence = 0
        while not self._done.wait(0.02):
            sequence += 1
            state = self.observer.state
            # Driven to and fro, so that no limit is reached.
            to = 1.0 if int(state.stamp) % 2 else -1.0
            # After a stall of the machine the robot holds, and wants it let go of before it drives on.
            held = self._held and state.phase in ("ready", "driving")
            intent = Intent(primary=(0.5 * to, 0.3 * to), feed=0.2 * to) if held else Intent()
            command = Command(lease=self._lease, epoch=state.epoch, sequence=sequence, echo=state.stamp,
                              held=held, intent=intent)  # fmt: skip
            self.observer.link.send(command)


def test_recording_costs_the_loop_and_a_core_little(tmp_path):
    robot = Driven(tmp_path)
    alone, recorded, periods, core, extra, size = [], [], ([], []), [], [], []
    try:
        for i in range(ROUNDS):
            before, begin = robot.cpu_s(), time.monotonic()
            work, period = robot.measured(SECONDS)
            alone += work
            periods[0].extend(period)
            idle = (robot.cpu_s() - before) / (time.monotonic() - begin)
            path = tmp_path / f"{i}.mcap"
            process = start_process(robot, path)
            wait_for("the file", path.exists)
            time.sleep(2.0)  # its start is not what is measured
            watched, grown = psutil.Process(process.pid), path.stat().st_size
            own, before, begin = sum(watched.cpu_times()[:2]), robot.cpu_s(), time.monotonic()
            work, period = robot.measured(SECONDS)
            span = time.monotonic() - begin
            recorded += work
            periods[1].extend(period)
            core.append((sum(watched.cpu_times()[:2]) - own) / span)
            extra.append((robot.cpu_s() - before) / span - idle)
            size.append(60.0 * (path.stat().st_size - grown) / span / 1e6)
            process.terminate()
            process.wait(15)
            with Recording(path) as recording:
                assert recording.digest.missed == 0
                assert recording.digest.dropped == 0
    finally:
        robot.close()
    middle = statistics.median
    cost = (middle(recorded) - middle(alone)) * RATE_Hz
    print(
        f"\nrecording 14 drives at {RATE_Hz:.0f} Hz, {ROUNDS} rounds alone and recorded in turn: a tick computes p99 "
        f"{1e3 * middle(alone):.2f} -> {1e3 * middle(recorded):.2f} ms, that is {100 * cost:+.2f} % of the period; "
        f"period p99 {1e3 * middle(periods[0]):.2f} -> {1e3 * middle(periods[1]):.2f} ms; recorder "
        f"{100 * middle(core):.1f} % of a core, robot process {100 * middle(extra):+.1f} %; {middle(size):.1f} MB a minute"
    )


def write_an_hour(path: Path) -> int:
    """An hour at 100 Hz as the recorder writes it: states, commands at 50 Hz, the scene and joints at 20 Hz. Gives the chunks."""
    rate, step = 100.0, 40
    file = McapFile(path, topics(), durable=False)
    file.start({"format": "1", "robot": "cobra", "title": "COBRA"})
    file.attach(DESCRIPTION, "application/toml", facts().attachments[DESCRIPTION], BEGIN_NS)
    states, view = [moving(i / rate, rate) for i in range(2000)], FoxgloveView(COBRA)
    encoded = [channels.encode(state) for state in states]
    scenes = [channels.encode(view.scene(state, BEGIN_NS)) for state in states[::5]]
    joints = [channels.encode(view.joints(state, BEGIN_NS)) for state in states[::5]]
    command = channels.encode(judged(1, 0.0))
    digester = Digester("cobra", COBRA)
    for tick in range(round(3600 * rate)):
        now = BEGIN_NS + round(tick / rate * 1e9)
        file.add(STATE, now, now, encoded[tick % 2000], tick)
        if tick % 2 == 0:
            file.add(COMMAND, now, now, command, tick)
        if tick % 5 == 0:
            file.add(SCENE, now, now, scenes[tick // 5 % 400], tick)
            file.add(JOINTS, now, now, joints[tick // 5 % 400], tick)
        if tick % step == step - 1:
            file.flush()
        if tick % 500 == 0:
            digester.state(moving(tick / rate, rate), now)
    file.attach(DIGEST, "application/json", channels.encode(digester.result()), BEGIN_NS)
    file.finish()
    file.close()
    return round(3600 * rate / step)


def test_an_hour_opens_and_seeks(tmp_path):
    path = tmp_path / "hour.mcap"
    chunks = write_an_hour(path)
    begin = time.perf_counter()
    with Recording(path) as recording:
        recording.state_at(0.0)
        opened = time.perf_counter() - begin
        seeks = []
        for t in np.random.default_rng(0).uniform(0.0, recording.duration_s, 200):
            begin = time.perf_counter()
            assert recording.state_at(float(t)) is not None
            seeks.append(time.perf_counter() - begin)
    begin = time.perf_counter()
    command = [sys.executable, "-m", "app", "replay", str(path), "--no-open", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as replay:
        assert replay.stdout is not None
        assert b"Replay of hour.mcap" in replay.stdout.readline()
        served = time.perf_counter() - begin
        replay.terminate()
    print(
        f"\nan hour at 100 Hz ({path.stat().st_size / 1e6:.0f} MB, {chunks} chunks): opened in {opened:.2f} s, its page "
        f"is served {served:.1f} s after the command; a seek takes p50 {1e3 * statistics.median(seeks):.1f} ms, longest "
        f"{1e3 * max(seeks):.1f} ms"
    )
