"""A Zenoh router between networks: TLS, accounts, and rules by role that the router itself enforces.

Whoever watches may read states and events, ask what robot it is, and STOP; nothing else that a viewer sends gets
through, whatever page or program it comes from.
"""

import contextlib
import os
import secrets
import signal
import stat
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any, Literal

import msgspec
import zenoh
from msgspec import Meta

from app.link.access import LinkError, open_session

AccountRole = Literal["robot", "driver", "viewer"]
PASSWORD_BYTES = 24

BOTH_WAYS = ("ingress", "egress")
EVERYTHING = (
    "put",
    "delete",
    "declare_subscriber",
    "query",
    "reply",
    "declare_queryable",
    "liveliness_token",
    "declare_liveliness_subscriber",
    "liveliness_query",
)
LISTENING = ("declare_subscriber", "declare_liveliness_subscriber", "liveliness_query")
TOLD = ("put", "delete", "reply", "liveliness_token")
SEEN = ("state", "event", "heard", "history", "calibration", "truth", "alive")
"""Keys that a console or its recorder reads."""
TOLD_WHEN_ASKED = ("meta", "calibration", "audit")


class Account(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Who may connect. A robot's account bears the robot's name and may speak for that robot only."""

    name: Annotated[str, Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$", max_length=40)]
    role: AccountRole
    password: Annotated[str, Meta(min_length=16, pattern=r"^[^:\s]+$")]
    """In the clear, as Zenoh's challenge needs it: the file is for the router's owner alone."""


class _Accounts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    accounts: tuple[Account, ...] = ()


def load_accounts(path: Path) -> tuple[Account, ...]:
    """The accounts of a router.

    Raises:
        LinkError: the file cannot be read, is open to others, or an account in it is wrong.
    """
    try:
        data = path.read_bytes()
        if path.stat().st_mode & (stat.S_IRWXG | stat.S_IRWXO):
            raise LinkError(f"{path}: others can read the passwords in it; chmod 600 it")
        accounts = msgspec.json.decode(data, type=_Accounts).accounts
    except OSError as error:
        raise LinkError(f"{path}: the accounts cannot be read: {error.strerror}") from None
    except msgspec.DecodeError as error:
        raise LinkError(f"{path}: {error}; `cobra-teleop router account` writes such files") from None
    names = [account.name for account in accounts]
    if twice := {name for name in names if names.count(name) > 1}:
        raise LinkError(f"{path}: {', '.join(sorted(twice))} is there twice; names must differ")
    return accounts


def add_account(path: Path, name: str, role: AccountRole, out: Path) -> None:
    """Add an account with a password of its own, and write the file that its owner connects with.

    Raises:
        LinkError: the name is taken or not allowed, or a file cannot be written.
    """
    accounts = load_accounts(path) if path.exists() else ()
    if any(account.name == name for account in accounts):
        raise LinkError(f"{path}: there is an account {name!r} already; choose another name")
    account = Account(name=name, role=role, password=secrets.token_urlsafe(PASSWORD_BYTES))
    try:
        # msgspec checks types when it decodes, not when a struct is made.
        msgspec.convert(msgspec.to_builtins(account), Account)
    except msgspec.ValidationError as error:
        raise LinkError(f"name {name!r}: {error}; use letters, digits, - and _") from None
    text = msgspec.json.format(msgspec.json.encode(_Accounts((*accounts, account))), indent=2)
    _write_private(out, f"{name}:{account.password}\n".encode())
    _write_private(path, text)


def access_rules(accounts: Sequence[Account]) -> dict[str, Any]:
    """Zenoh's access control for these accounts: what is not allowed is denied."""
    rules: list[dict[str, Any]] = [
        _allow("see", ("egress",), TOLD, [f"cobra/*/{name}" for name in {*SEEN, *TOLD_WHEN_ASKED}]),
        _allow("listen", ("ingress",), LISTENING, [f"cobra/*/{name}" for name in SEEN]),
        _allow("ask what it is", ("ingress",), ("query",), [f"cobra/*/{name}" for name in TOLD_WHEN_ASKED]),
        _allow("stop", ("ingress",), ("put",), ["cobra/*/stop"]),
        _allow("drive", ("ingress",), ("put",), ["cobra/*/command", "cobra/*/push", "cobra/*/length"]),
        # A publisher sends only what it was told that somebody listens to.
        _allow(
            "know the robot listens",
            ("egress",),
            ("declare_subscriber",),
            [f"cobra/*/{name}" for name in ("command", "stop", "push", "length")],
        ),
        # Who watches listens to all robots at once.
        _allow("know who watches", ("egress",), ("declare_subscriber",), [f"cobra/*/{name}" for name in SEEN]),
        _allow("be a console", ("ingress",), ("liveliness_token",), ["cobra/*/console/*"]),
        _allow("request", ("ingress",), ("query",), ["cobra/*/request"]),
        _allow("be answered", ("egress",), ("reply",), ["cobra/*/request"]),
    ]
    watching = ["see", "listen", "ask what it is", "stop"]
    driving = [*watching, "drive", "know the robot listens", "be a console", "request", "be answered"]
    subjects, policies = [], []
    for account in accounts:
        subjects.append({"id": account.name, "usernames": [account.name]})
        allowed = {"viewer": watching, "driver": driving, "robot": [f"be {account.name}", "know who watches"]}[
            account.role
        ]
        policies.append({"subjects": [account.name], "rules": allowed})
        if account.role == "robot":
            rules.append(_allow(f"be {account.name}", BOTH_WAYS, EVERYTHING, [f"cobra/{account.name}/**"]))
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


@contextlib.contextmanager
def routing(
    endpoints: tuple[str, ...], accounts: Sequence[Account], certificate: Path | None = None, key: Path | None = None
) -> Iterator[zenoh.Session]:
    """A router that runs while the context lasts.

    Raises:
        LinkError: no account, an endpoint that cannot be had, or a tls/ endpoint without certificate and key.
    """
    if not accounts:
        raise LinkError("the router has no accounts: nobody could connect; add some with `cobra-teleop router account`")
    if any(endpoint.startswith("tls/") for endpoint in endpoints) and not (certificate and key):
        raise LinkError("a tls/ endpoint needs --tls-cert and --tls-key (PEM)")
    for file in (certificate, key):
        if file is not None and not file.is_file():
            raise LinkError(f"{file}: there is no such file")
    with TemporaryDirectory() as folder:
        passwords = Path(folder) / "passwords"
        _write_private(passwords, "".join(f"{a.name}:{a.password}\n" for a in accounts).encode())
        settings: dict[str, Any] = {
            "transport/auth/usrpwd/dictionary_file": str(passwords),
            "access_control": access_rules(accounts),
        }
        if certificate and key:
            settings["transport/link/tls/listen_certificate"] = str(certificate.absolute())
            settings["transport/link/tls/listen_private_key"] = str(key.absolute())
        session = open_session("router", listen=endpoints, settings=settings)
        try:
            yield session
        finally:
            session.close()


def run_router(
    endpoints: tuple[str, ...], accounts: Path, certificate: Path | None = None, key: Path | None = None
) -> int:
    """Route until Ctrl-C or SIGTERM. Returns the exit status.

    Raises:
        LinkError: with one clear line.
    """
    done = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: done.set())
    known = load_accounts(accounts)
    with routing(endpoints, known, certificate, key):
        print(f"Routing on {', '.join(endpoints)} for {len(known)} accounts   (Ctrl-C ends it)", flush=True)
        done.wait()
    return 0


def _allow(name: str, flows: Sequence[str], messages: Sequence[str], keys: Sequence[str]) -> dict[str, Any]:
    return {
        "id": name,
        "permission": "allow",
        "flows": list(flows),
        "messages": list(messages),
        "key_exprs": list(keys),
    }


def _write_private(path: Path, data: bytes) -> None:
    """Write for the owner's eyes only, whole or not at all."""
    fresh = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with os.fdopen(os.open(fresh, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "wb") as file:
            file.write(data)
        fresh.replace(path)
    except OSError as error:
        raise LinkError(f"{path}: cannot be written: {error.strerror}") from None
