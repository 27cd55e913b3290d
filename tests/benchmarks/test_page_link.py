"""The page's link in one run: a browser's pad to the CAN frame, and a setpoint to the script of a page in Chromium.

pytest -m benchmark -s tests/benchmarks/test_page_link.py
"""

import bisect
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import can
import numpy as np
import pytest

from app.link.listener import Listener
from cobra.messages import Heard, Judged, RobotState, decode
from tests.benchmarks.test_main_job import FIRST_TENDON, POSITION
from tests.browser.conftest import ARGUMENTS, CHROMIUM, PAD, polite_chromium, without_scene
from tests.stack import Observer, Page, Stack, wait_for

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(300)]
WITHOUT_GL = ["--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
"""GL in software draws the page with 0.8 of a core, which neither graphics hardware nor a page without GL takes."""
TRIALS = 150
TICK_MS, ALLOWED_MS = 10.0, 15.0
TENDONS = 12
MOVED_RAD = 0.01
"""So far a section bends before the stick goes back: every drive has left its place by then."""
LISTEN = """
(() => {
  const Real = WebSocket;
  window.arrived = [];
  window.WebSocket = class extends Real {
    constructor(...all) {
      super(...all);
      this.addEventListener("message", (event) => {
        const at = performance.timeOrigin + performance.now();
        const { type, stamp, link } = JSON.parse(event.data);
        if (type === "snapshot") window.arrived.push([at, stamp, link.age_ms]);
      });
    }
  };
})();
"""
STICK = """
(x) => {
  thePad.axes[0] = x;
  return performance.timeOrigin + performance.now();
}
"""


class Trace:
    """Where each move of a stick was when, by the clock that all processes of a machine share."""

    def __init__(self, stack: Stack) -> None:
        assert stack.observer is not None
        self._commands: list[Judged] = []
        self._listener = Listener("cobra", stack.running("robot").endpoint, {"heard": self._hear})
        self._listener.start()

    def _hear(self, data: bytes) -> None:
        self._commands += decode(data, Heard).commands

    def stop(self) -> None:
        self._listener.stop()

    def hops(self, moves: list[float], log: Path) -> np.ndarray:
        """For each move [ms]: until it is at the console, from there at the robot, from there in a frame."""
        pushed = [c for c in self._commands if c.command.held and any(c.command.intent.primary)]
        frames = changed_frames(log)
        rows = []
        for move in moves:
            first = next(c for c in pushed if c.stamp > move)
            frame = frames[bisect.bisect_right(frames, first.stamp)]
            rows.append(
                (first.command.input_stamp - move, first.stamp - first.command.input_stamp, frame - first.stamp)
            )
        return 1e3 * np.array(rows)


def changed_frames(log: Path) -> list[float]:
    """When a tendon's drive was sent another setpoint than before [s, monotonic]."""
    wall = time.time() - time.monotonic()
    last: dict[int, bytes] = {}
    times = []
    for message in can.CanutilsLogReader(log):
        drive = message.arbitration_id - FIRST_TENDON
        if not 0 <= drive < TENDONS or message.is_rx or message.data[0] != POSITION:
            continue
        setpoint = bytes(message.data[4:8])
        if setpoint != last.get(drive, setpoint):
            times.append(message.timestamp - wall)
        last[drive] = setpoint
    return times


def report(what: str, hops: np.ndarray) -> None:
    whole = hops.sum(axis=1)
    print(
        f"\n{what} ({len(whole)} moves): p50 {np.percentile(whole, 50):.1f}, p99 {np.percentile(whole, 99):.1f}, at most "
        f"{whole.max():.1f} ms; one tick plus 15 ms is {TICK_MS + ALLOWED_MS:.0f} ms"
    )
    for name, part in zip(("to the console", "to the robot", "into a frame"), hops.T, strict=True):
        print(
            f"  {name}: p50 {np.percentile(part, 50):.1f}, p99 {np.percentile(part, 99):.1f}, at most {part.max():.1f} ms"
        )


def moves_of(observer: Observer, press: Callable[[], object], push: Callable[[float], float]) -> list[float]:
    """Push the stick and centre it again and again, from rest each time; gives when each push was made.

    A stall of this machine that ended the drive, as it must, is said, and that push made again.
    """
    moves: list[float] = []
    ended = 0
    while len(moves) < TRIALS:
        if observer.state.phase != "driving":
            push(0.0)
            press()
        before = observer.state.commanded
        moved = push(0.9 if len(moves) % 2 else -0.9)
        try:
            observer.wait("motion", lambda state, b=before: abs(state.commanded[2] - b[2]) > MOVED_RAD, 2.0)
        except AssertionError:
            ended += 1
            continue
        moves.append(moved)
        push(0.0)
        _until_rest(observer)
    if ended:
        print(f"\n{ended} drives were ended by stalls of this machine")
    return moves


def _until_rest(observer: Observer) -> None:
    last = [observer.state]

    def rest(state: RobotState) -> bool:
        still = state.tick > last[0].tick + 5 and state.commanded == last[0].commanded
        if state.commanded != last[0].commanded:
            last[0] = state
        return still

    observer.wait("rest", rest)


@contextmanager
def traced(stack: Stack) -> Iterator[Trace]:
    stack.start()
    trace = Trace(stack)
    yield trace
    trace.stop()
    stack.end()


@pytest.mark.parametrize("rate_Hz", ["10", "30"])
def test_a_browsers_pad_to_the_frame(tmp_path: Path, rate_Hz: str) -> None:
    """The page's own messages by hand: what a browser adds before it sends is not in here."""
    log = tmp_path / "frames.log"
    with (
        Stack(tmp_path, "--twin", "ideal", "--frame-rate", rate_Hz, "--can-log", str(log)) as stack,
        traced(stack) as trace,
        Page(stack.url) as page,
    ):
        page.arm()
        moves = moves_of(stack.observer, page.press, lambda x: page.move(left=[x, 0]))
    hops = trace.hops(moves, log)
    report(f"a page's message to the frame, scene at {rate_Hz} Hz", hops)
    assert len(hops) == TRIALS


def test_a_pad_in_chromium_to_the_frame(tmp_path: Path) -> None:
    """From the moment that the Gamepad API reads otherwise. The 3D view is left away: drawn in software it takes the machine."""
    if CHROMIUM is None:
        pytest.skip("there is no Chromium on this machine")
    from playwright.sync_api import sync_playwright

    log = tmp_path / "frames.log"
    with (
        Stack(tmp_path, "--twin", "ideal", "--frame-rate", "10", "--can-log", str(log)) as stack,
        sync_playwright() as playwright,
        traced(stack) as trace,
    ):
        tab = playwright.chromium.launch(executable_path=CHROMIUM, headless=True, args=WITHOUT_GL).new_page()
        without_scene(tab.context)
        tab.add_init_script(PAD)
        tab.goto(stack.url)
        tab.get_by_test_id("arm").click()
        stack.observer.wait("ready", lambda state: state.phase == "ready", 60.0)
        tab.get_by_test_id("pad-use-here").click()

        def driving() -> bool:
            tab.evaluate("press(4, false)")
            tab.wait_for_timeout(200)
            tab.evaluate("press(4, true)")
            tab.wait_for_timeout(500)
            return stack.observer.state.phase == "driving"

        wall = time.time() - time.monotonic()
        moves = moves_of(
            stack.observer,
            lambda: wait_for("the drive", driving, 60.0),
            lambda x: tab.evaluate(STICK, x) / 1e3 - wall,
        )
        tab.context.browser.close()
    hops = trace.hops(moves, log)
    report("a pad in Chromium to the frame", hops)
    assert len(hops) == TRIALS


def test_a_setpoint_to_the_pages_script(tmp_path):
    if CHROMIUM is None:
        pytest.skip("there is no Chromium on this machine")
    from playwright.sync_api import sync_playwright

    with Stack(tmp_path, "--frame-rate", "10") as stack, sync_playwright() as playwright:
        stack.start()
        tab = playwright.chromium.launch(
            executable_path=polite_chromium(tmp_path), headless=True, args=ARGUMENTS
        ).new_page()
        without_scene(tab.context)  # drawing in software is another matter
        tab.add_init_script(LISTEN)
        tab.goto(stack.url)
        wait_for("snapshots", lambda: tab.evaluate("arrived.length") > 300, 60.0)
        wall = 1e3 * (time.time() - time.monotonic())
        arrived = np.array(tab.evaluate("arrived.slice(40)"), dtype=float)
    delays = arrived[:, 0] - wall - (1e3 * arrived[:, 1] - arrived[:, 2])
    print(
        f"\nsetpoint to the page's script ({len(delays)} snapshots): p50 {np.percentile(delays, 50):.1f}, "
        f"p99 {np.percentile(delays, 99):.1f} ms"
    )
    assert (delays > -1.0).all(), "the clocks are one"
