"""The 3D view as a service: a viser server on loopback, fed with the newest state at a fixed rate.

It takes what is newest and skips what it missed. A state that cannot be drawn is counted, and the view goes on.
"""

import logging
import math
import secrets
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING

import rich
import viser
from viser import _messages

from app.console.client_view import ClientView
from app.console.detail import FULL, Detail
from app.console.meshes import Floats
from app.console.motion_view import MotionView
from app.console.panels import STALE_S, Panels, ViewTiming
from app.console.plots import SAMPLE_S, History
from app.console.scene import EXTRA_PARTS, PARTS, BadStateError, Parts, Scene
from app.console.simulated_walls import SimulatedWalls
from app.console.twin_view import TwinView
from app.console.viewer_guard import guarded
from app.console.viewer_proxy import PLAIN, ROLE_HEADER, TIP, VIEW_HEADER
from app.console.viser_backlog import join_at_once
from cobra.clock import Clock, SystemClock
from cobra.control.modes.stick_frame import StickFrame
from cobra.description import RobotDescription
from cobra.mechanics.described import is_chain
from cobra.messages import Push, RobotState, Touch, Walls

if TYPE_CHECKING:
    from app.console.prediction import PredictedView

log = logging.getLogger("cobra.viewer")
HOST = "127.0.0.1"
PATIENCE_S = 10.0
"""For the last frame at the end: viser complains on the terminal of one that comes after it was stopped."""
WALLS_EVERY = 3
"""Contacts are drawn every so many frames."""
SHEATH = 1.15
"""Radius of the predicted shape over that of the drawn tube: seen where they agree as well."""
RATE_FRAMES = 60
"""Frames over which the frame rate is taken."""


