"""How a Zenoh session is opened: endpoints, account and certificates. No scouting, no multicast."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import zenoh

from cobra.errors import OperatorError


class LinkError(OperatorError):
    """The link could not be opened, or nobody answered. The message says what was tried."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LinkAccess:
    """What a router asks of those who connect."""

    account: Path | None = None
    """File with one line, name:password, that only its owner may read."""
    ca: Path | None = None
    """Certificate of the authority that signed the router's, for tls/ endpoints (PEM)."""


DIRECT = LinkAccess()
"""Without account and certificates: on loopback."""


def open_session(
    mode: Literal["peer", "client", "router"],
    *,
    listen: tuple[str, ...] = (),
    connect: tuple[str, ...] = (),
    access: LinkAccess = DIRECT,
    settings: Mapping[str, Any] | None = None,
) -> zenoh.Session:
    """Open a session.

    Args:
        settings: further settings of Zenoh by their path, "transport/link/…".

    Raises:
        LinkError: an endpoint is taken, nobody listens there, or account and certificates do not fit.
    """
    config = zenoh.Config()
    wanted: dict[str, Any] = {
        "mode": mode,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "listen/endpoints": list(listen),
        "connect/endpoints": list(connect),
        **(settings or {}),
    }
    if access.account is not None:
        user, password = read_account(access.account)
        wanted |= {"transport/auth/usrpwd/user": user, "transport/auth/usrpwd/password": password}
    if access.ca is not None:
        if not access.ca.is_file():
            raise LinkError(f"{access.ca}: there is no certificate of the authority (PEM) here")
        wanted["transport/link/tls/root_ca_certificate"] = str(access.ca.absolute())
    places = ", ".join((*listen, *connect))
    try:
        for path, value in wanted.items():
            config.insert_json5(path, json.dumps(value))
        return zenoh.open(config)
    except zenoh.ZError as error:
        reason = str(error).split(" at /")[0].rstrip(".")
        hint = ""
        if connect:
            hint = (
                " (nobody listens there: start a robot with `cobra-teleop robot`, or the router)"
                if access == DIRECT
                else " (wrong account, wrong certificate, or nobody listens there)"
            )
        raise LinkError(f"cannot open the link on {places}: {reason}{hint}") from None


def on_loopback(endpoint: str) -> bool:
    """Whether an endpoint, such as tcp/127.0.0.1:7447, is reached from this machine only."""
    address = endpoint.partition("/")[2].rpartition(":")[0].strip("[]")
    return address in ("127.0.0.1", "localhost", "::1")


def read_account(path: Path) -> tuple[str, str]:
    """Name and password from an account's file.

    Raises:
        LinkError: it cannot be read, is open to others, or holds something else.
    """
    try:
        text = path.read_text("utf-8").strip()
        readable_by_others = path.stat().st_mode & 0o077
    except (OSError, UnicodeDecodeError) as error:
        raise LinkError(f"{path}: the account cannot be read: {error}") from None
    if readable_by_others:
        raise LinkError(f"{path}: others can read this account's password; chmod 600 it")
    name, colon, password = text.partition(":")
    if not colon or not name or not password or "\n" in text:
        raise LinkError(f"{path}: must be one line, name:password, as `cobra-teleop router account` writes it")
    return name, password
