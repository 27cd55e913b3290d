"""The link between a robot process and its consoles: Zenoh keys, one class for either end.

cobra/<robot>/state     robot → all     RobotState, every tick; only the newest matters
cobra/<robot>/history   robot → recorders   the same states, a tenth of a second in one message: none is dropped for being late
cobra/<robot>/event     robot → all     Event
cobra/<robot>/heard     robot → recorders   Heard: commands with the robot's verdict, answered requests
cobra/<robot>/truth     twin → tests, plots and the 3D view only
cobra/<robot>/push      anybody → twin only: Push, a force on its body. On hardware nobody listens.
cobra/<robot>/command   driver → robot  Command
cobra/<robot>/stop      anybody → robot Stop
cobra/<robot>/length    anybody → robot HandFedLength: what a measuring device reads, of a robot that is fed by hand
cobra/<robot>/request   query           Request → Reply
cobra/<robot>/meta      query           Meta
cobra/<robot>/calibration   robot → recorders, and query   Calibration, whenever another one is in force
cobra/<robot>/audit     query           the newest deeds of the audit trail
cobra/<robot>/alive     liveliness token of the robot process
cobra/<robot>/console/* liveliness tokens of its consoles
"""

import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Mapping

import msgspec
import zenoh

from app.link_access import DIRECT, LinkAccess, LinkError, open_session
from app.people.audit import Deed
from cobra.messages import (
    Calibration,
    Command,
    Event,
    HandFedLength,
    Heard,
    Meta,
    Push,
    Reply,
    Request,
    RobotState,
    Stop,
    Touch,
    decode,
    encode,
)

REQUEST_TIMEOUT_S = 2.0
HISTORY_S = 0.1
"""States are put together for recorders for so long: a tenth of the messages, and a short stall of a thread drops none."""


def key(robot: str, name: str) -> str:
    return f"cobra/{robot}/{name}"


def _newest_only(session: zenoh.Session, name: str) -> zenoh.Publisher:
    """For what is worthless when late: sent at once, ahead of the rest, dropped rather than queued."""
    return session.declare_publisher(
        name, priority=zenoh.Priority.REAL_TIME, congestion_control=zenoh.CongestionControl.DROP, express=True
    )


