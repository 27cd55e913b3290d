"""`/metrics` for Prometheus: to whoever has a session, and to a program with a user's name and token (HTTP Basic)."""

import asyncio
import base64
import binascii
import hashlib
import time
from collections import Counter

from starlette.requests import Request
from starlette.responses import Response

from app.console.doorkeeper import VISITOR
from app.metrics import CONTENT_TYPE, Metrics
from app.people.rate_limit import RateLimit, network_of
from app.people.sessions import Sessions
from app.people.users import UsersError

TRIES, TRY_EVERY_S = 5, 10.0
TRUSTED_S = 60.0
"""A token that was right is not hashed slowly again for this long: a scrape comes every few seconds."""


class Scrape:
    """Answers scrapes. A token is as hard to guess here as at the sign-in page."""

    def __init__(self, metrics: Metrics, sessions: Sessions, refused: Counter[str]) -> None:
        self._metrics = metrics
        self._sessions = sessions
        self._refused = refused
        self._limit = RateLimit(TRIES, TRY_EVERY_S)
        self._trusted: dict[bytes, float] = {}
        self._one_at_a_time = asyncio.Lock()

    async def answer(self, request: Request) -> Response:
        """The metrics as text."""
        if request.scope[VISITOR] is None and not self._sessions.host() and not await self._knows(request):
            self._refused["metrics without a session"] += 1
            return Response("Sign in, or send a user's name and token.\n", 401, {"www-authenticate": "Basic"})
        return Response(await asyncio.to_thread(self._metrics.text), media_type=CONTENT_TYPE)

    async def _knows(self, request: Request) -> bool:
        scheme, _, given = request.headers.get("authorization", "").partition(" ")
        if scheme.lower() != "basic":
            return False
        try:
            name, _, token = base64.b64decode(given, validate=True).decode().partition(":")
        except (binascii.Error, UnicodeDecodeError):
            return False
        shown = hashlib.sha256(given.encode()).digest()
        if self._trusted.get(shown, 0.0) > time.monotonic():
            return True
        if self._limit.wait_s(network_of(request.client.host if request.client else "")) > 0.0:
            return False
        async with self._one_at_a_time:
            try:
                right = await asyncio.to_thread(self._sessions.knows, name, token)
            except UsersError:
                return False
        if right:
            self._trusted = {shown: time.monotonic() + TRUSTED_S}
        return right
