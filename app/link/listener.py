"""Hearing a robot without being one of its consoles: for recorders."""

from collections.abc import Callable, Mapping

import msgspec
import zenoh

from app.link.access import DIRECT, LinkAccess, LinkError, open_session
from app.link.keys import ask, key
from cobra.messages import Meta, decode


class Listener:
    """Hears what a robot publishes without being one of its consoles: a robot that is only recorded is alone.

    Args:
        robot: its name.
        endpoint: where its link listens.
        hear: what to call with the bytes of each message, by the key's last word ("state", "event", …). Called on the
            link's own threads: it must only put them aside.
        on_alive: called when the robot process comes and goes.
        access: account and certificate, where a router asks for them.
    """

    def __init__(
        self,
        robot: str,
        endpoint: str,
        hear: Mapping[str, Callable[[bytes], None]],
        on_alive: Callable[[bool], None] = lambda alive: None,
        access: LinkAccess = DIRECT,
    ) -> None:
        self._robot = robot
        self._endpoint = endpoint
        self._hear = dict(hear)
        self._on_alive = on_alive
        self._access = access
        self._session: zenoh.Session | None = None

    def start(self) -> Meta:
        """Connect; returns what the robot says of itself.

        Raises:
            LinkError: nobody listens there, or nobody answers.
        """
        session = self._session = open_session("client", connect=(self._endpoint,), access=self._access)

        def passing(what: Callable[[bytes], None]) -> Callable[[zenoh.Sample], None]:
            return lambda sample: what(sample.payload.to_bytes())

        self._subscribers = [
            session.declare_subscriber(key(self._robot, name), passing(what)) for name, what in self._hear.items()
        ]
        self._alive = session.liveliness().declare_subscriber(
            key(self._robot, "alive"),
            lambda sample: self._on_alive(sample.kind == zenoh.SampleKind.PUT),
            history=True,
        )
        data = ask(session, key(self._robot, "meta"), b"")
        if data is None:
            self.stop()
            raise LinkError(f"robot {self._robot!r} does not answer on {self._endpoint}")
        return decode(data, Meta)

    def calibration(self) -> bytes | None:
        """The robot's newest `Calibration`, encoded; None when it has told none."""
        return ask(self._session, key(self._robot, "calibration"), b"") if self._session is not None else None

    def stop(self) -> None:
        session, self._session = self._session, None
        if session is not None:
            session.close()


def history(data: bytes) -> list[bytes]:
    """The encoded states of one `history` message.

    Raises:
        msgspec.DecodeError, msgspec.ValidationError: the bytes are not such a message.
    """
    return msgspec.msgpack.decode(data, type=list[bytes])
