"""`cobra-teleop replay`: recordings in the 3D scene, with a time line. A web server and files; nothing that could drive."""

import asyncio
import contextlib
import logging
import math
import os
import signal
import sys
import threading
import webbrowser
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta
from starlette.routing import BaseRoute, Mount, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

from app import runtime
from app.console.front_door import page_route, viewer_routes
from app.console.static_folder import static_folder
from app.console.viewer_proxy import ViewerProxy
from app.console.web_server import WebServer
from app.recording.container import RecordingError
from app.recording.glance import glance
from app.recording.player import SPEEDS, Player
from app.recording.reader import Recording
from app.recording.replay_view import ReplayViewer, tip_finder
from cobra.clock import SystemClock

log = logging.getLogger("cobra.replay")
HOST = "127.0.0.1"
SNAPSHOT_S = 0.06
FIRST_PORT = 8070


class _Act(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a page asks for."""

    what: Literal["play", "pause", "seek", "speed", "offset"]
    value: Annotated[float, Meta(ge=-1e6, le=1e6)] = 0.0


class ReplayServer(WebServer):
    """The replay's page and its websocket, and viser behind the proxy."""

    def __init__(self, port: int, player: Player, viewer_port: int | None, viewer_secret: str) -> None:
        super().__init__(HOST, port)
        self._player = player
        self._proxy = ViewerProxy(viewer_port, viewer_secret) if viewer_port is not None else None
        descriptions = [recording.description for recording in player.recordings]
        self._tips = [tip_finder(d) if d else (lambda state: None) for d in descriptions]

    def routes(self) -> Sequence[BaseRoute]:
        return (
            page_route("/", "replay.html"),
            WebSocketRoute("/replay", self._page),
            *(viewer_routes(self._proxy) if self._proxy is not None else ()),
            Mount("/static", StaticFiles(directory=static_folder())),
        )

    async def _page(self, websocket: WebSocket) -> None:
        await websocket.accept()
        try:
            await websocket.send_text(_text({"type": "facts", **self._facts()}))
            async with asyncio.TaskGroup() as group:
                group.create_task(self._listen(websocket))
                group.create_task(self._tell(websocket))
        except* WebSocketDisconnect:
            pass

    async def _tell(self, websocket: WebSocket) -> None:
        while True:
            await websocket.send_text(_text({"type": "snapshot", **self._snapshot()}))
            await asyncio.sleep(SNAPSHOT_S)

    async def _listen(self, websocket: WebSocket) -> None:
        player = self._player
        while True:
            text = await websocket.receive_text()
            try:
                act = msgspec.json.decode(text, type=_Act)
            except msgspec.MsgspecError:
                self.refused["malformed message"] += 1
                continue
            match act.what:
                case "play":
                    player.play()
                case "pause":
                    player.pause()
                case "seek":
                    player.seek(act.value)
                case "speed":
                    player.set_speed(act.value)
                case "offset":
                    player.set_offset(act.value)

    def _facts(self) -> dict[str, Any]:
        return {
            "recordings": [
                {
                    "name": recording.path.name,
                    "title": recording.title,
                    "started_ms": recording.start_ns / 1e6,
                    "duration": recording.duration_s,
                    "warnings": recording.warnings,
                    "events": recording.digest.events,
                    "phases": recording.digest.phases,
                    "drivers": recording.digest.drivers,
                    "overview": recording.digest.overview,
                }
                for recording in self._player.recordings
            ],
            "speeds": SPEEDS,
            "view": self._proxy is not None,
        }

    def _snapshot(self) -> dict[str, Any]:
        player = self._player
        state, other = player.state(), player.other_state()
        tips = [tip(s) for tip, s in zip(self._tips, (state, other), strict=False)]
        apart = None
        if len(tips) == 2 and tips[0] is not None and tips[1] is not None:
            apart = float(np.linalg.norm(tips[0] - tips[1])) * 1e3
        return {
            "t": player.time_s,
            "playing": player.playing,
            "speed": player.speed,
            "offset": player.offset_s,
            "phase": state.phase if state else "",
            "cause": state.cause if state else "",
            "driver": state.lease.holder if state else "",
            "tip_mm": [float(x) * 1e3 for x in tips[0]] if tips[0] is not None else None,
            "tension": _highest(state.drives.load, player.recordings[0]) if state else None,
            "other": {"phase": other.phase, "apart_mm": apart} if other else None,
        }


def replay(files: Sequence[Path], port: int, open_page: bool) -> int:
    """Serve a replay until Ctrl-C. Returns the exit status.

    Raises:
        RecordingError: a file is no recording.
    """
    quit_ = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: quit_.set())
    for file in files:
        with contextlib.suppress(OSError):  # told when it is opened
            facts, digest = glance(file)
            if facts and digest is None:
                print(
                    f"{file.name} was not closed: it is read through first (a quarter of a minute an hour)", flush=True
                )
    with ExitStack() as stack:
        recordings = [stack.enter_context(Recording(file)) for file in files]
        for warning in (warning for recording in recordings for warning in recording.warnings):
            print(f"cobra-teleop: {warning}", file=sys.stderr)
        player = Player(recordings, SystemClock())
        server = start_server(player, port, stack)
        print(f"Replay of {', '.join(file.name for file in files)}: {server.url}   (Ctrl-C ends it)", flush=True)
        if open_page and (sys.platform != "linux" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
            threading.Thread(target=webbrowser.open, args=(server.url,), daemon=True).start()
        quit_.wait()
    return 0


def start_server(player: Player, port: int, stack: ExitStack) -> ReplayServer:
    """The 3D view, where the robot's description is known, and the server; `stack` ends both.

    Raises:
        RecordingError: no port is free.
    """
    first = player.recordings[0]
    viewer = None
    if first.description is not None:
        other = player.recordings[1].description if len(player.recordings) > 1 else None
        viewer = ReplayViewer(first.description, player, other)
        viewer.start()
        stack.callback(viewer.stop)
    try:
        server = ReplayServer(
            runtime.free_port(port) if port else 0,
            player,
            viewer.port if viewer else None,
            viewer.secret if viewer else "",
        )
        server.start()
    except OSError as error:
        raise RecordingError(f"the replay's page cannot be served: {error}") from None
    stack.callback(server.stop)
    return server


def _highest(load: tuple[float, ...], recording: Recording) -> float | None:
    description = recording.description
    if description is None or len(load) != len(description.drives):
        return None
    known = [load[i] for i in description.tendon_drives if math.isfinite(load[i])]
    return max(known, default=None)


def _text(message: dict[str, Any]) -> str:
    return msgspec.json.encode(message).decode()
