"""A web server in a thread of its own: for the console's front door, and for whatever else shows pages (a replay).

It lets in only who asks for it by its own name, and cuts whoever does not read when it ends.
"""

import asyncio
import contextlib
import socket
import threading
from collections import Counter
from collections.abc import Sequence
from types import TracebackType
from typing import Self
from urllib.parse import urlsplit

import uvicorn
from starlette.applications import Starlette
from starlette.datastructures import Headers, MutableHeaders
from starlette.middleware import Middleware
from starlette.responses import Response
from starlette.routing import BaseRoute
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocketClose

LOOPBACK_NAMES = ("127.0.0.1", "localhost", "::1")
SEND_BUFFER_BYTES = 64 * 1024
"""Of each connection. A bigger one only lets a slow viewer see older pictures."""
GRACE_S = 0.5
"""Connections that did not close by themselves after this long are cut."""


class WebServer:
    """Serves routes. `start()` gives them, so that they may need the server itself.

    Args:
        host: address to listen on.
        port: port to listen on; 0 takes a free one.
        names: further names, beside loopback's, under which browsers may come.
    """

    def __init__(self, host: str, port: int, names: tuple[str, ...] = ()) -> None:
        self.host = host
        self.port = port
        self.refused: Counter[str] = Counter()
        """What was refused at the door, by reason."""
        self._names = frozenset((*LOOPBACK_NAMES, host, *names))
        self._server: uvicorn.Server | None = None
        self._thread: threading.Thread | None = None

    @property
    def url(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{host}:{self.port}/"

    def routes(self) -> Sequence[BaseRoute]:
        """What is served.

        Raises:
            OSError: the pages' files are missing.
        """
        raise NotImplementedError

    def start(self) -> None:
        """Listen and serve. When this returns, browsers can connect.

        Raises:
            OSError: the port is taken, the address is not ours, or the pages' files are missing.
        """
        application = Starlette(
            routes=self.routes(), middleware=[Middleware(_Doorkeeper, names=self._names, refused=self.refused)]
        )
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
