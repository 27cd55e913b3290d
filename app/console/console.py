"""The console: pad, page and scene around one robot process, started and ended together."""

import gc
import getpass
import json
import logging
import os
import signal
import sys
import threading
import time
import webbrowser
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol

from app import logs, runtime
from app.bus_routes import rerouted
from app.commands.command import as_options
from app.console import listening
from app.console.detail import Detail, rate_of
from app.console.driver import Driver
from app.console.front_door import FrontDoor
from app.console.gamepad import Gamepad
from app.console.inputs import Controls
from app.console.listening import Tls, load_tls, own_names
from app.console.pad_profile import PadProfiles
from app.console.pad_routes import pad_routes
from app.console.pilot import Pilot
from app.console.recording import RecorderProcess
from app.console.recordings_page import recordings_routes
from app.console.robot_connection import Keeper, RobotConnection
from app.console.robot_elsewhere import RobotElsewhere
from app.console.robot_keeper import RobotKeeper
from app.console.seat import PAD, Seat
from app.console.session import ConsoleSession
from app.console.viewer import Viewer
from app.console.views import Views
from app.link.access import DIRECT, LinkAccess
from app.metrics import Metrics
from app.people.audit import AuditTrail
from app.people.sessions import Sessions
from app.people.users import Users
from app.recording import storage
from app.recording.drive_from import DriveFrom, plan
from cobra.clock import SystemClock
from cobra.control.realtime import ahead_of_others, as_others
from cobra.description import RobotDescription
from cobra.loading import load_description, parse_description
from cobra.messages import Meta, Request
from cobra.simulation.options import AS_DESCRIBED, Simulation

log = logging.getLogger("cobra.console")
SWITCH_INTERVAL_S = 0.0005
LOG_TOO_LATE = "the robot process was running already: --record-can and --can-log count from its next start"


@dataclass(frozen=True, slots=True, kw_only=True)
class ConsoleOptions:
    """What the command line chose."""

    robot: str = "cobra"
    """Name or path of a description; of a robot elsewhere its name, or empty for the only one there."""
    endpoint: str = ""
    """Where a robot elsewhere is heard; empty for one of this machine."""
    access: LinkAccess = DIRECT
    simulation: Simulation = AS_DESCRIBED
    routes: tuple[str, ...] = ()
    host: str = "127.0.0.1"
    port: int = 8080
    tls_cert: Path | None = None
    tls_key: Path | None = None
    names: tuple[str, ...] = ()
    insecure: bool = False
    open_page: bool = True
    pad: bool = True
    frame_rate_Hz: float = 30.0
    can_log: Path | None = None
    leave_robot: bool = False
    record: bool = True
    record_folder: Path | None = None
    """None for the user's own."""
    record_budget_GB: float = 20.0
    drive_from: Path | None = None
    """A recording whose sticks drive the twin."""
    record_can: bool = False
    """Write the raw frames beside the recording."""


