"""Where programs find a simulated adapter: a pseudo-terminal or a TCP port on loopback, one program at a time."""

import contextlib
import os
import select
import socket
import threading
from collections.abc import Callable
from typing import Final, Protocol

from cobra.errors import OperatorError

POLL_S: Final = 0.2
CHUNK: Final = 4096
LOOPBACK: Final = "127.0.0.1"


class EndpointError(OperatorError):
    """It cannot be opened. The message says why."""


class Endpoint(Protocol):
    """Bytes from and to whatever program is there."""

    channel: str
    """What python-can's slcan interface is to be given."""
    lost: int
    """Bytes that nobody read in time."""

    def write(self, data: bytes) -> None: ...
    def run(self, feed: Callable[[bytes], None], hang_up: Callable[[], None], done: threading.Event) -> None: ...
    def close(self) -> None: ...


class PseudoTerminal:
    """A serial port that is none. Both ends stay open, so that programs may come and go."""

    def __init__(self) -> None:
        import tty  # noqa: PLC0415  # POSIX only

        self.lost = 0
        self._ours, self._theirs = os.openpty()
        tty.setraw(self._theirs)
        os.set_blocking(self._ours, False)
        self.channel = os.ttyname(self._theirs)

    def write(self, data: bytes) -> None:
        try:
            written = os.write(self._ours, data)
        except BlockingIOError:
            written = 0
        self.lost += len(data) - written

    def run(self, feed: Callable[[bytes], None], hang_up: Callable[[], None], done: threading.Event) -> None:
        while not done.is_set():
            ready, _, _ = select.select([self._ours], [], [], POLL_S)
            if ready:
                with contextlib.suppress(BlockingIOError):
                    feed(os.read(self._ours, CHUNK))

    def close(self) -> None:
        for end in (self._ours, self._theirs):
            os.close(end)


class TcpPort:
    """Loopback only: whoever may write here moves motors."""

    def __init__(self, port: int) -> None:
        self.lost = 0
        self._listener = socket.socket()
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._listener.bind((LOOPBACK, port))
        except OSError as error:
            self._listener.close()
            raise EndpointError(f"port {port} on {LOOPBACK} cannot be taken: {error.strerror}; give another") from None
        self._listener.listen(1)
        self.channel = f"socket://{LOOPBACK}:{self._listener.getsockname()[1]}"
        self._client: socket.socket | None = None

    def write(self, data: bytes) -> None:
        client = self._client
        if client is None:
            return
        try:
            self.lost += len(data) - client.send(data, socket.MSG_DONTWAIT)
        except BlockingIOError:
            self.lost += len(data)
        except OSError:
            self._client = None

    def run(self, feed: Callable[[bytes], None], hang_up: Callable[[], None], done: threading.Event) -> None:
        while not done.is_set():
            ready, _, _ = select.select([self._listener], [], [], POLL_S)
            if not ready:
                continue
            client, _ = self._listener.accept()
            with client:
                client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._client = client
                self._serve(client, feed, done)
                self._client = None
            hang_up()

    def _serve(self, client: socket.socket, feed: Callable[[bytes], None], done: threading.Event) -> None:
        while not done.is_set():
            ready, _, _ = select.select([client], [], [], POLL_S)
            if ready:
                try:
                    data = client.recv(CHUNK)
                except OSError:
                    return
                if not data:
                    return
                feed(data)

    def close(self) -> None:
        self._listener.close()


def open_endpoint(where: str, offset: int) -> Endpoint:
    """`pty`, or `tcp:PORT`; a robot's further buses take the next ports (port 0: any free one).

    Raises:
        EndpointError: neither, or it cannot be opened.
    """
    if where == "pty":
        if not hasattr(os, "openpty"):
            raise EndpointError("--slcan pty: this system has no pseudo-terminals; give tcp:PORT")
        return PseudoTerminal()
    kind, _, digits = where.partition(":")
    if kind != "tcp" or not digits.isdecimal() or int(digits) + offset > 65535:
        raise EndpointError(f"--slcan {where}: give pty or tcp:PORT")
    return TcpPort(int(digits) + offset if int(digits) else 0)
