"""Stands before everything that the front door serves: the right host name, our own pages only, and a session."""

import asyncio
import contextlib
import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from http.cookies import CookieError, SimpleCookie
from urllib.parse import urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocketClose

from app.people.sessions import Sessions, Visitor

VISITOR = "visitor"
"""Where in an ASGI scope the `Visitor` is found behind this door."""
PRESENT = "present"
"""And a function that gives the visitor as of now: with another role by then, or None when the session is over."""
TRANSPORT = "transport"
"""And one that gives the connection itself, for who has to end it without a farewell, or to keep little waiting in it."""
Address = tuple[str, int]
PUBLIC = frozenset(
    {
        "/sign-in",
        "/healthz",
        "/metrics",  # asks for a session, or for name and token, itself
        "/static/icon.svg",
        "/static/css/base.css",
        "/static/css/sign_in.css",
        # Under its other name of loopback the 3D view has a ticket and no cookie.
        "/static/js/viewer_frame.js",
    }
)
"""What is served to anybody: nothing of the robot."""
PAGES = ("/", "/sessions")
"""What people open by its address: who has no session gets one, or is asked to sign in."""
ROOM = re.compile(r"/robot/[^/]+/")
"""And the page of one watched robot."""
VIEW = "/viewer"
TICKET_MARK = "~"


@dataclass(frozen=True, slots=True)
class Cookie:
    """The session's cookie, as it is named and sent by a server on this port."""

    port: int
    tls: bool

    @property
    def name(self) -> str:
        """Cookies are shared by all ports of a host: two consoles must not sign each other's people out."""
        return f"__Host-cobra-{self.port}" if self.tls else f"cobra-{self.port}"

    def header(self, value: str) -> str:
        """Not for scripts, not for posts of foreign pages, and under TLS never without it."""
        return f"{self.name}={value}; Path=/; HttpOnly; SameSite=Lax{'; Secure' if self.tls else ''}"

    def end(self) -> str:
        """Makes the browser forget it."""
        return f"{self.header('')}; Max-Age=0"


def view_path(visitor: Visitor) -> str:
    """Where this visitor's 3D view is found without a cookie, under another name of the same machine; beside the page."""
    return f"{VIEW[1:]}/{TICKET_MARK}{visitor.ticket}/"


class Doorkeeper:
    """Lets in who asks for this console by its own name and has a session, and websockets and posts only from our own pages.

    A foreign site can make a browser open a websocket to loopback or resolve its own name to it; both show in the
    headers Origin and Host, which scripts cannot change. What is refused is counted in `refused`, by reason.
    """

    def __init__(
        self,
        app: ASGIApp,
        names: frozenset[str],
        sessions: Sessions,
        cookie: Cookie,
        refused: Counter[str],
        transport: Callable[[Address], asyncio.Transport | None],
    ) -> None:
        self._transport = transport
        self._app = app
        self._names = names
        self._sessions = sessions
        self._cookie = cookie
        self._refused = refused

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if foreign := self._foreign(scope):
            await self._refuse(foreign, 403, scope, receive, send)
            return
        hand_out = ""
        visitor = self._visitor(scope)
        page = scope["path"] in PAGES or ROOM.fullmatch(scope["path"])
        if visitor is None and (page or scope["path"] == "/stop") and (visitor := self._sessions.host()):
            # Without users the page itself hands out the session, and a program on this machine may STOP.
            hand_out = self._cookie.header(visitor.session) if page else ""
        if visitor is None and scope["path"] not in PUBLIC:
            if scope["type"] == "http" and page:
                await RedirectResponse("/sign-in", 303)(scope, receive, hardened(send))
            else:
                await self._refuse("no session", 401, scope, receive, send)
            return
        session = visitor.session if visitor else ""
        scope[VISITOR] = visitor
        scope[PRESENT] = lambda: self._sessions.find(session)
        scope[TRANSPORT] = partial(self._transport, scope["client"])
        await self._app(scope, receive, hardened(send, hand_out))

    async def _refuse(self, why: str, status: int, scope: Scope, receive: Receive, send: Send) -> None:
        self._refused[why] += 1
        reply = WebSocketClose(1008) if scope["type"] == "websocket" else Response(f"Refused: {why}", status)
        await reply(scope, receive, send)

    def _foreign(self, scope: Scope) -> str | None:
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

    def _visitor(self, scope: Scope) -> Visitor | None:
        place, ticketed, after = scope["path"].partition(f"{VIEW}/{TICKET_MARK}")
        if ticketed:
            ticket, _, rest = after.partition("/")
            scope["path"] = f"{place}{VIEW}/{rest}"
            scope["raw_path"] = scope["path"].encode()
            return self._sessions.find_ticket(ticket)
        return self._sessions.find(self._shown_cookie(scope))

    def _shown_cookie(self, scope: Scope) -> str:
        with contextlib.suppress(CookieError):
            cookies = SimpleCookie(Headers(scope=scope).get("cookie", ""))
            if self._cookie.name in cookies:
                return cookies[self._cookie.name].value
        return ""


def _hostname(url: str) -> str | None:
    with contextlib.suppress(ValueError):
        return urlsplit(url).hostname
    return None


def hardened(send: Send, set_cookie: str = "") -> Send:
    """`send` with the headers that everything of ours carries."""

    async def with_headers(message: Message) -> None:
        if message["type"] == "http.response.start":
            headers = MutableHeaders(scope=message)
            headers.setdefault("x-content-type-options", "nosniff")
            headers.setdefault("referrer-policy", "no-referrer")
            headers.setdefault("cache-control", "no-cache")
            if set_cookie:
                headers.append("set-cookie", set_cookie)
        await send(message)

    return with_headers
