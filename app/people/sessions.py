"""Who is signed in. A session is a random cookie; what it may do is looked up anew each time it is shown."""

import secrets
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from app.people.roles import Role, at_least
from app.people.users import User, Users, UsersError

IDLE_S = 12 * 3600.0
"""A session that was not used for this long is over."""
MAX_SESSIONS = 20
"""Of one user; the one that was idle the longest makes room."""


@dataclass(frozen=True, slots=True)
class Visitor:
    """Somebody who came through the front door."""

    name: str
    role: Role
    session: str = ""
    """Secret: the cookie's value."""
    ticket: str = ""
    """Secret: opens the 3D view alone, under a name of this machine that the cookie is not valid for."""


@dataclass(slots=True)
class _Session:
    visitor: Visitor
    token_hash: str
    seen_s: float


class Sessions:
    """All open sessions. Safe from any thread.

    Without users (`users` is None or empty) everybody who comes is `host`, the one who started the program, as admin:
    that is for loopback, where a first try should open straight into driving.
    """

    def __init__(
        self, users: Users | None, host: str, now: Callable[[], float] = time.monotonic, most: Role = "admin"
    ) -> None:
        """`most`: nobody may do more than this role here."""
        self._most = most
        self._users = users
        self._now = now
        self._lock = threading.Lock()
        self._sessions: dict[str, _Session] = {}
        self._tickets: dict[str, str] = {}
        self._host = Visitor(host, most, secrets.token_urlsafe(32), secrets.token_urlsafe(16))
        self._open = users is None or not users.all()

    @property
    def sign_in_needed(self) -> bool:
        """Whether users are configured. Users that are added while the program runs count from its next start."""
        return not self._open

    def sign_in(self, name: str, token: str) -> Visitor | None:
        """A new session, or None when name and token do not belong together. Takes about 50 ms of one core."""
        user = self._users.check(name, token) if self._users else None
        if user is None:
            return None
        visitor = Visitor(user.name, self._role(user), secrets.token_urlsafe(32), secrets.token_urlsafe(16))
        with self._lock:
            own = [key for key, session in self._sessions.items() if session.visitor.name == user.name]
            for key in sorted(own, key=lambda key: self._sessions[key].seen_s)[: max(0, len(own) + 1 - MAX_SESSIONS)]:
                self._forget(key)
            self._sessions[visitor.session] = _Session(visitor, user.hash, self._now())
            self._tickets[visitor.ticket] = visitor.session
        return visitor

    def knows(self, name: str, token: str) -> bool:
        """Whether name and token belong together; opens no session. Takes about 50 ms of one core."""
        return self._users is not None and self._users.check(name, token) is not None

    def host(self) -> Visitor | None:
        """The visitor whom everybody is while there are no users, else None."""
        return self._host if self._open else None

    def find(self, session: str) -> Visitor | None:
        """Whose session this is, with the role of this moment; None when it is over."""
        if self._open:
            return self._host if secrets.compare_digest(session.encode(), self._host.session.encode()) else None
        user = self._user(session)
        with self._lock:
            known = self._sessions.get(session)
            if known is None:
                return None
            valid = user is not None and user.hash == known.token_hash
            if not valid or self._now() - known.seen_s > IDLE_S:
                self._forget(session)
                return None
            known.seen_s = self._now()
            visitor = known.visitor
        assert user is not None
        role = self._role(user)
        return visitor if role == visitor.role else Visitor(user.name, role, session, visitor.ticket)

    def find_ticket(self, ticket: str) -> Visitor | None:
        """Whose view ticket this is."""
        if self._open:
            return self._host if secrets.compare_digest(ticket.encode(), self._host.ticket.encode()) else None
        return self.find(self._tickets.get(ticket, ""))

    def sign_out(self, session: str) -> None:
        with self._lock:
            if session in self._sessions:
                self._forget(session)

    def _role(self, user: User) -> Role:
        return self._most if at_least(user.role, self._most) else user.role

    def _user(self, session: str) -> User | None:
        known = self._sessions.get(session)
        if known is None or self._users is None:
            return None
        try:
            return self._users.all().get(known.visitor.name)
        except UsersError:
            return None  # a file that cannot be read lets nobody in

    def _forget(self, session: str) -> None:
        gone = self._sessions.pop(session)
        self._tickets.pop(gone.visitor.ticket, None)
