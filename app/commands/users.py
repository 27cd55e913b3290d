"""`cobra-teleop users …`: who may sign in, and as what."""

from typing import Annotated

import tyro

from app.commands.command import Command
from app.people.roles import ROLES, Role

Name = Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="NAME")]
RoleName = Annotated[
    Role,
    tyro.conf.arg(help="viewer: looks, and may STOP. driver: also drives. admin: also takes over and quits."),
]


def add(name: Name, /, *, role: RoleName = "viewer") -> int:
    """Add a user and print the token to sign in with.

    Args:
        name: letters, digits, '.', '_' and '-'.
    """
    from app.people.users import Users

    users = Users()
    _tell_token(name, users.add(name, role), f"added as {role} to {users.path}")
    return 0


def renew(name: Name, /) -> int:
    """Give a user a new token; the old one and everything signed in with it end at once.

    Args:
        name: of a user.
    """
    from app.people.users import Users

    _tell_token(name, Users().renew(name), "has a new token; whoever signed in with the old one is out")
    return 0


def role(name: Name, role: Annotated[Role, tyro.conf.Positional, tyro.conf.arg(metavar="ROLE")], /) -> int:
    """Change what a user may do; it holds at once.

    Args:
        name: of a user.
        role: viewer, driver or admin.
    """
    from app.people.users import Users

    Users().change_role(name, role)
    print(f"{name} is {role} now.")
    return 0


def remove(name: Name, /) -> int:
    """Remove a user; whoever is signed in under this name is out at once.

    Args:
        name: of a user.
    """
    from app.people.users import Users

    Users().remove(name)
    print(f"{name} is no user any more.")
    return 0


def list_users() -> int:
    """Print the users and their roles."""
    from app.people.users import Users

    users = Users()
    everybody = users.all()
    width = max(map(len, everybody), default=0)
    for rank in reversed(ROLES):
        for user in sorted((user for user in everybody.values() if user.role == rank), key=lambda user: user.name):
            print(f"{user.name:<{width}}  {user.role}")
    if not everybody:
        print("There are no users: pages open on this machine alone, without signing in.")
    return 0


def _tell_token(name: str, token: str, what: str) -> None:
    print(f"{name} {what}.\nToken (told this once, kept nowhere): {token}")


COMMANDS = (
    Command(
        "users add",
        "let somebody sign in; prints their token",
        add,
        "  cobra-teleop users add anna --role driver\n  cobra-teleop users add wall --role viewer",
    ),
    Command("users list", "who may sign in, and as what", list_users, "  cobra-teleop users list"),
    Command("users role", "change what somebody may do", role, "  cobra-teleop users role anna admin"),
    Command("users renew", "a new token in place of a lost one", renew, "  cobra-teleop users renew anna"),
    Command("users remove", "somebody may not sign in any more", remove, "  cobra-teleop users remove anna"),
)
