"""What it costs to be watched, and what those who watch get, through the front door and through a router.

pytest -m benchmark -s tests/benchmarks/test_viewers.py
"""

import contextlib
import json
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import msgspec
import numpy as np
import psutil
import pytest
import zstandard
from websockets import Origin, Subprotocol
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from app.console.viewer import Viewer
from app.people.users import Users
from app.router import add_account
from app.runtime import any_free_port
from tests.app.console.scene_fakes import COBRA, ViserClient, state_of
from tests.crowd import CAMERA, Crowd
from tests.fleet import names
from tests.page_fakes import cookie_of
from tests.slow_link import SlowLink
from tests.stack import Page, Stack, wait_for

pytestmark = [pytest.mark.benchmark, pytest.mark.timeout(400)]
VIEWERS = 50
RUNS = 5
WINDOW_S = 6.0
"""The loop's timing is of its last 5 s, summed up once a second."""
A_WEEK = 7 * 24 * 3600 * 30 * 8
"""Messages at 30 frames a second."""


class Watched:
    """The program with a robot that moves, a driver and a viewer's cookie."""

    def __init__(self, stack: Stack, page: Page, cookie: str) -> None:
        self.stack, self.page, self.cookie = stack, page, cookie
        assert stack.process is not None
        self.console = psutil.Process(stack.process.pid)

    @property
    def url(self) -> str:
        return self.stack.url

    @property
    def port(self) -> int:
        return urlsplit(self.stack.url).port or 0

    def crowd(self, count: int, path: str = "/viewer/") -> Crowd:
        return Crowd(self.url, self.cookie, count, path)

    def measure(self, crowd: Crowd | None) -> tuple[float, float, dict[str, Any]]:
        """p99 of the loop's deviation from its period [s], cores that the console took, and what the crowd got."""
        time.sleep(1.0)
        if crowd:
            crowd.report()
        cpu, began = sum(self.console.cpu_times()[:2]), time.monotonic()
        time.sleep(WINDOW_S)
        cores = (sum(self.console.cpu_times()[:2]) - cpu) / (time.monotonic() - began)
        assert self.stack.observer is not None
        timing = self.stack.observer.state.timing
        return timing.period_p99 - 1.0 / 100.0, cores, crowd.report() if crowd else {}


@pytest.fixture
def watched(tmp_path: Path) -> Iterator[Watched]:
    book = Users(tmp_path / "users.json")
    users = {name: (name, book.add(name, role)) for name, role in (("anna", "driver"), ("vic", "viewer"))}
    with Stack(tmp_path) as stack:
        stack.start()
        with Page(stack.url, users["anna"]) as page, _moving(page):
            yield Watched(stack, page, cookie_of(urlsplit(stack.url).port or 0, users["vic"]))


@contextlib.contextmanager
def _moving(page: Page) -> Iterator[None]:
    """A drive to and fro, for as long as it takes; a press that a stall ended is made again."""
    assert page.ask("acquire")["ok"]
    page.arm()
    done = threading.Event()

    def drive() -> None:
        turn = 0
        while not done.wait(0.7):
            turn += 1
            if page.snapshot["phase"] != "driving":
                page.release()
                time.sleep(0.1)
                page.hold()  # pressed with the sticks centred
                time.sleep(0.3)
            page.hold(left=[0.8 if turn % 2 else -0.8, 0.3], right=[0.0, 0.5 if turn % 2 else -0.5])

    thread = threading.Thread(target=drive)
    thread.start()
    page.until_phase("driving")
    yield
    done.set()
    thread.join()


