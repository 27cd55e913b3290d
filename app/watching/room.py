"""A watched robot's own page: the operator's page and scene, where nobody can drive. Made when somebody comes to look."""

import threading
from concurrent.futures import Future

from app.console.detail import Detail, rate_of
from app.console.page_socket import PageSocket, SeatRequest
from app.console.page_state import SeatState
from app.console.pilot import Pilot
from app.console.seat import Occupant
from app.console.session import ConsoleSession
from app.console.viewer import Viewer
from app.console.viewer_proxy import ViewerProxy
from app.console.views import Views
from app.watching.feeds import WatchedRobot
from cobra.clock import SystemClock
from cobra.loading import parse_description
from cobra.messages import Reply, Request

ONLY_WATCHES = Reply(ok=False, reasons=("this console only watches",))


class Spectator:
    """Stands where a driver would: passes STOP on, and nothing else."""

    def __init__(self, robot: WatchedRobot) -> None:
        self._robot = robot
        self.errors: dict[str, int] = {}
        self.lag_s = 0.0

    def wake(self) -> None:
        """There is no stream of commands to wake."""

    def halt(self, who: str, reason: str = "") -> Future[bool]:
        return self._robot.stop(who, reason)

    def ask(self, request: Request, asker: Occupant) -> Reply:
        return ONLY_WATCHES

    def change(self, asker: Occupant, what: SeatRequest, text: str, yes: bool) -> Reply:
        return ONLY_WATCHES

    def vacate(self, page: str) -> None:
        """A page of a watching console holds nothing."""

    def seat_state(self) -> SeatState:
        return SeatState(shared=False, page="", console_pad=False)


class Room:
    """Page, scene and proxy of one robot."""

    def __init__(self, robot: WatchedRobot, frame_rate_Hz: float) -> None:
        """Ask the robot what it is and open its scene.

        Raises:
            LinkError: it does not answer.
            DescriptionError: it is of a kind that this program does not know.
        """
        clock, meta = SystemClock(), robot.meta()
        description = parse_description(meta.description, f"robot {robot.name!r}")
        self._session = ConsoleSession(
            description=description,
            robot=robot,
            pilot=Pilot(description, clock),
            driver=Spectator(robot),
            pad=None,
            versions=meta.versions,
            quit_console=lambda: None,
            clock=clock,
        )

        def viewer(detail: Detail) -> Viewer:
            return Viewer(description, robot.latest, rate_of(detail, frame_rate_Hz), detail)

        self._views = Views(len(description.sections), viewer)
        self._views.start()
        if meta.walls is not None:
            self._views.surround(meta.walls, lambda: None)  # what touches is told to the robot's own console
        self.proxy = ViewerProxy(*self._views.full, self._views.thin)
        self.pages = PageSocket(self._session, behind=self.proxy.behind)

    @property
    def visitors(self) -> int:
        """Who is in it now: pages, and views without a page."""
        return self.pages.pages + self.proxy.viewers

    def stop(self) -> None:
        self._session.stop()
        self._views.stop()


class Rooms:
    """Rooms by robot; each is opened once, whoever comes first, and closed when it stood empty."""

    def __init__(self, robots: dict[str, WatchedRobot], frame_rate_Hz: float) -> None:
        self._robots = robots
        self._frame_rate_Hz = frame_rate_Hz
        self._rooms: dict[str, Room] = {}
        self._empty: set[str] = set()
        self._lock = threading.Lock()

    def open(self, name: str) -> Room | None:
        """The room of a robot, or None for one that is not known. Blocks while it is being made.

        Raises:
            LinkError, DescriptionError: see `Room`.
        """
        robot = self._robots.get(name)
        if robot is None:
            return None
        with self._lock:
            self._empty.discard(name)
            if name not in self._rooms:
                self._rooms[name] = Room(robot, self._frame_rate_Hz)
            return self._rooms[name]

    def get(self, name: str) -> Room | None:
        """The room if it is open now."""
        return self._rooms.get(name)

    @property
    def visitors(self) -> int:
        """Who is in any of them now."""
        return sum(room.visitors for room in tuple(self._rooms.values()))

    def close_empty(self) -> None:
        """Close what nobody was in now and at the last call."""
        with self._lock:
            empty = {name for name, room in self._rooms.items() if room.visitors == 0}
            gone = [self._rooms.pop(name) for name in empty & self._empty]
            self._empty = empty
        for room in gone:
            room.stop()

    def stop(self) -> None:
        with self._lock:
            for room in self._rooms.values():
                room.stop()
            self._rooms.clear()
