"""Signing in and out: a form without scripts, rate-limited, that answers with the session's cookie."""

import asyncio
import html
import logging
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from urllib.parse import parse_qs

from starlette.requests import Request
from starlette.responses import HTMLResponse, RedirectResponse, Response
from starlette.routing import BaseRoute, Route

from app.console.doorkeeper import VISITOR, Cookie
from app.people.rate_limit import RateLimit, network_of
from app.people.sessions import Sessions, Visitor
from app.people.users import UsersError

TRIES, TRY_EVERY_S = 5, 10.0
"""From one network: so many at once, then one in so many seconds."""
MAX_WAITING = 4
"""Tries that wait for the one that is being checked; each takes 50 ms of a core, and the robot needs the others."""
MAX_FORM_BYTES = 4096
POLICY = "default-src 'self'; form-action 'self'; frame-ancestors 'none'; base-uri 'none'; object-src 'none'"
HEADERS = {
    "content-security-policy": POLICY,
    # With no-referrer browsers hide the Origin of a posted form, and the doorkeeper would refuse it.
    "referrer-policy": "same-origin",
    "cache-control": "no-store",
}

log = logging.getLogger("cobra.sign_in")


class SignIn:
    """The pages `/sign-in` and `/sign-out`. What was refused is counted by reason."""

    def __init__(self, sessions: Sessions, refused: Counter[str]) -> None:
        self._sessions = sessions
        self._refused = refused
        self._limit = RateLimit(TRIES, TRY_EVERY_S)
        self._waiting = 0
        self.on_session: Callable[[str, str, str], None] = lambda what, name, address: None
        """Told of every signing in, refusal and signing out: what, who (empty when unknown), from which address."""

    def start(self, page: Path, cookie: Cookie) -> None:
        """`page`: the form's HTML."""
        self._page = page
        self._cookie = cookie
        self._one_at_a_time = asyncio.Semaphore(1)

    def routes(self) -> Sequence[BaseRoute]:
        return (
            Route("/sign-in", self.form),
            Route("/sign-in", self.sign_in, methods=["POST"]),
            Route("/sign-out", self.sign_out, methods=["POST"]),
        )

    async def form(self, request: Request) -> Response:
        """The page to sign in with; where there are no users, or somebody is signed in, straight on."""
        if not self._sessions.sign_in_needed or request.scope[VISITOR]:
            return RedirectResponse("/", 303)
        return self._show("")

    async def sign_in(self, request: Request) -> Response:
        address = request.client.host if request.client else ""
        wait_s = self._limit.wait_s(network_of(address))
        if wait_s > 0.0 or self._waiting >= MAX_WAITING:
            self._refused["sign-in: too many tries"] += 1
            seconds = max(1, round(wait_s))
            reply = self._show(f"Too many tries. Wait {seconds} s, then try again.", 429)
            reply.headers["retry-after"] = str(seconds)
            return reply
        name, token = _fields(await _body(request))
        visitor = await self._check(name, token)
        if visitor is None:
            self._refused["sign-in: wrong name or token"] += 1
            self.on_session("sign-in refused", "", address)
            return self._show("Name and token do not belong together.", 401, name)
        self.on_session("signed in", visitor.name, address)
        return RedirectResponse("/", 303, {"set-cookie": self._cookie.header(visitor.session)})

    async def sign_out(self, request: Request) -> Response:
        visitor: Visitor = request.scope[VISITOR]
        self._sessions.sign_out(visitor.session)
        self.on_session("signed out", visitor.name, request.client.host if request.client else "")
        return RedirectResponse("/sign-in", 303, {"set-cookie": self._cookie.end()})

    async def _check(self, name: str, token: str) -> Visitor | None:
        self._waiting += 1
        try:
            async with self._one_at_a_time:
                return await asyncio.to_thread(self._sessions.sign_in, name, token)
        except UsersError as error:
            log.error("nobody can sign in: %s", error)
            return None
        finally:
            self._waiting -= 1

    def _show(self, problem: str, status: int = 200, name: str = "") -> HTMLResponse:
        text = self._page.read_text("utf-8")
        filled = text.replace("{{problem}}", html.escape(problem)).replace("{{name}}", html.escape(name[:32]))
        return HTMLResponse(filled, status, HEADERS)


async def _body(request: Request) -> bytes:
    """The posted form; what is longer than any form of ours is cut."""
    data = b""
    async for chunk in request.stream():
        data += chunk
        if len(data) > MAX_FORM_BYTES:
            break
    return data[:MAX_FORM_BYTES]


def _fields(body: bytes) -> tuple[str, str]:
    try:
        form = parse_qs(body.decode(), max_num_fields=8)
    except ValueError:
        form = {}
    return form.get("name", [""])[0].strip(), form.get("token", [""])[0].strip()
