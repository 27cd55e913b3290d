"""The way to viser: its page and its websocket, through the front door, with what a browser may send to it filtered.

viser itself knows no users and listens on loopback only. Any client of it may write any shared control and ask for a
public tunnel; so a frame passes only if its kind is on the list of the sender's role.
"""

import asyncio
import socket
import time
from collections import Counter
from collections.abc import Callable

import httpx
import msgspec
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import HTMLResponse, Response
from starlette.websockets import WebSocket, WebSocketDisconnect
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.typing import Subprotocol

from app.console.doorkeeper import PRESENT, TRANSPORT, VISITOR
from app.console.patience import taken
from app.people.roles import Role, at_least
from app.people.sessions import Visitor

LOOKING = frozenset(
    {
        "ViewerCameraMessage",
        "GetRenderResponseMessage",
        "LocalStorageGetItemResponseMessage",
    }
)
"""What viser's client sends only because somebody looks at the scene."""
OPERATING = frozenset(
    {
        "CommandTriggerMessage",
        "FileTransferPart",
        "FileTransferPartAck",
        "FileTransferStartUpload",
        "GuiButtonHoldMessage",
        "GuiFormDirtyMessage",
        "GuiFormSubmitMessage",
        "GuiUpdateMessage",
        "SceneNodeClickMessage",
        "SceneNodeDragMessage",
        "ScenePointerMessage",
        "TransformControlsDragEndMessage",
        "TransformControlsDragStartMessage",
        "TransformControlsUpdateMessage",
    }
)
"""What works the panels and gizmos. The share tunnel's requests are on no list."""

FRAME_SCRIPT = '<script src="/static/js/viewer_frame.js"></script>'
"""Mends viser's reconnecting and ties its page to the operator's page around it."""
NO_VIEWER = f"""<!doctype html><meta charset="utf-8">{FRAME_SCRIPT}<meta http-equiv="refresh" content="1">
<meta name="color-scheme" content="dark light"><title>No 3D view</title>
<body style="font:16px system-ui,sans-serif;display:grid;place-items:center;height:90vh;margin:0;opacity:.7">
<p>The 3D view is not running. Trying again every second.</p>"""

FRAMED_BY = {
    "content-security-policy": (
        "frame-ancestors 'self' http://localhost:* http://127.0.0.1:* https://localhost:* https://127.0.0.1:*"
    )
}
"""Only the operator's page may show the view inside itself, under whichever of loopback's names it was opened."""
MAX_FRAME_BYTES = 50 * 1024 * 1024
"""viser's own limit."""
BUFFER_BYTES = 16 * 1024
"""Between viser and here. Small, so that what a slow viewer has not taken yet stays in viser, where newer replaces older."""
CLOSE_TIMEOUT_S = 0.2
SECRET_HEADER = "x-cobra-secret"
"""What viser wants to see of whoever connects: other users of this machine do not know it."""
ROLE_HEADER, VIEW_HEADER = "x-cobra-role", "x-cobra-view"
"""Tell viser's side who looks, and which view the path asks for."""
PLAIN, THIN, TIP = "plain", "thin", "tip"
VIEWS = frozenset((PLAIN, THIN, TIP))
"""With these words in its path viser's page is found: without shadows, for slow links, from the tip."""
SESSION_CHECK_S = 1.0
SLOWEST_B_S = 20e3
"""A viewer has longer for what is large: a link that carries less than this shows nothing anyway."""
WATCH_S = 3.0
BLOCKED_SHARE = 0.5
"""A link that had to be waited for so much of the last `WATCH_S` does not carry what it is given."""
PAGE_MARK = "p-"
"""In a view's path: which page it is in, by a word of that page's own."""
KEPT = {"cache-control": "private, max-age=86400"}
"""viser's page is 800 kB and the same for all views; its address, with a ticket of the session, is not found again."""
Present = Callable[[], Visitor | None]
NO_CODE = (1005, 1006, 1015)
"""Close codes that say that none was received; they must not be sent."""


class _Envelope(msgspec.Struct):
    type: str


def may_pass(frame: bytes | str, role: Role) -> bool:
    """Whether a frame of viser's client may go on to viser. What cannot be decoded may not."""
    if isinstance(frame, str):
        return False
    try:
        kind = msgspec.msgpack.decode(frame, type=_Envelope).type
    except (msgspec.MsgspecError, RecursionError):
        return False
    return kind in LOOKING or (at_least(role, "driver") and kind in OPERATING)


