"""`cobra-teleop router …`: the way between networks."""

from pathlib import Path
from typing import Annotated, Literal

import tyro

from app.commands.command import Command

Accounts = Annotated[
    Path, tyro.conf.arg(metavar="FILE", help="Accounts that may connect; only its owner may read the file.")
]


def serve(
    *,
    accounts: Accounts,
    listen: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="ENDPOINT", help="Where to listen, such as tls/0.0.0.0:7447.")
    ] = ("tcp/127.0.0.1:7447",),
    tls_cert: Annotated[
        Path | None, tyro.conf.arg(metavar="FILE", help="Certificate for tls/ endpoints (PEM).")
    ] = None,
    tls_key: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help="Its private key (PEM).")] = None,
    insecure: Annotated[bool, tyro.conf.arg(help="Allow endpoints beyond loopback without TLS.")] = False,
) -> int:
    from app.link.access import LinkError, on_loopback
    from app.router import run_router

    plain = [place for place in listen if not place.startswith("tls/") and not on_loopback(place)]
    if plain and not insecure:
        raise LinkError(f"{', '.join(plain)} is open to the network without TLS: use tls/… or say --insecure")
    return run_router(listen, accounts, tls_cert, tls_key)


def account(
    name: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="NAME")],
    /,
    *,
    accounts: Accounts,
    role: Literal["robot", "driver", "viewer"] = "viewer",
    out: Annotated[
        Path | None, tyro.conf.arg(metavar="FILE", help="What its owner connects with; NAME.account.")
    ] = None,
) -> int:
    """Add an account to a router.

    Args:
        name: Of the account; a robot's account bears the name of the robot.
        role: What it may do.
    """
    from app.router import add_account

    target = out or Path(f"{name}.account")
    add_account(accounts, name, role, target)
    print(f"{name} may connect as {role}. Give {target} to its owner, and to nobody else.")
    return 0


SERVE = Command(
    "router serve",
    "route between robots, drivers and viewers in several networks",
    serve,
    "  cobra-teleop router serve --accounts accounts.json\n"
    "  cobra-teleop router serve --accounts accounts.json --listen tls/0.0.0.0:7447 \\\n"
    "      --tls-cert router.pem --tls-key router.key",
)
ACCOUNT = Command(
    "router account",
    "let a robot, a driver or a viewer connect to a router",
    account,
    "  cobra-teleop router account cobra --role robot --accounts accounts.json\n"
    "  cobra-teleop router account control-room --role viewer --accounts accounts.json",
)