class RobotLink:
    """The robot's end: publishes, and hands what arrives to callbacks that must only put it aside."""

    def __init__(
        self,
        robot: str,
        endpoint: str,
        meta: Meta,
        router: str | None = None,
        access: LinkAccess = DIRECT,
        audit: Callable[[], bytes] = lambda: b"\x90",
    ) -> None:
        """`audit` gives the newest deeds, encoded."""
        self._audit = audit
        self._robot = robot
        self._endpoint = endpoint
        self._router = router
        self._access = access
        self._meta = encode(meta)
        self._session: zenoh.Session | None = None
        self._consoles: set[str] = set()
        self._waiting: list[bytes] = []
        self._calibration = b""
        self._history_due = 0.0

    @property
    def consoles(self) -> int:
        """How many consoles are connected now."""
        return len(self._consoles)

    def start(
        self,
        on_command: Callable[[bytes], None],
        on_stop: Callable[[bytes], None],
        on_request: Callable[[bytes, Callable[[Reply], None]], None],
        on_length: Callable[[bytes], None] = lambda data: None,
        on_push: Callable[[bytes], None] | None = None,
    ) -> None:
        """Open the link.

        Raises:
            LinkError: the endpoint is taken or not ours to listen on, or the router does not let us in.
        """
        routers = (self._router,) if self._router else ()
        session = self._session = open_session("peer", listen=(self._endpoint,), connect=routers, access=self._access)

        def request(query: zenoh.Query) -> None:
            def answer(reply: Reply) -> None:
                query.reply(query.key_expr, encode(reply))
                query.drop()  # type: ignore[no-untyped-call]

            on_request(query.payload.to_bytes() if query.payload else b"", answer)

        def name(what: str) -> str:
            return key(self._robot, what)

        self._state = _newest_only(session, name("state"))
        self._event = session.declare_publisher(name("event"))
        self._history = session.declare_publisher(name("history"), congestion_control=zenoh.CongestionControl.DROP)
        self._heard = session.declare_publisher(name("heard"), congestion_control=zenoh.CongestionControl.DROP)
        self._calibrated = session.declare_publisher(name("calibration"))
        self._truth = session.declare_publisher(name("truth"), congestion_control=zenoh.CongestionControl.DROP)
        self._subscribers = [
            session.declare_subscriber(name("command"), lambda sample: on_command(sample.payload.to_bytes())),
            session.declare_subscriber(name("stop"), lambda sample: on_stop(sample.payload.to_bytes())),
            session.declare_subscriber(name("length"), lambda sample: on_length(sample.payload.to_bytes())),
            *(
                (session.declare_subscriber(name("push"), lambda sample: on_push(sample.payload.to_bytes())),)
                if on_push
                else ()
            ),
            session.declare_queryable(name("request"), request),
            session.declare_queryable(name("meta"), lambda query: query.reply(query.key_expr, self._meta)),
            session.declare_queryable(name("calibration"), self._tell_calibration),
            session.declare_queryable(name("audit"), lambda query: query.reply(query.key_expr, self._audit())),
        ]
        self._token = session.liveliness().declare_token(name("alive"))
        self._watch = session.liveliness().declare_subscriber(name("console/*"), self._take_console, history=True)

    def _take_console(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            self._consoles.add(str(sample.key_expr))
        else:
            self._consoles.discard(str(sample.key_expr))

    def stop(self) -> None:
        if self._session is not None:
            self._publish_history()
            self._session.close()  # type: ignore[no-untyped-call]
            self._session = None

    def publish_state(self, state: RobotState) -> None:
        if self._session is None:
            return
        data = encode(state)
        self._state.put(data)
        self._waiting.append(data)
        if state.stamp >= self._history_due:
            self._history_due = state.stamp + HISTORY_S
            self._publish_history()

    def _publish_history(self) -> None:
        waiting, self._waiting = self._waiting, []
        if waiting:
            self._history.put(msgspec.msgpack.encode(waiting))

    def publish_event(self, event: Event) -> None:
        if self._session is not None:
            self._event.put(encode(event))

    def publish_heard(self, heard: Heard) -> None:
        if self._session is not None:
            self._heard.put(encode(heard))

    def publish_calibration(self, calibration: Calibration) -> None:
        self._calibration = encode(calibration)
        if self._session is not None:
            self._calibrated.put(self._calibration)

    def _tell_calibration(self, query: zenoh.Query) -> None:
        if self._calibration:
            query.reply(query.key_expr, self._calibration)

    def publish_truth(self, data: bytes) -> None:
        if self._session is not None:
            self._truth.put(data)


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
        self._command = _newest_only(session, key(self._robot, "command"))

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
            self._session.close()  # type: ignore[no-untyped-call]
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

    def send_stop(self, stop: Stop) -> None:
        if self._session is not None:
            self._session.put(key(self._robot, "stop"), encode(stop), priority=zenoh.Priority.REAL_TIME, express=True)

    def send_length(self, length: HandFedLength) -> None:
        """For a program beside a measuring device: what is exposed now of a robot that is fed by hand."""
        if self._session is not None:
            self._session.put(key(self._robot, "length"), encode(length))

    def request(self, request: Request) -> Reply:
        """Ask once and wait for the answer; no answer is a refusal with its reason."""
        data = self._query("request", encode(request))
        return decode(data, Reply) if data else Reply(ok=False, reasons=("the robot process does not answer",))

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
        return _ask(self._session, key(self._robot, name), payload) if self._session is not None else None

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


class Listener:
    """Hears what a robot publishes without being one of its consoles: a robot that is only recorded is alone.

    Args:
        robot: its name.
        endpoint: where its link listens.
        hear: what to call with the bytes of each message, by the key's last word ("state", "event", …). Called on the
            link's own threads: it must only put them aside.
        on_alive: called when the robot process comes and goes.
    """

    def __init__(
        self,
        robot: str,
        endpoint: str,
        hear: Mapping[str, Callable[[bytes], None]],
        on_alive: Callable[[bool], None] = lambda alive: None,
    ) -> None:
        self._robot = robot
        self._endpoint = endpoint
        self._hear = dict(hear)
        self._on_alive = on_alive
        self._session: zenoh.Session | None = None

    def start(self) -> Meta:
        """Connect; returns what the robot says of itself.

        Raises:
            LinkError: nobody listens there, or nobody answers.
        """
        session = self._session = open_session("client", connect=(self._endpoint,))

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
        data = _ask(session, key(self._robot, "meta"), b"")
        if data is None:
            self.stop()
            raise LinkError(f"robot {self._robot!r} does not answer on {self._endpoint}")
        return decode(data, Meta)

    def calibration(self) -> bytes | None:
        """The robot's newest `Calibration`, encoded; None when it has told none."""
        return _ask(self._session, key(self._robot, "calibration"), b"") if self._session is not None else None

    def stop(self) -> None:
        session, self._session = self._session, None
        if session is not None:
            session.close()  # type: ignore[no-untyped-call]


def _ask(session: zenoh.Session, name: str, payload: bytes) -> bytes | None:
    for reply in session.get(name, payload=payload, timeout=REQUEST_TIMEOUT_S):
        if reply.ok is not None:
            return reply.ok.payload.to_bytes()
    return None


def history(data: bytes) -> list[bytes]:
    """The encoded states of one `history` message.

    Raises:
        msgspec.DecodeError, msgspec.ValidationError: the bytes are not such a message.
    """
    return msgspec.msgpack.decode(data, type=list[bytes])
