"""The websocket of the operator's page: its controls and requests in, snapshots of the robot out.

What a page sends is judged here before anybody acts on it. Nothing that arrives can raise; what is not usable is
counted by its reason and dropped. A page that falls silent while it drives is released, and has to let go first.
"""

import asyncio
import inspect
import logging
import time
from collections import Counter, deque
from collections.abc import Awaitable, Callable, Container
from itertools import count
from typing import Annotated, Any, Literal, NamedTuple, Protocol

import msgspec
from msgspec import Meta
from starlette.websockets import WebSocket, WebSocketDisconnect, WebSocketState

from app.console.doorkeeper import PRESENT, VISITOR, view_path
from app.console.inputs import Button, Controls
from app.console.mapping import DEAD_MAN
from app.console.page_state import Answer, Snapshot, Welcome
from app.console.patience import taken
from app.console.snapshots import PERIOD_S, THIN_PERIOD_S, Changes, Snapshots
from app.people.audit import Deed
from app.people.roles import at_least, may_ask
from app.people.sessions import Visitor

MAX_MESSAGE_BYTES = 4096
SILENCE_S = 0.2
"""A page that drives and is not heard for this long is released."""
LAST_LOOK_S = 0.01
MAX_ECHO_AGE_S = 0.5
"""A page that shows an older picture than this, or whose messages were on their way this long, cannot drive."""
MAX_REQUESTS = 16
"""Unanswered requests of one page; STOP is never among those refused."""
SESSION_CHECK_S = 1.0
"""A page whose session ended hears no more after this long; it can send nothing that acts from that moment on."""
SESSION_OVER = 4401
"""Close code that tells a page to sign in again."""

Axis = Annotated[float, Meta(ge=-1, le=1)]
Trigger = Annotated[float, Meta(ge=0, le=1)]
Counting = Annotated[int, Meta(ge=0, le=2**53)]
SeatRequest = Literal["acquire", "release", "take", "ask", "withdraw", "grant", "refuse", "console_pad"]
What = Literal[
    SeatRequest,
    "arm",
    "disarm",
    "home",
    "clear",
    "stop",
    "quit",
    "restart_robot",
    "section",
    "speed",
    "mode",
    "frame",
    "pose",
    "save_pose",
    "delete_pose",
    "hand_feed",
    "lock",
    "compensation",
    "unlock",
    "mark",
    "identify",
    "test",
    "home_repeatedly",
    "tare",
    "calibrate_cell",
    "abort",
    "resume",
]

_log = logging.getLogger(__name__)


class Asker(NamedTuple):
    """Who asks, and from which page."""

    page: str
    visitor: Visitor


class PageSession(Protocol):
    """What the front door needs of the console. Called from the front door's own thread; no call may block."""

    def welcome(self) -> Welcome:
        """Static facts for the page."""

    def snapshot(self) -> Snapshot:
        """The state for the page; cheap, called 20 times a second however many pages there are."""

    def controls(self, page: str, sequence: int, controls: Controls) -> None:
        """The newest input of a page; `left_shoulder` among the buttons is its dead-man."""

    def gone(self, page: str) -> None:
        """The page closed or fell silent: its input has ended."""

    def opened(self, asker: Asker) -> None:
        """A page was opened by somebody."""

    def closed(self, page: str) -> None:
        """The page is gone for good, after `gone`."""

    def act(self, asker: Asker, what: What, value: int | None, text: str) -> Answer | Awaitable[Answer]:
        """A request that the asker's role allows.

        `value` is the index for section, speed, mode and frame, and 1 or 0 for console_pad; `text` is the reason for
        take, the name for grant and refuse, the note for mark, a pose's name, for hand_feed a length in millimetres, and for
        steps of commissioning a drive's or tendon's name (calibrate_cell: and newtons); their `value` is how often to home.
        """

    def audit(self) -> Awaitable[list[Deed]]:
        """The newest deeds of the audit trail, oldest first."""

    def note_session(self, what: str, name: str, address: str) -> None:
        """For the audit trail: who signed in or out or was refused (then `name` is empty), from which address."""


class _ControlsMessage(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag="controls"):
    seq: Counting
    stamp: float
    """When the page read its inputs [ms, the page's clock]."""
    echo: float
    """Stamp of the newest snapshot that the page had seen."""
    left: tuple[Axis, Axis]
    right: tuple[Axis, Axis]
    lt: Trigger
    rt: Trigger
    buttons: frozenset[Button]
    held: bool
    since: Annotated[float, Meta(ge=0)] | None = None
    """How long ago the page got that snapshot [ms]; the rest of its age was on the way."""
    device: Annotated[str, Meta(max_length=160)] = ""
    """The pad that the page read, corrected by its profile; empty for keys and on-screen controls."""


