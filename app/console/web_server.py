"""A web server in a thread of its own: for the console's front door, and for whatever else shows pages (a replay).

It lets in only who asks for it by its own name and has a session, and cuts whoever does not read when it ends.
"""

import asyncio
import contextlib
import socket
import threading
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Coroutine, Sequence
from types import TracebackType
from typing import Any, Self, TypedDict

import uvicorn
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.routing import BaseRoute
from websockets.exceptions import InvalidState

from app.console.doorkeeper import Address, Cookie, Doorkeeper
from app.console.listening import Tls
from app.console.sign_in import SignIn
from app.console.static_folder import static_folder
from app.people.sessions import Sessions
from cobra.control.realtime import ask_for_realtime

LOOPBACK_NAMES = ("127.0.0.1", "localhost", "::1")
WILDCARDS = ("0.0.0.0", "::")
SEND_BUFFER_BYTES = 32 * 1024
"""Of each connection. A bigger one only lets a slow viewer see older pictures."""
GRACE_S = 0.5
"""Connections that did not close by themselves after this long are cut."""


class Door(TypedDict, total=False):
    """How people come in."""

    names: tuple[str, ...]
    """Further names, beside loopback's, under which browsers may come."""
    sessions: Sessions | None
    """Who is let in, as what; by default everybody, as the one who started the program."""
    tls: Tls | None
    """Certificate and key; without them what is sent can be read on the way."""


class WebServer(ABC):
    """Serves routes. `start()` gives them, so that they may need the server itself.

    Args:
        host: address to listen on.
        port: port to listen on; 0 takes a free one.
        names, sessions, tls: see `Door`.
    """

    realtime_priority: int | None = None
    """What its thread asks for; None: none."""

    def __init__(
        self,
        host: str,
        port: int,
        names: tuple[str, ...] = (),
        sessions: Sessions | None = None,
        tls: Tls | None = None,
    ) -> None:
        self.host = host
        self.port = port
        self.refused: Counter[str] = Counter()
        """What was refused at the door, by reason."""
        self.sessions = sessions or Sessions(None, "host")
        self.signing = SignIn(self.sessions, self.refused)
        self._tls = tls
        self._names = frozenset((*LOOPBACK_NAMES, host, *(name.lower() for name in names)))
        self._server: uvicorn.Server | None = None
        self._thread: threading.Thread | None = None

    @property
    def url(self) -> str:
        named = socket.gethostname() if self.host in WILDCARDS else self.host
        return f"{'https' if self._tls else 'http'}://{f'[{named}]' if ':' in named else named}:{self.port}/"

    @abstractmethod
    def routes(self) -> Sequence[BaseRoute]:
        """What is served.

        Raises:
            OSError: the pages' files are missing.
        """

    def start(self) -> None:
        """Listen and serve. When this returns, browsers can connect.

        Raises:
            OSError: the port is taken, the address is not ours, or the pages' files are missing.
        """
        routes = self.routes()
        family = socket.AF_INET6 if ":" in self.host else socket.AF_INET
        listener = socket.create_server((self.host, self.port), family=family)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        self.port = listener.getsockname()[1]
        self.signing.start(static_folder() / "sign_in.html", cookie := Cookie(self.port, self._tls is not None))
        guard = Middleware(
            Doorkeeper,
            names=self._names,
            sessions=self.sessions,
            cookie=cookie,
            refused=self.refused,
            transport=self._transport,
        )
        config = uvicorn.Config(
            Starlette(routes=[*self.signing.routes(), *routes], middleware=[guard]),
            ssl_certfile=self._tls.certificate if self._tls else None,
            ssl_keyfile=self._tls.key if self._tls else None,
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
        self._thread = threading.Thread(target=self._run, args=(serving,), name="front door", daemon=True)
        self._thread.start()

    def _run(self, serving: Coroutine[Any, Any, None]) -> None:
        if self.realtime_priority is not None:
            ask_for_realtime(self.realtime_priority)
        asyncio.run(serving)

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

    def _transport(self, browser: Address) -> asyncio.Transport | None:
        """The connection of a browser."""
        assert self._server is not None
        for connection in list(self._server.server_state.connections):
            transport: asyncio.Transport = connection.transport
            if transport.get_extra_info("peername", ())[:2] == tuple(browser):
                return transport
        return None

    async def _serve(self, server: uvicorn.Server, listener: socket.socket) -> None:
        serving = asyncio.create_task(server.serve([listener]))
        while not server.should_exit and not serving.done():
            await asyncio.wait((serving,), timeout=0.05)
        await asyncio.wait((serving,), timeout=GRACE_S)
        server.force_exit = True
        for connection in list(server.server_state.connections):
            # A browser that does not read keeps its connection open for ever: what is left for it is thrown away.
            connection.transport.abort()
        with contextlib.suppress(InvalidState):  # uvicorn closes those too that are closing already
            await serving
