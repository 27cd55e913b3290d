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
    """Publishes, and hands what arrives to callbacks that must only put it aside.

    There are two ways to it, each a session of its own, so that an account for the router shuts out nobody of this machine:
    an endpoint that it listens on, and where there is one, a router that it connects to.
    """

    def __init__(
        self,
        robot: str,
        endpoint: str,
        meta: Meta,
        router: str | None = None,
        access: LinkAccess = DIRECT,
        audit: Callable[[], bytes] = lambda: b"\x90",
    ) -> None:
        """`access` is for the router; `audit` gives the newest deeds, encoded."""
        self._audit = audit
        self._robot = robot
        self._endpoint = endpoint
        self._router = router
        self._access = access
        self._meta = encode(meta)
        self._ways: list[_Way] = []
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
        hear = {"command": on_command, "stop": on_stop, "length": on_length, **({"push": on_push} if on_push else {})}

        def request(query: zenoh.Query) -> None:
            def answer(reply: Reply) -> None:
                query.reply(query.key_expr, encode(reply))
                query.drop()

            on_request(query.payload.to_bytes() if query.payload else b"", answer)

        answers = {
            "request": request,
            "meta": lambda query: query.reply(query.key_expr, self._meta),
            "calibration": self._tell_calibration,
            "audit": lambda query: query.reply(query.key_expr, self._audit()),
        }
        try:
            self._open(open_session("peer", listen=(self._endpoint,)), hear, answers)
            if self._router:
                self._open(open_session("client", connect=(self._router,), access=self._access), hear, answers)
        except BaseException:
            self.stop()
            raise

    def _open(
        self,
        session: zenoh.Session,
        hear: dict[str, Callable[[bytes], None]],
        answers: dict[str, Callable[[zenoh.Query], None]],
    ) -> None:
        way = _Way(session, self._robot)
        self._ways.append(way)
        way.listen(hear, answers, self._take_console)

    def _take_console(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            self._consoles.add(str(sample.key_expr))
        else:
            self._consoles.discard(str(sample.key_expr))

    def stop(self) -> None:
        self._publish_history()
        ways, self._ways = self._ways, []
        for way in ways:
            way.session.close()

    def publish_state(self, state: RobotState) -> None:
        if not self._ways:
            return
        data = encode(state)
        for way in self._ways:
            way.state.put(data)
        self._waiting.append(data)
        if state.stamp >= self._history_due:
            self._history_due = state.stamp + HISTORY_S
            self._publish_history()

    def _publish_history(self) -> None:
        waiting, self._waiting = self._waiting, []
        if waiting:
            data = msgspec.msgpack.encode(waiting)
            for way in self._ways:
                way.history.put(data)

    def publish_event(self, event: Event) -> None:
        for way in self._ways:
            way.event.put(encode(event))

    def publish_heard(self, heard: Heard) -> None:
        data = encode(heard)
        for way in self._ways:
            way.heard.put(data)

    def publish_calibration(self, calibration: Calibration) -> None:
        self._calibration = encode(calibration)
        for way in self._ways:
            way.calibration.put(self._calibration)

    def _tell_calibration(self, query: zenoh.Query) -> None:
        if self._calibration:
            query.reply(query.key_expr, self._calibration)

    def publish_truth(self, data: bytes) -> None:
        for way in self._ways:
            way.truth.put(data)


class _Way:
    """One session with what is declared on it."""

    def __init__(self, session: zenoh.Session, robot: str) -> None:
        self.session = session
        self._robot = robot
        drop = zenoh.CongestionControl.DROP
        self.state = newest_only(session, key(robot, "state"))
        # In a queue of their own, so that what comes in streams does not push them out.
        self.event = session.declare_publisher(key(robot, "event"), priority=zenoh.Priority.INTERACTIVE_LOW)
        self.history = session.declare_publisher(key(robot, "history"), congestion_control=drop)
        self.heard = session.declare_publisher(key(robot, "heard"), congestion_control=drop)
        self.calibration = session.declare_publisher(key(robot, "calibration"))
        self.truth = session.declare_publisher(key(robot, "truth"), congestion_control=drop)

    def listen(
        self,
        hear: dict[str, Callable[[bytes], None]],
        answers: dict[str, Callable[[zenoh.Query], None]],
        console: Callable[[zenoh.Sample], None],
    ) -> None:
        """Hear what is sent, answer what is asked, say that the robot is there, and watch its consoles."""
        session = self.session

        def passing(take: Callable[[bytes], None]) -> Callable[[zenoh.Sample], None]:
            return lambda sample: take(sample.payload.to_bytes())

        self._subscribers = [
            session.declare_subscriber(key(self._robot, name), passing(take)) for name, take in hear.items()
        ]
        self._queryables = [
            session.declare_queryable(key(self._robot, name), answer) for name, answer in answers.items()
        ]
        self._token = session.liveliness().declare_token(key(self._robot, "alive"))
        self._watch = session.liveliness().declare_subscriber(key(self._robot, "console/*"), console, history=True)
