"""viser knows no users: this makes it answer only who shows the secret of this run, in HTTP and at the websocket's handshake.

viser has no hook for that, so its `serve` is replaced while it is being constructed (viser is pinned to one version).
"""

import http
import inspect
import secrets
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import websockets.asyncio.server
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from app.console.viewer_proxy import BUFFER_BYTES, SECRET_HEADER

_one_at_a_time = threading.Lock()
_where_viser_looks: Any = websockets.asyncio.server


@contextmanager
def guarded(secret: str) -> Iterator[None]:
    """A viser server that is constructed inside answers only requests that carry the secret."""
    usual = websockets.asyncio.server.serve

    def serve(*arguments: Any, process_request: Callable[..., Any] | None = None, **options: Any) -> Any:
        async def judge(connection: ServerConnection, request: Request) -> Response | None:
            # The kernel would keep megabytes for a slow viewer, who would see them many seconds late.
            channel = connection.transport.get_extra_info("socket")
            channel.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER_BYTES)
            shown = request.headers.get(SECRET_HEADER, "")
            if not secrets.compare_digest(shown.encode(), secret.encode()):
                return connection.respond(http.HTTPStatus.FORBIDDEN, "Come through the front door.\n")
            answer = process_request(connection, request) if process_request else None
            return await answer if inspect.isawaitable(answer) else answer

        return usual(*arguments, process_request=judge, write_limit=BUFFER_BYTES // 2, **options)

    with _one_at_a_time:
        _where_viser_looks.serve = serve
        try:
            yield
        finally:
            _where_viser_looks.serve = usual
