"""Who runs on this machine: small files in a private folder that say which process holds which robot and page."""

import os
import socket
import sys
import tempfile
from pathlib import Path

import msgspec
import psutil

from cobra.errors import OperatorError


class BusyError(OperatorError):
    """Something that only one may have is taken. The message says who has it and what to do."""


class Running(msgspec.Struct, frozen=True, kw_only=True):
    """A running robot process (`endpoint` is its link) or console (`endpoint` is its page)."""

    pid: int
    endpoint: str
    robot: str
    started: float
    """Start time of the process, so that a reused pid is not taken for it."""


def folder() -> Path:
    """The private folder of this user; made when missing."""
    named = os.environ.get("COBRA_TELEOP_RUNTIME_DIR")
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    user = os.getuid() if sys.platform != "win32" else os.getlogin()
    path = Path(named) if named else Path(runtime or tempfile.gettempdir()) / f"cobra-teleop-{user}"
    path.mkdir(mode=0o700, parents=True, exist_ok=True)
    return path


def register(role: str, robot: str, endpoint: str) -> None:
    """Say that this process is the `role` ("robot" or "console") of a robot."""
    me = psutil.Process()
    entry = Running(pid=me.pid, endpoint=endpoint, robot=robot, started=me.create_time())
    path = _file(role, robot)
    fresh = path.with_suffix(f".{me.pid}")
    fresh.write_bytes(msgspec.json.encode(entry))
    fresh.replace(path)


def unregister(role: str, robot: str) -> None:
    """Take this process's own entry away; somebody else's stays."""
    entry = _read(role, robot)
    if entry and entry.pid == os.getpid():
        _file(role, robot).unlink(missing_ok=True)


def find(role: str, robot: str) -> Running | None:
    """The process that has this role now, or None. An entry of a dead process counts for nothing."""
    entry = _read(role, robot)
    return entry if entry is not None and _lives(entry) else None


def find_all(role: str) -> list[Running]:
    """All processes of this user that have this role now, by the robot's name."""
    names = sorted(path.stem.removeprefix(f"{role}-") for path in folder().glob(f"{role}-*.json"))
    return [running for name in names if (running := find(role, name))]


def port_holder(port: int) -> str | None:
    """Who listens on a local TCP port, in words; None when it is free."""
    try:
        listeners = [
            c for c in psutil.net_connections("tcp") if c.laddr and c.laddr.port == port and c.status == "LISTEN"
        ]
    except psutil.AccessDenied:
        listeners = []
    for connection in listeners:
        if connection.pid is None:
            return "another user's process"
        try:
            process = psutil.Process(connection.pid)
            return f"{process.name()} (process {process.pid}: {' '.join(process.cmdline())[:80]})"
        except psutil.Error:
            return f"process {connection.pid}"
    return None if _is_free(port) else "another process"


def free_port(first: int, tries: int = 50) -> int:
    """The first free local port from `first` on.

    Raises:
        OSError: none of them is free.
    """
    for port in range(first, first + tries):
        if _is_free(port):
            return port
    raise OSError(f"no free port from {first} to {first + tries - 1}")


def any_free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _is_free(port: int) -> bool:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True


def _lives(entry: Running) -> bool:
    try:
        process = psutil.Process(entry.pid)
        # One that was killed and that nobody has taken note of yet is dead too.
        return abs(process.create_time() - entry.started) < 1.0 and process.status() != psutil.STATUS_ZOMBIE
    except psutil.Error:
        return False


def _file(role: str, robot: str) -> Path:
    return folder() / f"{role}-{robot}.json"


def _read(role: str, robot: str) -> Running | None:
    try:
        return msgspec.json.decode(_file(role, robot).read_bytes(), type=Running)
    except (OSError, msgspec.MsgspecError):
        return None
