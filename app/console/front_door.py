"""The one port that browsers come to: the operator's page, its websocket, and viser behind a proxy."""

import asyncio
import contextlib
import re
import socket
import threading
from collections import Counter
from pathlib import Path
from types import TracebackType
from typing import Self
from urllib.parse import urlsplit

import uvicorn
from starlette.applications import Starlette
from starlette.datastructures import Headers, MutableHeaders
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocketClose

from app.console.page_socket import PageSession, PageSocket
from app.console.viewer_proxy import ViewerProxy

LOOPBACK_NAMES = ("127.0.0.1", "localhost", "::1")
SEND_BUFFER_BYTES = 64 * 1024
"""Of each connection. A bigger one only lets a slow viewer see older pictures."""
GRACE_S = 0.5
"""Connections that did not close by themselves after this long are cut."""

POLICY = "; ".join(
    (
        "default-src 'self'",
        "img-src 'self' data:",
        "frame-src 'self' http://localhost:* http://127.0.0.1:*",
        "object-src 'none'",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'none'",
    )
)
"""The operator's page runs and shows only what comes from here, and nobody can frame it under false buttons."""

_COUNTING = re.compile(r"[0-9]{1,9}")


def static_folder() -> Path:
    """Where the pages lie: inside the installed package, else beside it in a checkout.

    Raises:
        FileNotFoundError: in neither place.
    """
    package = Path(__file__).resolve().parents[1]
    places = (package / "static", package.parent / "static")
    for folder in places:
        if (folder / "index.html").is_file():
            return folder
    raise FileNotFoundError(f"the pages are missing: there is no index.html in {places[0]} nor in {places[1]}")


class FrontDoor:
    """The web server, in a thread of its own.

    Args:
        host: address to listen on.
        port: port to listen on; 0 takes a free one.
        viewer_port: where viser listens on loopback.
        session: what answers the pages.
        names: further names, beside loopback's, under which browsers may come.
    """

    def __init__(
        self, host: str, port: int, viewer_port: int, session: PageSession, names: tuple[str, ...] = ()
    ) -> None:
        self.host = host
        self.port = port
        self._session = session
        self._names = frozenset((*LOOPBACK_NAMES, host, *names))
        self._pages = PageSocket(session)
        self._proxy = ViewerProxy(viewer_port)
        self._refused: Counter[str] = Counter()
        self._server: uvicorn.Server | None = None
        self._thread: threading.Thread | None = None

    @property
    def url(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{host}:{self.port}/"

    @property
    def counts(self) -> Counter[str]:
        """What was refused or dropped since the start, by reason."""
        return self._pages.counts + self._proxy.counts + self._refused

    def start(self) -> None:
        """Listen and serve. When this returns, browsers can connect.

        Raises:
            OSError: the port is taken, the address is not ours, or the pages' files are missing.
        """
        application = self._application()
        family = socket.AF_INET6 if ":" in self.host else socket.AF_INET
        listener = socket.create_server((self.host, self.port), family=family)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        self.port = listener.getsockname()[1]
        config = uvicorn.Config(
            application,
            log_config=None,
            log_level="warning",
            access_log=False,
            proxy_headers=False,
            server_header=False,
            ws_per_message_deflate=False,
            lifespan="off",
        )
        self._server = uvicorn.Server(config)
        serving = self._serve(self._server, listener)
        self._thread = threading.Thread(target=asyncio.run, args=(serving,), name="front door", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Close all connections and the port; returns within a second, whatever the browsers do."""
        if self._server is not None and self._thread is not None:
            self._server.should_exit = True
            self._thread.join()
            self._server = self._thread = None

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    async def _serve(self, server: uvicorn.Server, listener: socket.socket) -> None:
        serving = asyncio.create_task(server.serve([listener]))
        while not server.should_exit and not serving.done():
            await asyncio.wait((serving,), timeout=0.05)
        await asyncio.wait((serving,), timeout=GRACE_S)
        server.force_exit = True
        for connection in list(server.server_state.connections):
            # A browser that does not read keeps its connection open for ever: what is left for it is thrown away.
            connection.transport.abort()
        await serving

    def _application(self) -> ASGIApp:
        index = static_folder() / "index.html"

        async def page(request: Request) -> Response:
            return FileResponse(index, headers={"content-security-policy": POLICY, "cache-control": "no-cache"})

        routes = [
            Route("/", page),
            Route("/healthz", self._health),
            Route("/stop", self._stop_by_post, methods=["POST"]),
            Route("/viewer", self._proxy.page),
            Route("/viewer/{path:path}", self._proxy.page),
            WebSocketRoute("/viewer", self._proxy.forward),
            WebSocketRoute("/viewer/", self._proxy.forward),
            WebSocketRoute("/ws", self._pages.serve),
            Mount("/static", StaticFiles(directory=static_folder())),
        ]
        return Starlette(routes=routes, middleware=[Middleware(_Doorkeeper, names=self._names, refused=self._refused)])

    async def _health(self, request: Request) -> Response:
        return JSONResponse(
            {"ok": True, "pages": self._pages.pages, "viewers": self._proxy.viewers, "counts": dict(self.counts)}
        )

    async def _stop_by_post(self, request: Request) -> Response:
        """STOP's second way: a page takes both at once, in case its websocket is dead without knowing it."""
        page, press = (request.query_params.get(name, "") for name in ("page", "press"))
        who = f"page {page}" if _COUNTING.fullmatch(page) else "a page"
        return JSONResponse(await self._pages.stop(who, int(press) if _COUNTING.fullmatch(press) else None))


class _Doorkeeper:
    """Lets in who asks for this console by its own name, and websockets and posts only from our own pages.

    A foreign site can make a browser open a websocket to loopback or resolve its own name to it; both show in the
    headers Origin and Host, which scripts cannot change.
    """

    def __init__(self, app: ASGIApp, names: frozenset[str], refused: Counter[str]) -> None:
        self._app = app
        self._names = names
        self._refused = refused

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        refusal = self._refusal(scope)
        if refusal is None:
            await self._app(scope, receive, _hardened(send))
            return
        self._refused[refusal] += 1
        reply = WebSocketClose(1008) if scope["type"] == "websocket" else Response(f"Refused: {refusal}", 403)
        await reply(scope, receive, send)

    def _refusal(self, scope: Scope) -> str | None:
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        if _hostname(f"//{host}") not in self._names:
            return "foreign host name"
        origin = headers.get("origin")
        # A program that posts a STOP has no Origin; every browser sends one.
        needed = scope["type"] == "websocket" or (scope["method"] not in ("GET", "HEAD") and origin is not None)
        if needed and origin not in (f"http://{host}", f"https://{host}"):
            return "foreign origin"
        return None


def _hostname(url: str) -> str | None:
    with contextlib.suppress(ValueError):
        return urlsplit(url).hostname
    return None


def _hardened(send: Send) -> Send:
    async def with_headers(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            headers.setdefault("x-content-type-options", "nosniff")
            headers.setdefault("referrer-policy", "no-referrer")
            headers.setdefault("cache-control", "no-cache")
        await send(message)

    return with_headers
