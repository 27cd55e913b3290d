"""What comes in from the robots that are watched: one Zenoh session for each endpoint, one record for each robot.

Only the newest state of a robot is kept, by Zenoh and without a call into Python for each that comes, and is decoded
when somebody looks: a wall of a hundred robots at 50 Hz costs what its eyes take, not what the robots send.
"""

import contextlib
import threading
import time
from collections import Counter, deque
from concurrent.futures import Future

import msgspec
import zenoh
from zenoh.handlers import RingChannel

from app.link.access import LinkAccess, LinkError, open_session
from app.link.keys import key, put_stop
from app.link.stopping import Stopping
from app.people.audit import Deed
from cobra.description import RobotDescription
from cobra.loading import DescriptionError, parse_description
from cobra.messages import Event, Meta, Reply, RobotState, decode

META_TIMEOUT_S = 2.0
RETRY_S = 2.0
LOOK_PERIOD_S = 0.01
"""How often it is looked whether there is a newer state: by so much it may seem younger than it is."""
RATE_WINDOW = 50


class WatchedRobot:
    """A robot as it is seen from here. Safe from any thread."""

    def __init__(self, name: str, feed: "Feed") -> None:
        self.name = name
        self.present = False
        """Whether the robot process is there."""
        self.events: deque[Event] = deque(maxlen=200)
        self.event_counts: Counter[str] = Counter()
        self.malformed = 0
        self.received = 0
        self._feed = feed
        self._stopping = Stopping(lambda data: feed.send_stop(name, data), self.latest)
        self._described: RobotDescription | None = None
        self._newest: tuple[int, float, bytes] | None = None
        self._decoded: tuple[int, RobotState | None] = (-1, None)
        self._arrivals: deque[tuple[int, float]] = deque(maxlen=RATE_WINDOW)

    def take_state(self, data: bytes) -> None:
        """Put the newest state aside."""
        self.received += 1
        self._newest = (self.received, time.monotonic(), data)

    def take_event(self, data: bytes) -> None:
        try:
            event = decode(data, Event)
        except msgspec.MsgspecError:
            self.malformed += 1
            return
        self.events.append(event)
        self.event_counts[event.level] += 1

    def latest(self) -> RobotState | None:
        """The newest state that could be decoded."""
        newest, (count, state) = self._newest, self._decoded
        if newest is None or newest[0] == count:
            return state
        try:
            state = decode(newest[2], RobotState)
        except msgspec.MsgspecError:
            self.malformed += 1
        self._decoded = (newest[0], state)
        return state

    def age(self) -> float:
        """Seconds since the newest state arrived; inf before the first."""
        return time.monotonic() - self._newest[1] if self._newest else float("inf")

    def rate(self) -> float:
        """States that reached us lately [Hz]; call it regularly."""
        self._arrivals.append((self.received, time.monotonic()))
        (n0, t0), (n1, t1) = self._arrivals[0], self._arrivals[-1]
        return (n1 - n0) / (t1 - t0) if t1 > t0 else 0.0

    def stop(self, who: str, reason: str) -> Future[bool]:
        """STOP it: the one thing that who watches may send. Tells whether the robot confirmed it."""
        return self._stopping.say(who, reason)

    def meta(self) -> Meta:
        """What the robot says of itself.

        Raises:
            LinkError: it does not answer.
        """
        return self._feed.meta(self.name)

    def audit(self) -> list[Deed]:
        """The trail stays with the robot and its own console."""
        return []

    def described(self) -> RobotDescription | None:
        """Its description, asked for once; None while it does not answer, or in a way that is not understood."""
        if self._described is None:
            with contextlib.suppress(LinkError, DescriptionError):
                self._described = parse_description(self.meta().description, f"robot {self.name!r}")
        return self._described

    def restart(self) -> Reply:
        """Refused: only the console beside the robot process can."""
        return Reply(ok=False, reasons=("this console only watches: restart it where it runs",))


class Feed:
    """One endpoint, a robot's own or a router's; all robots that are heard there are put into `robots`.

    It goes on trying while nobody listens there; `trouble` says so in words.
    """

    def __init__(self, endpoint: str, robots: dict[str, WatchedRobot], access: LinkAccess) -> None:
        self.endpoint = endpoint
        self.trouble = "not connected yet"
        self._robots = robots
        self._access = access
        self._session: zenoh.Session | None = None
        self._heard: dict[str, WatchedRobot] = {}
        """Those of `robots` that are heard here."""
        self._quit = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"feed of {endpoint}", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        self._quit.set()
        self._thread.join()
        session, self._session = self._session, None
        if session is not None:
            session.close()

    def send_stop(self, robot: str, data: bytes) -> None:
        """One encoded `Stop`; it may be lost: see `app.link.stopping`."""
        if self._session is not None:
            put_stop(self._session, key(robot, "stop"), data)

    def meta(self, robot: str) -> Meta:
        """Ask a robot what it is.

        Raises:
            LinkError: it does not answer, or in a way that cannot be read.
        """
        replies = self._session.get(f"cobra/{robot}/meta", timeout=META_TIMEOUT_S) if self._session else ()
        for reply in replies:
            if reply.ok is not None:
                try:
                    return decode(reply.ok.payload.to_bytes(), Meta)
                except msgspec.MsgspecError:
                    break
        raise LinkError(f"robot {robot!r} does not answer on {self.endpoint}")

    def _run(self) -> None:
        session = None
        while session is None and not self._quit.is_set():
            try:
                session = open_session("client", connect=(self.endpoint,), access=self._access)
            except LinkError as error:
                self.trouble = str(error)
                self._quit.wait(RETRY_S)
        if session is None:
            return
        self._subscribers = [
            session.declare_subscriber("cobra/*/event", self._take_event),
            session.liveliness().declare_subscriber("cobra/*/alive", self._take_alive, history=True),
        ]
        self._session, self.trouble = session, ""
        self._look(session)  # from here on Zenoh reconnects by itself

    def _look(self, session: zenoh.Session) -> None:
        newest: dict[str, zenoh.Subscriber[zenoh.Handler[zenoh.Sample]]] = {}
        while not self._quit.wait(LOOK_PERIOD_S):
            for name, robot in list(self._heard.items()):
                if name not in newest:
                    newest[name] = session.declare_subscriber(f"cobra/{name}/state", RingChannel(1))
                elif (sample := newest[name].try_recv()) is not None:
                    robot.take_state(sample.payload.to_bytes())

    def _take_event(self, sample: zenoh.Sample) -> None:
        self._robot(sample).take_event(sample.payload.to_bytes())

    def _take_alive(self, sample: zenoh.Sample) -> None:
        self._robot(sample).present = sample.kind == zenoh.SampleKind.PUT

    def _robot(self, sample: zenoh.Sample) -> WatchedRobot:
        name = str(sample.key_expr).split("/")[1]
        # Threads of several sessions come here; setdefault lets one of them win.
        robot = self._robots.get(name) or self._robots.setdefault(name, WatchedRobot(name, self))
        return self._heard.setdefault(name, robot)