class _Act(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag="act"):
    id: Counting
    what: What
    value: Annotated[int, Meta(ge=0, le=99)] | None = None
    text: Annotated[str, Meta(max_length=400)] = ""


class _Ping(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag="ping"):
    stamp: float


class _Pace(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag="pace"):
    thin: bool
    """Whether the page's link is slow: it wants what changed, less often."""
    view: Annotated[str, Meta(max_length=40)] = ""
    """By which word of its own the page's 3D views are known."""


_decoder = msgspec.json.Decoder(_ControlsMessage | _Act | _Ping | _Pace)


class PageSocket:
    """All pages that are open. `counts` holds what was dropped, by reason."""

    def __init__(
        self,
        session: PageSession,
        now: Callable[[], float] = time.monotonic,
        behind: Container[str] = frozenset(),
    ) -> None:
        """`behind`: pages whose 3D views are more than their links carry."""
        self.behind = behind
        self.session = session
        self.now = now
        self.counts: Counter[str] = Counter()
        self.pages = 0
        self._names = (f"page {number}" for number in count(1))
        self._stops: deque[tuple[str, int | None]] = deque(maxlen=32)
        self._snapshots = Snapshots(lambda: {**session.snapshot(), "page_drops": dict(self.counts)}, now)

    async def serve(self, websocket: WebSocket) -> None:
        """Serve one page until it closes."""
        await websocket.accept()
        page = _Page(next(self._names), websocket.scope[VISITOR], websocket, self)
        self.pages += 1
        self.session.opened(Asker(page.name, page.visitor))
        try:
            async with asyncio.TaskGroup() as group:
                group.create_task(page.listen(group))
                group.create_task(self._tell(page, websocket))
                group.create_task(page.end_with_session())
        except* WebSocketDisconnect:
            pass
        except* Exception:  # counted, then the server's to log: only this page ends
            self.counts["page failed"] += 1
            raise
        finally:
            self.pages -= 1
            page.close()

    async def ask(self, asker: Asker, what: What, value: int | None = None, text: str = "") -> Answer:
        """Pass a request on; a fault in answering it becomes a refusal with its reason."""
        try:
            answer = self.session.act(asker, what, value, text)
            return await answer if inspect.isawaitable(answer) else answer
        except Exception as error:  # counted and answered: one request's fault must not end the page, nor its STOP
            _log.exception("the request %r of %s failed", what, asker.page)
            self.counts["request failed"] += 1
            return Answer(ok=False, reasons=[f"the console failed: {error}"])

    async def stop(self, asker: Asker, press: int | None) -> Answer:
        """STOP. A page sends each press by two ways, in case one is dead; obeyed once, it counts as one."""
        known = (asker.page, press)
        if press is not None and known in self._stops:
            return Answer(ok=True, reasons=[])
        self._stops.append(known)  # before its answer: the other way may come while this one waits
        answer = await self.ask(asker, "stop")
        if not answer["ok"] and known in self._stops:
            self._stops.remove(known)
        return answer

    async def _tell(self, page: "_Page", websocket: WebSocket) -> None:
        visitor = page.visitor
        own = {"page": page.name, "user": visitor.name, "role": visitor.role, "view": view_path(visitor)}
        await websocket.send_text(_text({**self.session.welcome(), "type": "welcome", **own}))
        while True:
            # Sending waits for a slow page, so it gets fewer snapshots and never an old one.
            try:
                await taken(websocket.send_text(page.news(self._snapshots)), websocket, "page", self.counts)
            except RuntimeError:
                # The page was closed from this side while its next snapshot was due.
                if websocket.application_state is WebSocketState.DISCONNECTED:
                    raise WebSocketDisconnect from None
                raise
            await asyncio.sleep(THIN_PERIOD_S if page.thin else PERIOD_S)


