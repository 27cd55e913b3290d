"""The main job's numbers in one run: page open in Chromium, scene at 30 Hz, a pad that drives.

pytest -m benchmark -s tests/benchmarks/test_main_job.py
"""

import itertools
import subprocess
import sys
import time
import urllib.request
from pathlib import Path

import can
import numpy as np
import pytest

from cobra.kinematics.compiled import CompiledKinematics
from cobra.loading import load_description
from tests.browser.conftest import ARGUMENTS, CHROMIUM, polite_chromium
from tests.stack import PadStack

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(300)]
TRIALS = 150
POSITION = 0xA4
FIRST_TENDON = 0x141


def test_start_to_a_usable_page(tmp_path):
    """From the command to a page that answers, warm: everything was imported once before."""
    times = []
    for trial in range(3):
        folder = tmp_path / str(trial)
        folder.mkdir()
        with PadStack(folder) as stack:
            begin = time.monotonic()
            stack.start()
            assert urllib.request.urlopen(stack.url, timeout=10).status == 200
            times.append(time.monotonic() - begin)
            stack.end()
    print(f"\ncommand to usable page: {times[0]:.2f} s first, {min(times[1:]):.2f} s warm")


def test_tick_jitter_and_latency(tmp_path):
    if CHROMIUM is None:
        pytest.skip("there is no Chromium on this machine")
    log = tmp_path / "frames.log"
    with PadStack(tmp_path, "--can-log", str(log)) as stack:
        stack.start()
        browser = subprocess.Popen([sys.executable, "-c", _OPEN_PAGE, polite_chromium(tmp_path), stack.url, *ARGUMENTS])
        try:
            presses = _drive(stack)
        finally:
            browser.terminate()
            browser.wait(20)
        timing = stack.observer.state.timing
        stack.end()
    latencies = 1e3 * _latencies(log, presses)
    print(f"\ntick computation: {_ticks_per_second():,.0f} per second (61 points, Jacobian, tendon map)")
    print(
        f"loop period: p50 {1e3 * timing.period_p50:.2f}, p99 {1e3 * timing.period_p99:.2f}, "
        f"max {1e3 * timing.period_max:.2f} ms; real-time scheduling: {timing.realtime}; late in all: {timing.late}"
    )
    print(
        f"stick to frame ({len(latencies)} presses): p50 {np.percentile(latencies, 50):.1f}, "
        f"p99 {np.percentile(latencies, 99):.1f} ms; one tick plus 5 ms is 15 ms"
    )
    print(f"the slowest: {np.sort(latencies)[-6:].round(1)} ms")
    assert len(latencies) == len(presses)


def _drive(stack: PadStack) -> list[float]:
    """Deflect and centre the stick again and again; gives when each deflection happened."""
    stack.arm()
    stack.press_dead_man()
    presses = []
    for i in range(TRIALS):
        before = stack.observer.state.commanded
        presses.append(stack.pad(axis="leftx", value=1.0 if i % 2 else -1.0))
        stack.observer.wait("motion", lambda state, before=before: state.commanded != before)
        stack.pad(axis="leftx", value=0.0)
        stack.observer.wait("rest", _at_rest(stack))
    return presses


def _at_rest(stack: PadStack):
    last = [stack.observer.state]

    def rest(state) -> bool:
        still = state.tick > last[0].tick + 5 and state.commanded == last[0].commanded
        if state.commanded != last[0].commanded:
            last[0] = state
        return still

    return rest


def _latencies(log: Path, presses: list[float]) -> np.ndarray:
    """From each press to the first setpoint frame that differs from the one before [s]."""
    wall = time.time() - time.monotonic()
    frames = [
        (message.timestamp - wall, bytes(message.data[4:8]))
        for message in can.CanutilsLogReader(log)
        if message.arbitration_id == FIRST_TENDON + 1 and message.data[0] == POSITION and not message.is_rx
    ]
    changes = [t for (_, before), (t, now) in itertools.pairwise(frames) if now != before]
    return np.array([next(t for t in changes if t > press) - press for press in presses])


def _ticks_per_second() -> float:
    kinematics = CompiledKinematics(load_description("cobra"))
    kinematics.warm_up()
    q = np.array([0.1, 0.3, 0.3, 0.1, -0.2, 0.4, 0.1, 0.2])
    begin, count = time.perf_counter(), 20_000
    for _ in range(count):
        kinematics(q)
    return count / (time.perf_counter() - begin)


_OPEN_PAGE = """
import sys, time
from playwright.sync_api import sync_playwright
chromium, url, *arguments = sys.argv[1:]
with sync_playwright() as playwright:
    page = playwright.chromium.launch(executable_path=chromium, headless=True, args=arguments).new_page()
    page.goto(url)
    time.sleep(280)
"""
