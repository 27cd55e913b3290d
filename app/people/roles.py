"""What each role may do. Decided in the server for every message; the page only shows what makes sense."""

from typing import Literal

Role = Literal["viewer", "driver", "admin"]

ROLES: tuple[Role, ...] = ("viewer", "driver", "admin")
"""From the least to the most."""

FOR_EVERYBODY = frozenset({"stop"})
"""A stop is nobody's privilege."""
FOR_ADMINS = frozenset({"take", "quit"})
"""Against somebody's will, or for everybody at once."""


def at_least(role: Role, needed: Role) -> bool:
    return ROLES.index(role) >= ROLES.index(needed)


def may_ask(role: Role, what: str) -> bool:
    """Whether a role may make this request at all; whether it is granted is the robot's to say."""
    needed: Role = "viewer" if what in FOR_EVERYBODY else "admin" if what in FOR_ADMINS else "driver"
    return at_least(role, needed)
