"""The web server of a console that watches: the wall, and a page for each robot under /robot/NAME/."""

import asyncio
import contextlib
import logging
from collections.abc import Sequence
from typing import Unpack

import msgspec
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, PlainTextResponse, RedirectResponse, Response
from starlette.routing import BaseRoute, Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

from app.console.doorkeeper import PRESENT, VISITOR
from app.console.front_door import metrics_route, page_route, stop_by_post
from app.console.patience import cut_off, taken
from app.console.static_folder import static_folder
from app.console.web_server import Door, WebServer
from app.link.stopping import UNCONFIRMED
from app.metrics import Metrics
from app.watching.feeds import Feed, WatchedRobot
from app.watching.room import Room, Rooms
from app.watching.wall import wall_of
from cobra.errors import OperatorError

WALL_PERIOD_S = 0.2
SILENT_S = 5.0
"""A wall says of everything that it has seen it; one that says nothing for this long is cut off."""
SEEN = "seen"
ROOM = "/robot/{name}"
NOT_KNOWN = 1008

log = logging.getLogger("cobra.watch")


class WatchDoor(WebServer):
    """Serves the wall and the rooms."""

    def __init__(
        self,
        host: str,
        port: int,
        robots: dict[str, WatchedRobot],
        feeds: list[Feed],
        rooms: Rooms,
        metrics: Metrics | None = None,
        **door: Unpack[Door],
    ) -> None:
        super().__init__(host, port, **door)
        self._robots = robots
        self._feeds = feeds
        self._rooms = rooms
        self._metrics = metrics
        self.walls = 0
        """Walls that are open now."""

    def routes(self) -> Sequence[BaseRoute]:
        return (
            page_route("/", "wall.html"),
            Route("/healthz", self._health),
            *metrics_route(self._metrics, self),
            WebSocketRoute("/wall", self._tell_wall),
            page_route(f"{ROOM}/", "index.html"),
            Route(ROOM, lambda request: RedirectResponse(f"{request.url.path}/", 307)),
            Route(f"{ROOM}/stop", self._stop_by_post, methods=["POST"]),
            WebSocketRoute(f"{ROOM}/ws", self._page),
            Route(f"{ROOM}/viewer", self._view_file),
            Route(f"{ROOM}/viewer/{{path:path}}", self._view_file),
            WebSocketRoute(f"{ROOM}/viewer", self._view),
            WebSocketRoute(f"{ROOM}/viewer/{{path:path}}", self._view),
            Mount("/static", StaticFiles(directory=static_folder())),
        )

    async def _health(self, request: Request) -> Response:
        if request.scope[VISITOR] is None:
            return JSONResponse({"ok": True})
        fresh = sum(robot.age() < 1.0 for robot in list(self._robots.values()))
        return JSONResponse({"ok": True, "robots": len(self._robots), "fresh": fresh, "walls": self.walls})

    async def _tell_wall(self, websocket: WebSocket) -> None:
        """Tell a wall what there is until it closes, its session ends or it does not read on."""
        await websocket.accept()
        self.walls += 1
        try:
            async with asyncio.TaskGroup() as group:
                group.create_task(self._hear_wall(websocket))
                while websocket.scope[PRESENT]() is not None:
                    told = msgspec.json.encode(wall_of(self._robots, self._feeds))
                    await taken(websocket.send_bytes(told), websocket, "wall", self.refused)
                    await asyncio.sleep(WALL_PERIOD_S)
                await websocket.close(NOT_KNOWN)
        except* (WebSocketDisconnect, RuntimeError):
            pass  # it is gone; sending to it is what says so
        finally:
            self.walls -= 1

    async def _hear_wall(self, websocket: WebSocket) -> None:
        """Until it is closed or falls silent: what it does not read would wait for minutes in its own machine."""
        loop = asyncio.get_running_loop()
        try:
            async with asyncio.timeout(SILENT_S) as patience:
                while (received := await websocket.receive())["type"] != "websocket.disconnect":
                    if received.get("text") == SEEN:
                        patience.reschedule(loop.time() + SILENT_S)
                    else:
                        self.refused["message from a wall"] += 1
        except TimeoutError:
            raise cut_off(websocket, "wall", self.refused) from None
        raise WebSocketDisconnect(1000)

    async def _page(self, websocket: WebSocket) -> None:
        if room := await self._room_of(websocket):
            await room.pages.serve(websocket)

    async def _view(self, websocket: WebSocket) -> None:
        if room := await self._room_of(websocket):
            await room.proxy.forward(websocket)

    async def _room_of(self, websocket: WebSocket) -> Room | None:
        """The room that a socket asks for; when there is none the socket is closed."""
        with contextlib.suppress(OperatorError):
            if room := await run_in_threadpool(self._rooms.open, websocket.path_params["name"]):
                return room
        self.refused["no such robot, or it does not answer"] += 1
        await websocket.close(NOT_KNOWN)
        return None

    async def _view_file(self, request: Request) -> Response:
        try:
            room = await run_in_threadpool(self._rooms.open, request.path_params["name"])
        except OperatorError as error:
            return PlainTextResponse(str(error), 503)
        return await room.proxy.page(request) if room else PlainTextResponse("There is no such robot.", 404)

    async def _stop_by_post(self, request: Request) -> Response:
        """STOP from the wall, or a page's second way. It opens nothing and waits for nobody."""
        name = request.path_params["name"]
        if room := self._rooms.get(name):
            return await stop_by_post(request, room.pages)
        if robot := self._robots.get(name):
            confirmed = await asyncio.wrap_future(robot.stop(request.scope[VISITOR].name, "pressed on the wall"))
            return JSONResponse({"ok": confirmed, "reasons": [] if confirmed else [UNCONFIRMED]})
        return PlainTextResponse("There is no such robot.", 404)
