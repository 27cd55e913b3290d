"""The robot's end of the link."""

from collections.abc import Callable

import msgspec
import zenoh

from app.link.access import DIRECT, LinkAccess, open_session
from app.link.keys import key, newest_only
from cobra.messages import Calibration, Event, Heard, Meta, Reply, RobotState, encode

HISTORY_S = 0.1
"""States are put together for recorders for so long: a tenth of the messages, and a short stall of a thread drops none."""


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
                query.drop()

            on_request(query.payload.to_bytes() if query.payload else b"", answer)

        def name(what: str) -> str:
            return key(self._robot, what)

        self._state = newest_only(session, name("state"))
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
            self._session.close()
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
