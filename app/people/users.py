"""The users' file: names, roles and the hashes of their tokens. Tokens themselves are kept nowhere."""

import hashlib
import hmac
import re
import secrets
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta

from app.people.roles import ROLES, Role
from app.places import config_folder, write_private
from cobra.errors import OperatorError

NAME = r"\A[a-zA-Z0-9][a-zA-Z0-9._-]{0,31}\Z"
TOKEN_BYTES = 20
"""160 bits: not to be guessed, whoever tries how fast."""
SCRYPT = {"n": 2**14, "r": 8, "p": 1, "dklen": 32}
"""16 MB and about 50 ms a try."""


class UsersError(OperatorError):
    """The users' file cannot be used, or a user in it is not as needed. The message says which and how it is mended."""


class User(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Somebody who may sign in. `salt` and `hash` (scrypt) are hexadecimal."""

    name: Annotated[str, Meta(pattern=NAME)]
    role: Role
    salt: Annotated[str, Meta(pattern="^[0-9a-f]{32}$")]
    hash: Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]

    def has(self, token: str) -> bool:
        """Whether this is the user's token. Takes about 50 ms of one core, whatever it is given."""
        return hmac.compare_digest(_hash(token, self.salt), self.hash)


NOBODY = User(name="nobody", role="viewer", salt=secrets.token_hex(16), hash=secrets.token_hex(32))
"""Who is asked when a name is unknown, so that the answer takes as long and does not tell that it is."""


class Users:
    """The users in one file (mode 0600), read anew whenever it changed: a removed user is out at once."""

    def __init__(self, path: Path | None = None) -> None:
        self.path = path or config_folder() / "users.json"
        self._seen: tuple[int, int] | None = None
        self._users: dict[str, User] = {}

    def all(self) -> dict[str, User]:
        """By name. Cheap while the file stays the same.

        Raises:
            UsersError: the file is there but cannot be read.
        """
        try:
            stat = self.path.stat()
        except FileNotFoundError:
            self._seen, self._users = None, {}
            return {}
        except OSError as error:
            raise UsersError(f"{self.path}: cannot be read: {error.strerror}") from None
        if stat.st_mode & 0o077:
            raise UsersError(f"{self.path}: others may read it (mode {stat.st_mode & 0o777:o}): chmod 600 {self.path}")
        if (seen := (stat.st_mtime_ns, stat.st_ino)) != self._seen:
            self._users, self._seen = _read(self.path), seen
        return self._users

    def add(self, name: str, role: Role) -> str:
        """A new user; returns the token, which is told this once.

        Raises:
            UsersError: the name is taken, or no name.
        """
        if name in self.all():
            raise UsersError(f"{name!r} is a user already; a new token: cobra-teleop users renew {name}")
        return self._put(name, role)

    def renew(self, name: str) -> str:
        """A new token in place of the old one."""
        return self._put(name, self._existing(name).role)

    def change_role(self, name: str, role: Role) -> None:
        self._save({**self.all(), name: msgspec.structs.replace(self._existing(name), role=role)})

    def remove(self, name: str) -> None:
        self._existing(name)
        self._save({other: user for other, user in self.all().items() if other != name})

    def check(self, name: str, token: str) -> User | None:
        """The user whose name and token these are, or None. Takes about 50 ms of one core either way."""
        user = self.all().get(name, NOBODY)
        return user if user.has(token) and user is not NOBODY else None

    def _existing(self, name: str) -> User:
        users = self.all()
        if name not in users:
            raise UsersError(f"there is no user {name!r}; there are {', '.join(users) or 'none'}")
        return users[name]

    def _put(self, name: str, role: Role) -> str:
        if not re.fullmatch(NAME, name):
            raise UsersError(f"{name!r} is no name: letters, digits, '.', '_' and '-', at most 32")
        if role not in ROLES:
            raise UsersError(f"{role!r} is no role; there are {', '.join(ROLES)}")
        token, salt = secrets.token_urlsafe(TOKEN_BYTES), secrets.token_hex(16)
        self._save({**self.all(), name: User(name=name, role=role, salt=salt, hash=_hash(token, salt))})
        return token

    def _save(self, users: dict[str, User]) -> None:
        data = msgspec.json.format(msgspec.json.encode(list(users.values())), indent=1)
        write_private(self.path, data + b"\n")


def _read(path: Path) -> dict[str, User]:
    try:
        users = msgspec.json.decode(path.read_bytes(), type=list[User])
    except (OSError, msgspec.MsgspecError) as error:
        raise UsersError(f"{path}: is no users' file: {error}; mend it, or remove it and add the users anew") from None
    return {user.name: user for user in users}


def _hash(token: str, salt: str) -> str:
    derive: Callable[..., bytes] = hashlib.scrypt
    return derive(token.encode(), salt=bytes.fromhex(salt), **SCRYPT).hex()
