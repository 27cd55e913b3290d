"""A console's end of the link."""

import threading
import time
from collections import Counter, deque
from collections.abc import Callable

import msgspec
import zenoh

from app.link.access import DIRECT, LinkAccess, LinkError, open_session
from app.link.keys import ask, key, newest_only, put_stop
from app.people.audit import Deed
from cobra.messages import (
    Command,
    Event,
    HandFedLength,
    Meta,
    Push,
    Reply,
    Request,
    RobotState,
    Touch,
    decode,
    encode,
)


class ConsoleLink:
    """A console's end. `latest` is the newest state; what cannot be decoded is counted in `malformed`.

    One that only `watches` does not count as a console: it cannot take an orphaned robot's driver's place.
    """

    def __init__(
        self,
        robot: str,
        endpoint: str,
        on_alive: Callable[[bool], None] = lambda alive: None,
        access: LinkAccess = DIRECT,
        watches: bool = False,
    ) -> None:
        self._robot = robot
        self._endpoint = endpoint
        self._on_alive = on_alive
        self._access = access
        self._watches = watches
        self._session: zenoh.Session | None = None
        self._changed = threading.Condition()
        self.latest: RobotState | None = None
        self.arrived = 0.0
        """When the newest state came [s, time.monotonic()]."""
        self.received = 0
        self.malformed = 0
        self._truth = b""
        self.on_state: Callable[[RobotState], None] = lambda state: None
        """Called with every state, on the link's own thread: it must only put it aside."""
        self.events: deque[Event] = deque(maxlen=200)
        self.event_counts: Counter[str] = Counter()
        """Events by level."""

    def start(self) -> None:
        """Connect.

        Raises:
            LinkError: nobody listens there.
        """
        session = self._session = open_session("client", connect=(self._endpoint,), access=self._access)
        self._subscribers = [
            session.declare_subscriber(key(self._robot, "state"), self._take_state),
            session.declare_subscriber(key(self._robot, "event"), self._take_event),
            session.liveliness().declare_subscriber(key(self._robot, "alive"), self._take_alive, history=True),
        ]
        if not self._watches:
            token = key(self._robot, f"console/{session.zid()}")
            self._token = session.liveliness().declare_token(token)
        self._command = newest_only(session, key(self._robot, "command"))

    def watch_truth(self) -> None:
        """Also hear the twin's truth from now on, for `touch` and `truth`."""
        if self._session is not None:
            self._subscribers.append(self._session.declare_subscriber(key(self._robot, "truth"), self._take_truth))

    @property
    def truth(self) -> bytes | None:
        """The twin's newest truth, where it is watched; None on hardware."""
        return self._truth or None

    @property
    def touch(self) -> Touch | None:
        """What the twin's walls have to do with it, lately; None before the first, and without a twin."""
        if not self._truth:
            return None
        try:
            return decode(self._truth, Touch)
        except msgspec.MsgspecError:
            self.malformed += 1
            return None

    def stop(self) -> None:
        if self._session is not None:
            self._session.close()
            self._session = None

    def wait_for_state(self, timeout_s: float) -> RobotState:
        """The first state that arrives.

        Raises:
            LinkError: none came in time.
        """
        with self._changed:
            if not self._changed.wait_for(lambda: self.latest is not None, timeout_s):
                raise LinkError(f"robot {self._robot!r} does not publish on {self._endpoint} (waited {timeout_s:g} s)")
            assert self.latest is not None
            return self.latest

    def send(self, command: Command) -> None:
        if self._session is not None:
            self._command.put(encode(command))

    def push(self, push: Push) -> None:
        """Push on the twin."""
        if self._session is not None:
            self._session.put(key(self._robot, "push"), encode(push))

    def send_stop(self, data: bytes) -> None:
        """One encoded `Stop`; it may be lost: see `app.link.stopping`."""
        if self._session is not None:
            put_stop(self._session, key(self._robot, "stop"), data)

    def send_length(self, length: HandFedLength) -> None:
        """For a program beside a measuring device: what is exposed now of a robot that is fed by hand."""
        if self._session is not None:
            self._session.put(key(self._robot, "length"), encode(length))

    def request(self, request: Request) -> Reply:
        """Ask once and wait for the answer; no answer is a refusal with its reason."""
        if data := self._query("request", encode(request)):
            return decode(data, Reply)
        account = "; or the account of this console may only watch" if self._access.account else ""
        return Reply(ok=False, reasons=(f"the robot process does not answer{account}",))

    def meta(self) -> Meta:
        """Description and versions of the robot.

        Raises:
            LinkError: the robot process does not answer.
        """
        data = self._query("meta", b"")
        if data is None:
            raise LinkError(f"robot {self._robot!r} does not answer on {self._endpoint}")
        return decode(data, Meta)

    def audit(self) -> list[Deed]:
        """The newest deeds of the robot's audit trail, oldest first; none when it does not answer."""
        data = self._query("audit", b"")
        return msgspec.msgpack.decode(data, type=list[Deed]) if data else []

    def _query(self, name: str, payload: bytes) -> bytes | None:
        return ask(self._session, key(self._robot, name), payload) if self._session is not None else None

    def _take_state(self, sample: zenoh.Sample) -> None:
        try:
            state = decode(sample.payload.to_bytes(), RobotState)
        except msgspec.MsgspecError:
            self.malformed += 1
            return
        with self._changed:
            self.latest = state
            self.arrived = time.monotonic()
            self.received += 1
            self._changed.notify_all()
        self.on_state(state)

    def _take_truth(self, sample: zenoh.Sample) -> None:
        self._truth = sample.payload.to_bytes()

    def _take_event(self, sample: zenoh.Sample) -> None:
        try:
            event = decode(sample.payload.to_bytes(), Event)
            self.events.append(event)
            self.event_counts[event.level] += 1
        except msgspec.MsgspecError:
            self.malformed += 1

    def _take_alive(self, sample: zenoh.Sample) -> None:
        self._on_alive(sample.kind == zenoh.SampleKind.PUT)