class Console:
    """Starts everything in order, waits until it is told to quit, and ends everything in reverse."""

    def __init__(self, options: ConsoleOptions) -> None:
        self._options = options
        self._quit = threading.Event()

    def quit(self) -> None:
        """End the console. Safe from any thread."""
        self._quit.set()

    def run(self) -> int:
        """Run until Ctrl-C, SIGTERM or the page's quit. Returns the exit status.

        Raises:
            DescriptionError, BusyError, RobotStartError, LinkError: with one clear line.
        """
        with ahead_of_others():
            return self._start()

    def _start(self) -> int:
        options = self._options
        # The pad's thread and the driver's must not wait 5 ms behind a busy scene.
        sys.setswitchinterval(SWITCH_INTERVAL_S)
        users, tls = Users(), load_tls(options.tls_cert, options.tls_key)
        danger = listening.danger(options.host, bool(users.all()), tls is not None, options.insecure)
        elsewhere = RobotElsewhere(options.endpoint, options.access, options.robot) if options.endpoint else None
        description = elsewhere.find() if elsewhere else load_description(options.robot)
        if options.drive_from:
            plan(options.drive_from, rerouted(description, options.routes))  # before anything is started
        place = f"{description.name}-elsewhere" if elsewhere else description.name
        _refuse_a_second(place, description.name)
        logs.start(f"console-{place}")
        recording = _recording_path(options, description.name)
        keeper = elsewhere or RobotKeeper(options.robot, description.name, _robot_options(options, recording))
        keeper.launch()
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda *_: self.quit())
        robot = RobotConnection(keeper, description.name)
        recorder = _recorder(options, description.name, recording, robot) if recording else None
        if recorder:
            robot.on_connect = recorder.connect
            recorder.start()
        try:
            welcome = _Welcome(Sessions(users, getpass.getuser()), tls, danger)
            self._run(description, place, keeper, robot, welcome, recorder)
        finally:
            runtime.unregister("console", place)
            robot.stop()
            if not options.leave_robot:
                keeper.end()
            if recorder:
                recorder.stop()  # last, so that the robot's end is in it
        return 0

    def _run(
        self,
        description: RobotDescription,
        place: str,
        keeper: Keeper,
        robot: RobotConnection,
        welcome: "_Welcome",
        recorder: RecorderProcess | None,
    ) -> None:
        options, clock = self._options, SystemClock()
        port, note = _choose_port(options.port)
        seat = Seat(getpass.getuser(), shared=not welcome.sessions.sign_in_needed)
        pads = PadProfiles()
        pads.start()
        pilot = Pilot(description, clock, pads.of, seat.admits)
        driver = Driver(
            seat,
            pilot,
            lambda: robot.link,
            clock,
            robot.warn,
            recorder.sent if recorder else lambda wanted, command: None,
        )
        trail = AuditTrail(description.name)
        trail.start()

        def pad_changed(controls: Controls) -> None:
            pilot.update(PAD, controls)
            driver.wake()

        pad = Gamepad(on_change=pad_changed, clock=clock) if options.pad else None

        def viewer(detail: Detail) -> Viewer:
            rate_Hz = rate_of(detail, options.frame_rate_Hz)
            made = Viewer(description, robot.latest, rate_Hz, detail, truth=robot.truth, push=robot.push)
            made.sticks = lambda: pilot.frame
            return made

        views = Views(len(description.sections), viewer)
        views.start()
        meta = robot.start()
        if meta.walls is not None:
            views.surround(meta.walls, robot.touch)
        late = not options.endpoint and keeper.adopted and (options.record_can or options.can_log)
        for warning in (*meta.notes, *((LOG_TOO_LATE,) if late else ())):
            robot.warn(warning)
            print(f"cobra-teleop: {warning}", file=sys.stderr)
        session = ConsoleSession(
            description=description,
            robot=robot,
            pilot=pilot,
            driver=driver,
            pad=pad,
            trail=trail,
            versions=meta.versions,
            quit_console=self.quit,
            clock=clock,
            danger=welcome.danger,
            elsewhere=options.endpoint,
            recorder=recorder,
        )
        metrics = Metrics(
            lambda: {description.name: robot},
            lambda name: description,
            lambda: door.counts,
            lambda: door.people,
            lambda: {description.name: driver.lag_s},
        )
        door = FrontDoor(
            options.host,
            port,
            views.full.port,
            session,
            sessions=welcome.sessions,
            viewer_secret=views.full.secret,
            thin_viewer=views.thin,
            more=(
                *pad_routes(pads, armed=lambda: _armed(robot)),
                *recordings_routes((options.record_folder or storage.default_folder()).absolute()),
            ),
            tls=welcome.tls,
            metrics=metrics,
            names=own_names(options.host, options.names),
        )
        door.start()
        runtime.register("console", place, door.url)
        parts: list[_Part] = [door, session, driver, *([pad] if pad else []), views, trail]
        try:
            driver.start()
            if pad:
                pilot.attach(PAD, pad)
                pad.start()
            if options.drive_from:
                parts.insert(0, drive_from := _drive_from(options.drive_from, meta, pilot, driver, robot))
                drive_from.start()
            _say(description, door.url, note, _how(options, keeper), welcome.danger)
            if options.open_page and _has_screen():
                threading.Thread(target=_open_browser, args=(door.url,), daemon=True).start()
            # A full collection over everything imported would stop the driver's stream for too long.
            gc.collect()
            gc.freeze()
            self._quit.wait()
        finally:
            for part in parts:
                part.stop()