def rates(report: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """kB and frames a second of each viewer."""
    each = np.array(report["each"]) / report["seconds"]
    return each[:, 0] / 1e3, each[:, 1]


def test_fifty_viewers_do_not_disturb_the_loop(watched: Watched) -> None:
    alone, together, cores, sizes, frames = [], [], [], [], []
    for _ in range(RUNS):
        alone.append(watched.measure(None)[0])
        with watched.crowd(VIEWERS) as crowd:
            jitter, core, report = watched.measure(crowd)
        assert report["gone"] == 0
        size, rate = rates(report)
        together.append(jitter)
        cores.append(core)
        sizes.append(size.max())
        frames.append(rate.min())
    without, beside = (1e3 * float(np.median(values)) for values in (alone, together))
    print(
        f"\n{VIEWERS} viewers, robot moving, median of {RUNS} interleaved runs: p99 of the loop's period "
        f"{10 + without:.2f} ms without, {10 + beside:.2f} ms with them; late by {without:.2f} and {beside:.2f} ms\n"
        f"  console {max(cores):.2f} cores at most; each viewer {max(sizes):.0f} kB/s at most, "
        f"{min(frames):.1f} frames/s at least (runs without: {np.round(1e3 * np.array(alone), 2)}, "
        f"with: {np.round(1e3 * np.array(together), 2)} ms)"
    )
    assert 10 + beside < 1.1 * (10 + without)
    assert max(cores) < 1.0
    assert max(sizes) < 1500.0


def test_the_thin_view_with_its_page_fits_into_60_kB_a_second(watched: Watched) -> None:
    socket = connect(
        f"ws://127.0.0.1:{watched.port}/ws",
        origin=Origin(f"http://127.0.0.1:{watched.port}"),
        additional_headers={"cookie": watched.cookie},
    )
    socket.send(json.dumps({"type": "pace", "thin": True, "view": "p-bench"}))
    total, done = [0], threading.Event()

    def read() -> None:
        with contextlib.suppress(ConnectionClosed):
            while not done.is_set():
                total[0] += len(socket.recv())

    reader = threading.Thread(target=read)
    reader.start()
    with watched.crowd(3, "/viewer/p-bench/thin/") as crowd:
        time.sleep(1.0)
        before, began = total[0], time.monotonic()
        report = watched.measure(crowd)[2]
        page = (total[0] - before) / (time.monotonic() - began) / 1e3
    done.set()
    reader.join()
    socket.close()
    size, rate = rates(report)
    print(f"\nthin view: scene {size.max():.1f} kB/s at {rate.mean():.1f} Hz, its page {page:.1f} kB/s more")
    assert rate.mean() == pytest.approx(10.0, abs=1.0)
    assert size.max() + page < 60.0


def test_a_viewer_that_stops_reading_is_cut_off_and_holds_nobody_up(watched: Watched) -> None:
    with watched.crowd(5) as crowd:
        watched.measure(crowd)
        before = watched.console.memory_info().rss
        stuck, began = _look(watched, watched.port), time.monotonic()  # and never read
        own = stuck.socket.getsockname()[1]

        def connected() -> bool:
            return any(other.raddr and other.raddr.port == own for other in watched.console.net_connections())

        assert connected()
        wait_for("the cut", lambda: not connected(), 60.0)
        took = time.monotonic() - began
        more = (watched.console.memory_info().rss - before) / 1e6
        report = crowd.report()
        stuck.close()
    _, rate = rates(report)
    print(f"\nstuck viewer: cut off after {took:.1f} s, {more:+.1f} MB; the others {rate.min():.1f} frames/s at least")
    assert report["gone"] == 0
    assert rate.min() > 20.0
    assert more < 50.0


@pytest.mark.parametrize(("path", "most_s"), [("/viewer/p-slow/", 2.0), ("/viewer/p-slow/thin/", 2.0)])
def test_a_viewer_on_200_kB_a_second_sees_what_is_at_most_two_seconds_old(
    watched: Watched, path: str, most_s: float
) -> None:
    ages = []
    with SlowLink(watched.port, 200e3) as line, _look(watched, line.port, path) as viewer:
        began = time.monotonic()
        while time.monotonic() - began < 20.0:
            made = _made_at(viewer.recv(20.0))
            if time.monotonic() - began > 6.0:  # the scene itself has come by then
                ages.append(time.perf_counter() - made)
    print(
        f"\n200 kB/s, {path}: {len(ages) / 14:.1f} frames/s, age p50 {np.median(ages):.2f}, at most {max(ages):.2f} s"
    )
    assert max(ages) < most_s


def test_after_a_week_a_new_viewer_joins_at_once() -> None:
    start = time.monotonic()
    viewer = Viewer(COBRA, lambda: state_of(t=time.monotonic() - start))
    viewer.start()
    times = []
    for messages in (0, A_WEEK):
        viewer._running()._websock_server._broadcast_buffer.message_counter += messages
        began = time.monotonic()
        with ViserClient(viewer) as client:
            client.wait_for(lambda message: message["type"] == "ReplayDoneMessage", 60.0)
            times.append(time.monotonic() - began)
    viewer.stop()
    print(f"\njoining: {times[0]:.2f} s at first, {times[1]:.2f} s after a week ({A_WEEK / 1e6:.0f} million messages)")
    assert times[1] < 1.0


def test_a_hundred_robots_reach_five_consoles_through_a_router(tmp_path: Path) -> None:
    robots, rate_Hz, seconds, consoles = 100, 50.0, 12.0, 5
    accounts, endpoint = tmp_path / "accounts.json", f"tcp/127.0.0.1:{any_free_port()}"
    for name in names(robots):
        add_account(accounts, name, "robot", tmp_path / f"{name}.account")
    add_account(accounts, "room", "viewer", tmp_path / "room.account")
    serve = ["router", "serve", "--accounts", str(accounts), "--listen", endpoint]
    with contextlib.ExitStack() as stack:
        router = _process(stack, "-m", "app", *serve)
        assert _line(router), "it says where it listens"
        arguments = (endpoint, str(tmp_path), str(robots), str(rate_Hz))
        fleet = _process(stack, "-m", "tests.fleet", "robots", *arguments)
        assert _line(fleet) == "ready"
        watchers = [
            _process(stack, "-m", "tests.fleet", "watch", endpoint, str(tmp_path / "room.account"), str(robots))
            for _ in range(consoles)
        ]
        for watcher in watchers:
            assert _line(watcher) == "ready"
        for watcher in watchers:
            _say(watcher)
        time.sleep(seconds)
        _say(fleet)
        sent = json.loads(_line(fleet))
        time.sleep(0.5)
        for watcher in watchers:
            _say(watcher)
        reports = [json.loads(_line(watcher)) for watcher in watchers]
        _say(fleet)
    worst = max(report["p99"] for report in reports)
    print(
        f"\n{robots} robots at {rate_Hz:.0f} Hz ({sent['bytes']} bytes each) to {consoles} consoles through a router: "
        f"p50 {1e3 * max(r['p50'] for r in reports):.1f}, p99 {1e3 * worst:.1f}, at most "
        f"{1e3 * max(r['max'] for r in reports):.0f} ms; {sum(r['received'] for r in reports)} states arrived; "
        f"the robots were {1e3 * sent['late_s']:.0f} ms late at the end"
    )
    for report in reports:
        assert report["newest"] == dict.fromkeys(names(robots), sent["last"])
    assert worst < 0.05


def _look(watched: Watched, port: int, path: str = "/viewer/") -> Any:
    viewer = connect(
        f"ws://127.0.0.1:{port}{path}",
        origin=Origin(f"http://127.0.0.1:{port}"),
        additional_headers={"cookie": watched.cookie},
        subprotocols=[Subprotocol("viser-v1.1.1")],
        compression=None,
        max_size=None,
        max_queue=1,
        close_timeout=0.1,
    )
    viewer.send(msgspec.msgpack.encode(CAMERA))
    return viewer


def _made_at(frame: bytes) -> float:
    """When viser made a window of messages, by the clock that all processes of a machine share."""
    packed = frame[16 : 16 + int.from_bytes(frame[8:16], "little")]
    size = int.from_bytes(frame[:8], "little")
    window = msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(packed, max_output_size=size))
    return float(window["timestampSec"])


def _process(stack: contextlib.ExitStack, *command: str) -> "subprocess.Popen[str]":
    process = stack.enter_context(
        subprocess.Popen([sys.executable, *command], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    )
    stack.callback(process.terminate)
    return process


def _line(process: "subprocess.Popen[str]") -> str:
    assert process.stdout is not None
    return process.stdout.readline().strip()


def _say(process: "subprocess.Popen[str]") -> None:
    assert process.stdin is not None
    process.stdin.write("\n")
    process.stdin.flush()