class ViewerProxy:
    """Forwards `/viewer/` to viser on a port of loopback. `counts` holds what was not forwarded, by reason."""

    def __init__(self, viewer_port: int, secret: str = "", thin: Callable[[], tuple[int, str]] | None = None) -> None:
        """`thin` gives port and secret of a viser server with less in it, and may block; None: all get the full one."""
        self.counts: Counter[str] = Counter()
        self.viewers = 0
        self._full = viewer_port, secret
        self._thin = thin
        self.behind: Counter[str] = Counter()
        """Views that their links do not carry, by the pages that they are in."""

    async def page(self, request: Request) -> Response:
        """viser's files; its page with a script of ours ahead of its own."""
        path = request.path_params.get("path", "")
        words = [word for word in path.split("/") if word and not word.startswith(PAGE_MARK)]
        path = "" if VIEWS.issuperset(words) else path
        port, secret = self._full  # their pages are the same
        if ".." in path.replace("\\", "/").split("/") or not path.isprintable():
            return Response("Not found", 404)
        # A client for each request: the page is loaded once in hours. Plain HTTP, so no TLS context has to be built.
        async with httpx.AsyncClient(trust_env=False, verify=False) as client:
            try:
                found = await client.get(
                    httpx.URL(f"http://127.0.0.1:{port}", path=f"/{path}"),
                    headers={"accept-encoding": "identity", SECRET_HEADER: secret},
                )
            except httpx.HTTPError:
                self.counts["viser did not answer"] += 1
                return HTMLResponse(NO_VIEWER, 503, FRAMED_BY)
        kind = found.headers.get("content-type", "application/octet-stream")
        content = found.content
        kept = {}
        if kind.startswith("text/html"):
            content = found.text.replace("<head>", f"<head>{FRAME_SCRIPT}", 1).encode()
            kept = KEPT if found.status_code == 200 else {}
        return Response(content, found.status_code, {"content-type": kind, **kept, **FRAMED_BY})

    async def forward(self, websocket: WebSocket) -> None:
        """Join one viewer with viser until either side, or the viewer's session, ends it."""
        visitor, present = websocket.scope[VISITOR], websocket.scope[PRESENT]
        words = websocket.path_params.get("path", "").split("/")
        pages = [word for word in words if word.startswith(PAGE_MARK)]
        headers = {ROLE_HEADER: visitor.role, VIEW_HEADER: " ".join(VIEWS.intersection(words))}
        try:
            port, secret = await run_in_threadpool(self._thin) if self._thin and THIN in words else self._full
            viser = await _open(port, websocket.scope["subprotocols"], {**headers, SECRET_HEADER: secret})
        except (OSError, TimeoutError, InvalidHandshake):
            self.counts["viser did not answer"] += 1
            await websocket.close(1013)
            return
        self.viewers += 1
        try:
            async with viser, asyncio.TaskGroup() as group:
                await websocket.accept(viser.subprotocol)
                group.create_task(self._upwards(websocket, viser, present))
                group.create_task(self._downwards(websocket, viser, pages))
                group.create_task(self._end_with_session(websocket, present))
        except* WebSocketDisconnect:
            pass
        finally:
            self.viewers -= 1

    async def _end_with_session(self, websocket: WebSocket, present: Present) -> None:
        while present() is not None:
            await asyncio.sleep(SESSION_CHECK_S)
        await websocket.close(1008)
        raise WebSocketDisconnect(1008)

    async def _upwards(self, websocket: WebSocket, viser: ClientConnection, present: Present) -> None:
        while True:
            received = await websocket.receive()
            if received["type"] == "websocket.disconnect":
                raise WebSocketDisconnect(received.get("code", 1005))
            frame = received.get("bytes") or received.get("text") or b""
            visitor = present()
            if visitor is None or not may_pass(frame, visitor.role):
                self.counts["message to viser that is not allowed"] += 1
                continue
            try:
                await viser.send(frame)
            except ConnectionClosed as closed:
                raise WebSocketDisconnect(1001) from closed

    async def _downwards(self, websocket: WebSocket, viser: ClientConnection, pages: list[str]) -> None:
        watch = _Watch()
        if connection := websocket.scope[TRANSPORT]():
            connection.set_write_buffer_limits(BUFFER_BYTES)
        try:
            while True:
                frame = await viser.recv()
                sending = websocket.send_bytes(frame) if isinstance(frame, bytes) else websocket.send_text(frame)
                with watch:
                    await taken(sending, websocket, "viewer", self.counts, len(frame) / SLOWEST_B_S)
                if watch.changed():
                    self._tell(pages, watch.full)
        except ConnectionClosed as closed:
            code = closed.rcvd.code if closed.rcvd else 1001
            await websocket.close(1001 if code in NO_CODE else code, closed.rcvd.reason if closed.rcvd else "")
            raise WebSocketDisconnect(code) from closed
        finally:
            if watch.full:
                self._tell(pages, False)

    def _tell(self, pages: list[str], full: bool) -> None:
        """A page may have two views."""
        for page in pages:
            self.behind[page] += 1 if full else -1
            if not self.behind[page]:
                del self.behind[page]


class _Watch:
    """Whether a link is full: how much of the time it had to be waited for. Entered for each sending."""

    def __init__(self) -> None:
        self.full = False
        self._since = self._began = time.monotonic()
        self._waited_s = 0.0

    def __enter__(self) -> None:
        self._began = time.monotonic()

    def __exit__(self, *_: object) -> None:
        self._waited_s += time.monotonic() - self._began

    def changed(self) -> bool:
        """Whether `full` has just changed."""
        now, before = time.monotonic(), self.full
        if now - self._since > WATCH_S:
            self.full = self._waited_s > BLOCKED_SHARE * (now - self._since)
            self._since, self._waited_s = now, 0.0
        return self.full != before


async def _open(port: int, subprotocols: list[str], headers: dict[str, str]) -> ClientConnection:
    channel = socket.socket()
    channel.setblocking(False)
    channel.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
    try:
        await asyncio.get_running_loop().sock_connect(channel, ("127.0.0.1", port))
        return await connect(
            f"ws://127.0.0.1:{port}/",
            sock=channel,
            subprotocols=[Subprotocol(name) for name in subprotocols] or None,
            additional_headers=headers,
            compression=None,
            max_size=MAX_FRAME_BYTES,
            max_queue=1,
            close_timeout=CLOSE_TIMEOUT_S,
        )
    except BaseException:
        channel.close()
        raise