class _Welcome(NamedTuple):
    """How people are let in."""

    sessions: Sessions
    tls: Tls | None
    danger: str


def _armed(robot: RobotConnection) -> bool:
    """Whether the drives may be on, as far as is known."""
    state = robot.latest()
    return state is None or state.phase != "disarmed"


def _drive_from(path: Path, meta: Meta, pilot: Pilot, driver: Driver, robot: RobotConnection) -> DriveFrom:
    """What the robot process says of itself counts: it may have been there before us, with another description."""

    def tell(text: str) -> None:
        robot.warn(text)
        print(text, flush=True)

    return DriveFrom(
        path,
        parse_description(meta.description, "the running robot's description"),
        pilot,
        simulated=meta.simulated,
        arm=lambda: driver.ask(Request(what="arm")),
        latest=robot.latest,
        wake=driver.wake,
        tell=tell,
    )


class _Part(Protocol):
    def stop(self) -> None: ...


def _refuse_a_second(place: str, robot: str) -> None:
    if other := runtime.find("console", place):
        raise runtime.BusyError(
            f"robot {robot!r} is driven already by the console of process {other.pid}; its page is {other.endpoint} "
            "(end it there, or with Ctrl-C where it was started)"
        )


def _recording_path(options: ConsoleOptions, robot: str) -> Path | None:
    """Where this session is recorded; None when it is not to be."""
    if not options.record:
        return None
    return storage.new_path((options.record_folder or storage.default_folder()).absolute(), robot, time.time())


def _recorder(options: ConsoleOptions, name: str, path: Path, robot: RobotConnection) -> RecorderProcess:
    settings = {name: str(getattr(options, name)) for name in options.__dataclass_fields__}
    more = ["--record-budget", str(options.record_budget_GB), "--settings", json.dumps(settings)]
    for word, file in (("--account", options.access.account), ("--ca", options.access.ca)):
        more += [word, str(file)] if file else []
    if options.endpoint:
        more.append("--wait")  # a network may be cut for a while
    return RecorderProcess(name, path, more, robot.warn, lambda: tuple(robot.events))


def _robot_options(options: ConsoleOptions, recording: Path | None) -> tuple[str, ...]:
    log_file = options.can_log.absolute() if options.can_log else None
    if options.record_can and recording is not None:
        recording.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        log_file = log_file or recording.with_name(recording.name.removesuffix(storage.SUFFIX) + ".can.log")
    routes = (word for route in options.routes for word in ("--bus", route))
    return (*as_options(options.simulation), *routes, *(("--can-log", str(log_file)) if log_file else ()))


def _choose_port(wanted: int) -> tuple[int, str]:
    """The wanted port, or the next free one and a note that says who has the wanted one."""
    holder = runtime.port_holder(wanted) if wanted else None
    if holder is None:
        return wanted, ""
    port = runtime.free_port(wanted + 1)
    return port, f"Port {wanted} is held by {holder}; using {port} instead."


def _how(options: ConsoleOptions, keeper: Keeper) -> str:
    if options.endpoint:
        return f"driven through {options.endpoint}"
    return "adopted the running robot process" if keeper.adopted else "started"


def _say(description: RobotDescription, url: str, note: str, how: str, danger: str) -> None:
    for line in filter(None, (note, danger)):
        print(line, flush=True)
    print(f"{description.title}: {how}. Page: {url}   (Ctrl-C ends it)", flush=True)


def _open_browser(url: str) -> None:
    """In a thread of its own, as its precedence is its own: the browser is one of the other programs."""
    as_others()
    webbrowser.open(url)


def _has_screen() -> bool:
    return sys.platform != "linux" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
