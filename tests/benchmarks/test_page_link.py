"""The page's link in one run: a browser's pad to the CAN frame, and a setpoint to the script of a page in Chromium.

pytest -m benchmark -s tests/benchmarks/test_page_link.py
"""

import time

import numpy as np
import pytest

from tests.benchmarks.test_main_job import _latencies
from tests.browser.conftest import ARGUMENTS, CHROMIUM, without_scene
from tests.stack import Page, Stack, wait_for

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(300)]
TRIALS = 100
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


def test_a_browsers_pad_to_the_frame(tmp_path):
    """The page's own messages by hand: what a browser adds before it sends is not in here."""
    log = tmp_path / "frames.log"
    presses = []
    with Stack(tmp_path, "--frame-rate", "10", "--can-log", str(log)) as stack:
        stack.start()
        with Page(stack.url) as page:
            page.arm()
            page.hold()
            page.until_phase("driving")
            for i in range(TRIALS):
                before = stack.observer.state.commanded
                presses.append(page.move(left=[1.0 if i % 2 else -1.0, 0]))
                stack.observer.wait("motion", lambda state, before=before: state.commanded != before)
                page.move(left=[0, 0])
                tick = stack.observer.state.tick
                stack.observer.wait("rest", lambda state, tick=tick: state.tick > tick + 40)
        stack.end()
    latencies = 1e3 * _latencies(log, presses)
    print(
        f"\nbrowser's pad to frame ({len(latencies)} moves): p50 {np.percentile(latencies, 50):.1f}, "
        f"p99 {np.percentile(latencies, 99):.1f} ms; one tick plus 15 ms is 25 ms"
    )
    assert len(latencies) == TRIALS


def test_a_setpoint_to_the_pages_script(tmp_path):
    if CHROMIUM is None:
        pytest.skip("there is no Chromium on this machine")
    from playwright.sync_api import sync_playwright

    with Stack(tmp_path, "--frame-rate", "10") as stack, sync_playwright() as playwright:
        stack.start()
        tab = playwright.chromium.launch(executable_path=CHROMIUM, headless=True, args=ARGUMENTS).new_page()
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
