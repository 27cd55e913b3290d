"""A console that only watches, on the same machine as its robots or on another."""

import getpass
import signal
import threading
from dataclasses import dataclass
from pathlib import Path

from app import logs, runtime
from app.console import listening
from app.console.listening import load_tls, own_names
from app.link.access import DIRECT, LinkAccess
from app.metrics import Metrics
from app.people.sessions import Sessions
from app.people.users import Users
from app.watching.feeds import Feed, WatchedRobot
from app.watching.room import Rooms
from app.watching.watch_door import WatchDoor

SWEEP_S = 30.0
"""Rooms that stood empty for this long are closed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WatchOptions:
    """What the command line chose."""

    endpoints: tuple[str, ...] = ()
    """None: the robots that run on this machine."""
    access: LinkAccess = DIRECT
    host: str = "127.0.0.1"
    port: int = 8070
    names: tuple[str, ...] = ()
    tls_cert: Path | None = None
    tls_key: Path | None = None
    insecure: bool = False
    frame_rate_Hz: float = 30.0


def run_watch(options: WatchOptions) -> int:
    """Watch until Ctrl-C or SIGTERM. Returns the exit status.

    Raises:
        BusyError: no endpoint is given and no robot runs here.
        ListeningError: the page may not be served like that.
    """
    endpoints = options.endpoints or _running_here()
    users, tls = Users(), load_tls(options.tls_cert, options.tls_key)
    danger = listening.danger(options.host, bool(users.all()), tls is not None, options.insecure)
    logs.start("watch")
    done = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: done.set())
    robots: dict[str, WatchedRobot] = {}
    feeds = [Feed(endpoint, robots, options.access) for endpoint in endpoints]
    rooms = Rooms(robots, options.frame_rate_Hz)
    port = (
        options.port
        if not options.port or runtime.port_holder(options.port) is None
        else runtime.free_port(options.port + 1)
    )
    metrics = Metrics(
        lambda: dict(robots),
        lambda name: robots[name].described(),
        lambda: door.refused,
        lambda: {"walls": door.walls, "pages": rooms.visitors},
    )
    door = WatchDoor(
        options.host,
        port,
        robots,
        feeds,
        rooms,
        metrics,
        names=own_names(options.host, options.names),
        sessions=Sessions(users, getpass.getuser(), most="viewer"),
        tls=tls,
    )
    for feed in feeds:
        feed.start()
    door.start()
    try:
        if danger:
            print(danger, flush=True)
        print(f"Watching {', '.join(endpoints)}. Page: {door.url}   (Ctrl-C ends it)", flush=True)
        while not done.wait(SWEEP_S):
            rooms.close_empty()
    finally:
        door.stop()
        rooms.stop()
        for feed in feeds:
            feed.stop()
    return 0


def _running_here() -> tuple[str, ...]:
    endpoints = tuple(running.endpoint for running in runtime.find_all("robot"))
    if not endpoints:
        raise runtime.BusyError(
            "no robot process runs on this machine: start one with `cobra-teleop`, or name its endpoint, such as "
            "`cobra-teleop watch --robot tls/robot-room:7447`"
        )
    return endpoints
