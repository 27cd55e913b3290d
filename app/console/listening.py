"""Where the front door listens, and what must be true before it listens beyond this machine."""

import ipaddress
import socket
import ssl
from dataclasses import dataclass
from pathlib import Path

import psutil

from cobra.errors import OperatorError


class ListeningError(OperatorError):
    """It may not, or cannot, listen like that. The message says what would be right."""


@dataclass(frozen=True, slots=True)
class Tls:
    """Files in PEM format: the certificate with its chain, and its key."""

    certificate: Path
    key: Path


def load_tls(certificate: Path | None, key: Path | None) -> Tls | None:
    """Certificate and key, tried; None when neither is given.

    Raises:
        ListeningError: one is missing or cannot be used.
    """
    if certificate is None and key is None:
        return None
    if certificate is None or key is None:
        given, missing = ("--tls-cert", "--tls-key") if certificate else ("--tls-key", "--tls-cert")
        raise ListeningError(f"{given} is given without {missing}; both are needed")
    for path in (certificate, key):
        if not path.is_file():
            raise ListeningError(f"{path}: there is no such file (certificate and key in PEM format)")
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key, lambda: "")
    except (ssl.SSLError, OSError) as error:
        raise ListeningError(f"{certificate} and {key} are no certificate and its key in PEM format: {error}") from None
    return Tls(certificate, key)


def is_loopback(host: str) -> bool:
    """Whether only this machine reaches an address."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def danger(host: str, users: bool, tls: bool, insecure: bool) -> str:
    """What everybody who opens the page has to know about how it is served; empty when it is as it should be.

    Raises:
        ListeningError: it would listen beyond this machine without users or TLS, and nobody said that it may.
    """
    if is_loopback(host) or (users and tls):
        return ""
    missing = " and ".join(name for name, there in (("users", users), ("TLS", tls)) if not there)
    if not insecure:
        raise ListeningError(
            f"will not listen on {host} without {missing}: add users with 'cobra-teleop users add NAME --role driver', "
            "give --tls-cert and --tls-key, or say --insecure if everybody who reaches this network may drive"
        )
    who = "" if users else "Whoever reaches this address drives: there are no users. "
    read = "" if tls else "Whoever is on the way reads and changes what is sent: there is no TLS."
    return f"Not secure. {who}{read}".strip()


def own_names(host: str, further: tuple[str, ...]) -> tuple[str, ...]:
    """Names under which browsers may ask for this console: this machine's, where it listens on all its addresses."""
    if host not in ("0.0.0.0", "::"):
        return further
    addresses = {entry.address.split("%")[0] for all_of in psutil.net_if_addrs().values() for entry in all_of}
    return (*further, socket.gethostname(), *sorted(addresses))