class Viewer:
    """Owns the viser server, the scene, its panels, and the thread that feeds them."""

    def __init__(
        self,
        description: RobotDescription,
        latest: Callable[[], RobotState | None],
        rate_Hz: float = 30.0,
        detail: Detail = FULL,
        clock: Clock | None = None,
        stale_s: float = STALE_S,
        truth: Callable[[], bytes | None] = lambda: None,
        push: Callable[[Push], None] = lambda push: None,
    ) -> None:
        """`latest` gives the newest state, or None before the first; it is called once a frame.

        What has not changed for `stale_s` is drawn as lost. `truth` gives the twin's own, None without one; `push` takes
        what people push on it with the mouse.
        """
        self._stale_s = stale_s
        self._truth = truth
        self._push = push
        self._twin: TwinView | None = None
        self._predicted: PredictedView | None = None
        self._description = description
        self._detail = detail
        self._latest = latest
        self._period_s = 1.0 / rate_Hz
        self._clock = clock or SystemClock()
        self._quit = threading.Event()
        self._thread: threading.Thread | None = None
        self._server: viser.ViserServer | None = None
        self._clients: dict[int, ClientView] = {}
        self._building = threading.Lock()
        self._frames: deque[float] = deque(maxlen=RATE_FRAMES)
        self._frame_time_s = 0.0
        self._seen: tuple[float, int] | None = None
        self._shown: RobotState | None = None
        self._arrived = 0.0
        self._next_panels = self._next_sample = 0.0
        self.secret = secrets.token_urlsafe(32)
        """viser answers only who shows this: the front door. Loopback is open to every user of this machine."""
        self._motion: MotionView | None = None
        self._walls: SimulatedWalls | None = None
        self._touch: Callable[[], Touch | None] = lambda: None
        self.sticks: Callable[[], StickFrame] = lambda: "world"
        """By which view the driver's sticks go; called once a frame and viewer."""
        self._number = 0
        self.errors: Counter[str] = Counter()
        """States and viewers that could not be served, by reason."""

    @property
    def port(self) -> int:
        """Where viser listens on loopback.

        Raises:
            RuntimeError: it has not been started.
        """
        return self._running().get_port()

    @property
    def viewers(self) -> int:
        """Clients that look at it now."""
        return len(self._clients)

    @property
    def frame_rate(self) -> float:
        """Frames drawn lately [Hz]."""
        frames = tuple(self._frames)
        return (len(frames) - 1) / (frames[-1] - frames[0]) if len(frames) > 1 and frames[-1] > frames[0] else 0.0

    def start(self) -> None:
        """Open viser on a free port of loopback and draw from now on."""
        self.open()
        self._thread = threading.Thread(target=self._run, name="viewer", daemon=True)
        self._thread.start()

    def open(self) -> None:
        """Open viser and build the view, without a thread: `step` draws."""
        self._quit.clear()
        self._server = _private_server(self.secret)
        self._scene = Scene(self._server, self._description, self._detail)
        self._panels = Panels(self._server, self._description)
        self._history = History(self._description)
        self._scene.start()
        self._motion = MotionView(self._server, self._description, self._scene.body)
        self._motion.start()
        radius = self._description.backbone.diameter_m / 2.0
        self._twin = TwinView(self._server, self._description, radius)
        if is_chain(self._description):
            # Its solvers take seconds to load on a busy machine: only for robots that have it.
            from app.console.prediction import PredictedView, Prediction  # noqa: PLC0415

            prediction = Prediction(self._description)
            self._predicted = PredictedView(self._server, prediction, SHEATH * self._scene.body.tube_radius_m)
        self._panels.start()
        self._server.on_client_connect(self._welcome)
        self._server.on_client_disconnect(self._farewell)

    def surround(self, walls: Walls, touch: Callable[[], Touch | None]) -> None:
        """Draw what surrounds a simulated robot; `touch` is asked from now on. After `open`, from any thread."""
        drawn = SimulatedWalls(self._running(), self._description, walls)
        drawn.start()
        self._touch, self._walls = touch, drawn

    def stop(self) -> None:
        """End the thread and close viser."""
        self._quit.set()
        if self._thread is not None:
            self._thread.join(timeout=PATIENCE_S)
            self._thread = None
        if self._server is not None:
            _hang_up(self._server)
            with silent():
                self._server.stop()
            self._server = None

    def forget(self) -> None:
        """Begin the histories anew: the tip's path and the plots."""
        self._scene.forget()
        self._history.forget()

    def step(self) -> None:
        """Draw one frame from the newest state. Nothing that a state holds can end it."""
        server, now = self._running(), self._clock.now()
        state = self._latest()
        if state is not None and (state.stamp, state.tick) != self._seen:
            self._seen, self._arrived = (state.stamp, state.tick), now
        drawn = state if state is not None and self._draw(state, now) else None
        self._shown = drawn or self._shown
        self._frames.append(now)
        self._counted("twin", partial(self._draw_twin, now))
        self._number += 1
        slow = self._number % self._detail.slow_every == 2
        if drawn is not None and self._predicted is not None and slow and self._wanted("predicted"):
            self._counted("prediction", partial(self._predicted.update, drawn, self._pushes()))
        if drawn is not None and self._motion is not None and slow:
            self._counted("motion", partial(self._motion.update, drawn, self._wanted("workspace")))
        if drawn is not None and now >= self._next_sample:
            self._next_sample = now + SAMPLE_S
            self._counted("plot", lambda: self._history.add(drawn))
        if self._walls is not None and self._number % WALLS_EVERY == 0:
            walls, touch = self._walls, self._touch()
            self._counted("walls", lambda: walls.update(touch))
        panels = now >= self._next_panels
        if panels:
            self._next_panels = now + self._detail.panel_period_s
            self._counted("panels", lambda: self._panels.update(self._shown, self._timing(now)))
        for number, view in list(self._clients.items()):
            self._counted("viewer", partial(view.update, panels), number)
        server.flush()
        self._frame_time_s += 0.05 * (self._clock.now() - now - self._frame_time_s)

    def _draw(self, state: RobotState, now: float) -> bool:
        """Whether the state was drawn; one that is too old is not."""
        age = now - self._arrived
        if age > self._stale_s:
            self._scene.show_stale(age)
            return False
        try:
            self._scene.update(state)
        except BadStateError as bad:
            self.errors[str(bad)] += 1
            return False
        return True

    def _draw_twin(self, now: float) -> None:
        data = self._truth()
        if data is not None and self._twin is not None and (self._wanted("twin") or not self._twin.built):
            for push in self._twin.update(data, now):
                self._push(push)

    def _pushes(self) -> dict[int, Floats]:
        return self._twin.pushes if self._twin is not None else {}

    def _wanted(self, part: str) -> bool:
        """Whether anybody looks at a part that costs something only then."""
        return any(view.shows(part) for view in tuple(self._clients.values()))

    def _parts(self) -> Parts:
        """What a viewer may hide here, and what it sees only when it wants to."""
        extra = dict(EXTRA_PARTS)
        if self._predicted is None:
            extra.pop("predicted")
        if self._truth() is None:
            extra.pop("twin")
        return PARTS | extra

    def _counted(self, what: str, action: Callable[[], object], client: int | None = None) -> None:
        """A fault in one panel or one viewer ends neither the view nor the others; it is counted and logged once.

        What fails because its client has just left is no fault.
        """
        try:
            action()
        except Exception as fault:  # viser raises what it likes; counted, and the view goes on
            if client is not None and (self._server is None or client not in self._server.get_clients()):
                return
            reason = f"{what}: {type(fault).__name__}"
            if reason not in self.errors:
                log.exception("%s could not be updated", what)
            self.errors[reason] += 1

    def _timing(self, now: float) -> ViewTiming:
        return ViewTiming(
            age_s=float("inf") if self._seen is None else 0.0 if math.isinf(self._stale_s) else now - self._arrived,
            frame_rate_Hz=self.frame_rate,
            frame_time_s=self._frame_time_s,
            viewers=self.viewers,
            errors=dict(self.errors),
        )

    def _welcome(self, client: viser.ClientHandle) -> None:
        connection = self._running()._websock_server._live_connections.get(client.client_id)
        if connection is None:
            return  # it has left already
        headers = connection.request.headers if connection.request else {}
        words = headers.get(VIEW_HEADER, "").split()
        view = ClientView(
            client,
            self._description,
            self._scene,
            self._panels,
            self._history,
            self._parts(),
            self.sticks,
            tip_only=TIP in words,
            plain=PLAIN in words,
            plot=self._detail.plot,
            looks_only=headers.get(ROLE_HEADER) == "viewer",
        )

        def build() -> None:
            with self._building:
                view.start()
                self._clients[client.client_id] = view
            if client.client_id not in self._running().get_clients():
                self._clients.pop(client.client_id, None)  # it left while it was being built

        self._counted("new viewer", build, client.client_id)

    def _farewell(self, client: viser.ClientHandle) -> None:
        self._clients.pop(client.client_id, None)
        if self._twin is not None:
            self._twin.forget(client.client_id)

    def _run(self) -> None:
        deadline = self._clock.now()
        while not self._quit.is_set():
            self._counted("frame", self.step)
            # A frame that took too long is not made up for.
            deadline = max(deadline + self._period_s, self._clock.now())
            self._clock.sleep_until(deadline)

    def _running(self) -> viser.ViserServer:
        if self._server is None:
            raise RuntimeError("the viewer is not running; call start() first")
        return self._server


def _hang_up(server: viser.ViserServer) -> None:
    """Drop all clients without a farewell: viser would wait 10 s for each that has stopped reading."""
    for connection in tuple(server._websock_server._live_connections.values()):
        server.get_event_loop().call_soon_threadsafe(connection.transport.abort)


@contextmanager
def silent() -> Iterator[None]:
    """viser prints its address when it starts and a line when it ends; people are to open the front door instead."""
    console = rich.get_console()
    quiet, console.quiet = console.quiet, True
    try:
        yield
    finally:
        console.quiet = quiet


def _private_server(secret: str) -> viser.ViserServer:
    """A server on a free port of loopback that answers only who knows the secret, and opens no public tunnel."""
    with silent(), guarded(secret):
        server = viser.ViserServer(host=HOST, port=0, verbose=False)
    for request in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):
        server._websock_server.unregister_handler(request)
    join_at_once(server)
    return server
