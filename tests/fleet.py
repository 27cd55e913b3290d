"""Many robots behind a router, and consoles that watch them all, each in a process of its own: for the benchmark.

    python -m tests.fleet robots ENDPOINT FOLDER COUNT RATE_HZ
    python -m tests.fleet watch ENDPOINT ACCOUNT COUNT

Each robot has a link and an account of its own, and publishes whole states until a line on stdin. A watching process is what `cobra-teleop watch` hears with. It says `ready` when it has heard of all robots, begins to count at a line
on stdin, and at the next one says what it has: the newest tick of each robot, and how long the states were on their way until they were taken up.
"""

import json
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import msgspec
import numpy as np

from app.link.access import LinkAccess
from app.link.robot_end import RobotLink
from app.runtime import any_free_port
from app.watching.feeds import Feed, WatchedRobot
from cobra.messages import Meta, encode
from tests.app.console.scene_fakes import state_of

GROUPS = 10
"""Robots send in so many turns of each period, not all in the same moment."""


class _Stamp(msgspec.Struct):
    stamp: float


def names(count: int) -> list[str]:
    return [f"robot{i:03d}" for i in range(count)]


def _robots(endpoint: str, folder: Path, count: int, rate_Hz: float) -> None:
    meta = Meta(description="", versions={}, pid=1)

    def link(name: str) -> RobotLink:
        own = f"tcp/127.0.0.1:{any_free_port()}"
        made = RobotLink(name, own, meta, router=endpoint, access=LinkAccess(account=folder / f"{name}.account"))
        made.start(lambda data: None, lambda data: None, lambda data, answer: None)
        return made

    # Connecting takes half a second each.
    with ThreadPoolExecutor(25) as workers:
        links = list(workers.map(link, names(count)))
    models = [msgspec.structs.replace(state_of(t=i), robot=name) for i, name in enumerate(names(count))]
    print("ready", flush=True)
    over = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.readline(), over.set()), daemon=True).start()
    tick, deadline = 0, time.monotonic()
    while not over.is_set():
        tick += 1
        for group in range(GROUPS):
            deadline += 1.0 / (rate_Hz * GROUPS)
            time.sleep(max(0.0, deadline - time.monotonic()))
            for i in range(group, count, GROUPS):
                links[i].publish_state(msgspec.structs.replace(models[i], tick=tick, stamp=time.monotonic()))
    report = {"last": tick, "late_s": time.monotonic() - deadline, "bytes": len(encode(models[0]))}
    print(json.dumps(report), flush=True)
    sys.stdin.readline()
    for link in links:
        link.stop()


def _watch(endpoint: str, account: Path, count: int) -> None:
    delays: list[float] = []
    stamp, take = msgspec.msgpack.Decoder(_Stamp), WatchedRobot.take_state

    def timed(robot: WatchedRobot, data: bytes) -> None:
        take(robot, data)
        delays.append(time.monotonic() - stamp.decode(data).stamp)

    WatchedRobot.take_state = timed  # type: ignore[method-assign]
    robots: dict[str, WatchedRobot] = {}
    feed = Feed(endpoint, robots, LinkAccess(account=account))
    feed.start()
    while sum(robot.received > 0 for robot in list(robots.values())) < count:
        time.sleep(0.05)
    print("ready", flush=True)
    done = threading.Event()

    def looks() -> None:
        """As a wall does: decode what is newest, 5 times a second."""
        while not done.wait(0.2):
            for robot in list(robots.values()):
                robot.latest()

    threading.Thread(target=looks, daemon=True).start()
    sys.stdin.readline()
    delays.clear()
    sys.stdin.readline()
    times = np.array(delays)
    newest = {name: state.tick for name, robot in robots.items() if (state := robot.latest())}
    p50, p99 = np.percentile(times, [50, 99])
    print(
        json.dumps({"received": len(times), "newest": newest, "p50": p50, "p99": p99, "max": times.max()}), flush=True
    )
    done.set()
    feed.stop()


if __name__ == "__main__":
    role, endpoint, *rest = sys.argv[1:]
    if role == "robots":
        _robots(endpoint, Path(rest[0]), int(rest[1]), float(rest[2]))
    else:
        _watch(endpoint, Path(rest[0]), int(rest[1]))
