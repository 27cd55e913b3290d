"""How long a pad's event takes to the reading, and to the command that the pilot makes of it."""

import sys
import threading
import time
from queue import Queue

import numpy as np
import pytest

from app.console.gamepad import Gamepad
from app.console.pilot import Pilot
from cobra.clock import SystemClock
from cobra.loading import load_description

pytestmark = pytest.mark.benchmark

SAMPLES = 400
PERIOD_S = 0.004
LOOK_S = 0.001
"""SDL looks at its devices this often while it waits."""


def report(what, delays_s, bare_s):
    p50, p99, longest = 1e3 * np.percentile(delays_s, (50, 99, 100))
    bare50, bare99 = 1e3 * np.percentile(bare_s, (50, 99))
    print(
        f"\n{what}: p50 {p50:.2f} ms, p99 {p99:.2f} ms, max {longest:.2f} ms; that is {p50 / bare50:.2f} and "
        f"{p99 / bare99:.2f} times a bare thread that looks every millisecond (p50 {bare50:.2f}, p99 {bare99:.2f} ms)"
    )


def delays_of(move, changes):
    """Make a movement again and again, off the beat of any poll; the delays until each was reported [s]."""
    rng = np.random.default_rng(1)
    delays = []
    for i in range(SAMPLES):
        time.sleep(PERIOD_S + rng.uniform(0, PERIOD_S))
        moved = time.monotonic()
        move(0.3 + 0.4 * (i % 2))
        delays.append(changes.get(timeout=5) - moved)
    return delays


def bare_delays():
    """The same with a plain thread that watches a variable: what this machine allows now, with its present load."""
    value, changes, done = [0.0], Queue(), threading.Event()

    def look():
        seen = value[0]
        while not done.is_set():
            time.sleep(LOOK_S)
            if value[0] != seen:
                seen = value[0]
                changes.put(time.monotonic())

    thread = threading.Thread(target=look)
    thread.start()
    try:
        return delays_of(lambda new: value.__setitem__(0, new), changes)
    finally:
        done.set()
        thread.join()


def spin(done):
    while not done.is_set():
        sum(range(1000))


@pytest.mark.parametrize(
    "beside", ["an idle process", "a busy Python thread", "a busy Python thread, switching at 0.5 ms"]
)
def test_pad_event_to_command(plug, beside):
    clock, changes, done = SystemClock(), Queue(), threading.Event()
    pilot = Pilot(load_description("cobra"), clock)

    def on_change(controls):
        pilot.update("pad", controls)
        pilot.command(clock.now())
        if controls.connected:
            changes.put(time.monotonic())

    interval = sys.getswitchinterval()
    gamepad = Gamepad(on_change, clock)
    gamepad.start()
    try:
        pad = plug()
        changes.get(timeout=5)  # it is there
        if beside != "an idle process":
            threading.Thread(target=spin, args=(done,), daemon=True).start()
        if "0.5 ms" in beside:
            sys.setswitchinterval(0.0005)
        report(
            f"pad event to command beside {beside}",
            delays_of(lambda new: pad.axis("leftx", new), changes),
            bare_delays(),
        )
    finally:
        done.set()
        sys.setswitchinterval(interval)
        gamepad.stop()


def test_what_an_idle_pad_costs(plug):
    gamepad = Gamepad()
    gamepad.start()
    try:
        plug()
        while not gamepad.read().connected:
            time.sleep(0.001)
        polls, cpu, start = gamepad.polls, time.process_time(), time.monotonic()
        time.sleep(3.0)
        seconds = time.monotonic() - start
        load = (time.process_time() - cpu) / seconds
        print(f"\nan idle pad: {(gamepad.polls - polls) / seconds:.0f} readings a second, {load:.1%} of one core")
    finally:
        gamepad.stop()