class _Page:
    """One page: its last sequence number, and whether it has to let go before it may drive."""

    def __init__(self, name: str, visitor: Visitor, websocket: WebSocket, socket: PageSocket) -> None:
        self.name = name
        self.visitor = visitor
        self._websocket = websocket
        self._socket = socket
        self._sequence = -1
        self._must_release = True
        self._silence: asyncio.TimerHandle | None = None
        self._requests = 0
        self._changes: Changes | None = None
        self._view = ""

    @property
    def thin(self) -> bool:
        """Whether it asked for little."""
        return self._changes is not None

    def news(self, snapshots: Snapshots) -> str:
        """What it is sent next."""
        return self._changes.since(snapshots.parts(), self._socket.now()) if self._changes else snapshots.whole()

    async def listen(self, group: asyncio.TaskGroup) -> None:
        """Take what the page sends until it closes."""
        while True:
            received = await self._websocket.receive()
            if received["type"] == "websocket.disconnect":
                raise WebSocketDisconnect(received.get("code", 1005))
            match self._decode(received):
                case _ControlsMessage() as message:
                    if self._is_driver():
                        self._drive(message)
                    else:
                        self._count("controls of somebody who may not drive")
                case _Act(what=what) as message:
                    if self._requests < MAX_REQUESTS or what == "stop":
                        self._requests += 1
                        group.create_task(self._answer(message))
                    else:
                        self._count("too many requests at once")
                case _Ping(stamp=stamp):
                    # `now` lets the page tell how old what it shows is, whatever its own clock says.
                    pong = {"now": self._socket.now(), "behind": self._view in self._socket.behind}
                    await self._websocket.send_text(_text({"type": "pong", "stamp": stamp, **pong}))
                case _Pace(thin=thin, view=view):
                    self._changes, self._view = Changes() if thin else None, view

    async def end_with_session(self) -> None:
        """Close the page when its session is over, or is worth another role by now."""
        before = self.visitor.role
        while self._present() is not None and self.visitor.role == before:
            await asyncio.sleep(SESSION_CHECK_S)
        await self._websocket.close(SESSION_OVER)
        raise WebSocketDisconnect(SESSION_OVER)

    def _present(self) -> Visitor | None:
        """Who this is now; None when the session is over."""
        found: Visitor | None = self._websocket.scope[PRESENT]()
        self.visitor = found or self.visitor
        return found

    def _is_driver(self) -> bool:
        visitor = self._present()
        return visitor is not None and at_least(visitor.role, "driver")

    def close(self) -> None:
        """The page's input ends with it."""
        self._expect(None)
        self._socket.session.gone(self.name)
        self._socket.session.closed(self.name)

    def _count(self, reason: str) -> None:
        self._socket.counts[reason] += 1

    def _decode(self, received: Any) -> _ControlsMessage | _Act | _Ping | _Pace | None:
        text = received.get("text")
        if text is None:
            self._count("binary message")
            return None
        if len(text) > MAX_MESSAGE_BYTES or len(data := text.encode()) > MAX_MESSAGE_BYTES:
            self._count("oversized message")
            return None
        try:
            message: _ControlsMessage | _Act | _Ping | _Pace = _decoder.decode(data)
        except msgspec.ValidationError:
            self._count("message out of range or of no known kind")
        except (msgspec.DecodeError, RecursionError):
            self._count("malformed message")
        else:
            return message
        return None

    def _drive(self, message: _ControlsMessage) -> None:
        if message.seq <= self._sequence:
            self._count("repeated or older controls")
            return
        self._sequence = message.seq
        now = self._socket.now()
        # Letting go is obeyed however late it arrives.
        if message.held and not 0 <= now - message.echo <= MAX_ECHO_AGE_S:
            late = message.echo <= now
            self._count("controls that were too long on their way" if late else "controls stamped in the future")
            return
        if not message.held:
            self._must_release = False
        held = message.held and not self._must_release
        self._expect(SILENCE_S if held else None)
        controls = Controls(
            left=message.left,
            right=message.right,
            left_trigger=message.lt,
            right_trigger=message.rt,
            buttons=message.buttons | {DEAD_MAN} if held else message.buttons - {DEAD_MAN},
            stamp=now,
            device=message.device,
            lag_s=0.0 if message.since is None else max(0.0, now - message.echo - message.since / 1e3),
        )
        self._socket.session.controls(self.name, message.seq, controls)

    def _expect(self, within_s: float | None) -> None:
        """Wait at most this long for the next controls; None: wait for nothing."""
        if self._silence is not None:
            self._silence.cancel()
        loop = asyncio.get_running_loop()
        self._silence = None if within_s is None else loop.call_later(within_s, self._seems_silent)

    def _seems_silent(self) -> None:
        # When this thread itself was held up, the timer goes off before the sockets are read: read them first.
        self._silence = asyncio.get_running_loop().call_later(LAST_LOOK_S, self._fell_silent)

    def _fell_silent(self) -> None:
        self._must_release = True
        self._count("page fell silent while driving")
        self._socket.session.gone(self.name)

    async def _answer(self, message: _Act) -> None:
        answer = await self._judge(message)
        self._requests -= 1
        await self._websocket.send_text(_text({**answer, "type": "reply", "id": message.id}))

    async def _judge(self, message: _Act) -> Answer:
        visitor = self._present()
        if visitor is None:
            self._count("request without a session")
            return Answer(ok=False, reasons=["your session is over: sign in again"])
        if not may_ask(visitor.role, message.what):
            self._count("request beyond the role")
            return Answer(ok=False, reasons=[f"you are signed in as {visitor.role}, who may not do this; STOP you may"])
        asker = Asker(self.name, visitor)
        if message.what == "stop":
            return await self._socket.stop(asker, message.id)
        return await self._socket.ask(asker, message.what, message.value, message.text)


def _text(message: dict[str, Any]) -> str:
    return msgspec.json.encode(message).decode()
