"""The robot process: opens the motor bus, runs the loop, speaks on the link. It has no screen."""

import logging
import os
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from importlib import metadata
from pathlib import Path
from typing import TypeVar

import msgspec

from app import logs, places, runtime
from app.bus_routes import rerouted
from app.calibrations import calibrations
from app.link.access import DIRECT, LinkAccess, LinkError, on_loopback
from app.link.robot_end import RobotLink
from app.people.audit import AuditTrail
from app.robot_deeds import RobotDeeds
from app.simulated_robot import is_simulated, simulated
from app.twin_hand import TwinHand
from app.twin_pushes import TwinPushes
from cobra.clock import SystemClock
from cobra.control.loop import RobotLoop
from cobra.control.poses import PoseBook
from cobra.control.realtime import OTHERS_PRIORITY, ask_for_realtime
from cobra.description import RobotDescription
from cobra.loading import description_text
from cobra.messages import Event, Meta, Walls
from cobra.motors.cell_readings import LoadCells
from cobra.motors.open_bus import open_bus
from cobra.simulation.drives import world_of
from cobra.simulation.environments import Environment
from cobra.simulation.options import AS_DESCRIBED, Simulation
from cobra.simulation.world import World

log = logging.getLogger("cobra.robot")
T = TypeVar("T")

ORPHANED_S = 60.0
TRUTH_RATE_Hz = 50.0
VERSIONS = ("cobra-teleop", "mujoco", "python-can", "eclipse-zenoh", "numpy")


def run_robot(
    robot: str,
    *,
    endpoint: str | None = None,
    simulation: Simulation = AS_DESCRIBED,
    router: str | None = None,
    access: LinkAccess = DIRECT,
    routes: Sequence[str] = (),
    can_log: Path | None = None,
    orphaned_s: float = ORPHANED_S,
    leave_when_orphaned: bool = False,
) -> int:
    """Run a robot until it is told to quit. Returns the exit status.

    Args:
        robot: name of a preset or path of a description.
        endpoint: where the link listens; a free loopback port by default.
        simulation: of the drives that are simulated, and of what they move.
        router: where a router is, through which consoles elsewhere reach this robot.
        access: account and certificates for the router.
        routes: described buses led to other adapters, as `app.bus_routes` reads them.
        can_log: file that gets every CAN frame.
        orphaned_s: after this long without a console the description's final action is taken.
        leave_when_orphaned: also exit then; else wait for the next console, disarmed.

    Raises:
        DescriptionError, LinkError, BusError: with one clear line.
    """
    description = rerouted(simulated(robot, simulation), routes)
    ask_for_realtime(OTHERS_PRIORITY)  # every thread that starts from here on has it too
    logs.start(f"robot-{description.name}")
    if endpoint and not on_loopback(endpoint):
        raise LinkError(
            f"{endpoint} is open to the network, and whoever reaches it could drive: listen on loopback, and let the "
            "robot connect to a router with --router, which asks for accounts"
        )
    endpoint = endpoint or f"tcp/127.0.0.1:{runtime.any_free_port()}"
    clock = SystemClock()
    trail = AuditTrail(description.name)
    trail.start()
    deeds = RobotDeeds(trail)
    done = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: done.set())
    believed = simulation.told(description)
    cells = LoadCells(description, clock)
    with open_bus(description, clock, can_log, cells) as bus:
        world = _world(description)
        link = RobotLink(
            description.name,
            endpoint,
            _meta(robot, world, is_simulated(description)),
            router,
            access,
            audit=lambda: msgspec.msgpack.encode(trail.tail()),
        )
        hand = TwinHand(world.plant, description) if world and world.plant else None
        poses = PoseBook(description, places.data_folder() / "poses" / f"{description.name}.json")
        loop = RobotLoop(
            believed,
            bus,
            clock,
            _all(link.publish_state, deeds.state, *((hand.state,) if hand else ())),
            _announcing(link),
            _all(link.publish_heard, deeds.heard),
            poses,
            link.publish_calibration,
            cells,
            calibrations(description),
        )
        loop.commissioning.start()
        poses.complain = loop.warn
        poses.start()
        pushes = TwinPushes(world.plant, description, clock) if world and world.plant else None
        link.start(
            loop.inbox.command,
            _all(loop.inbox.stop, deeds.stopped),
            loop.inbox.request,
            loop.inbox.length,
            pushes.take if pushes else None,
        )
        runtime.register("robot", description.name, endpoint)
        watch = _Watch(link, lambda: loop.abandon(leave_when_orphaned), orphaned_s)
        helpers = [
            threading.Thread(target=watch.run, args=(done,), name="watch", daemon=True),
            threading.Thread(target=loop.prepare, name="prepare", daemon=True),
        ]
        if publish := _truth_publisher(world, link, pushes):
            helpers.append(threading.Thread(target=publish, args=(done,), name="truth", daemon=True))
        for helper in helpers:
            helper.start()
        try:
            loop.run(done)
        finally:
            done.set()
            runtime.unregister("robot", description.name)
            for helper in helpers:
                helper.join(1.0)
            loop.commissioning.stop()
            poses.stop()
            link.stop()
            trail.stop()
    return 0


def _all(*listeners: Callable[[T], None]) -> Callable[[T], None]:
    def call(value: T) -> None:
        for listen in listeners:
            listen(value)

    return call


class _Watch:
    """Takes the final action when no console has been there for a while."""

    def __init__(self, link: RobotLink, action: Callable[[], None], after_s: float) -> None:
        self._link, self._action, self._after_s = link, action, after_s

    def run(self, done: threading.Event) -> None:
        alone = 0.0
        step = min(1.0, self._after_s / 4)
        seen = False
        while not done.wait(step):
            seen = seen or self._link.consoles > 0
            alone = alone + step if seen and self._link.consoles == 0 else 0.0
            if alone >= self._after_s:
                log.warning("no console for %.0f s: taking the final action", alone)
                self._action()
                seen = False


def _world(description: RobotDescription) -> World | None:
    """The simulated world in this process; None on hardware."""
    simulated = [bus for bus in description.buses if bus.interface == "cobra-sim"]
    return world_of(simulated[0].channel) if simulated else None


def _truth_publisher(
    world: World | None, link: RobotLink, pushes: TwinPushes | None
) -> Callable[[threading.Event], None] | None:
    """A thread's body that publishes the twin's truth, for tests and the scene only; None without a twin here."""
    plant = world.plant if world else None
    if plant is None:
        return None

    def publish(done: threading.Event) -> None:
        while not done.wait(1.0 / TRUTH_RATE_Hz):
            if pushes is not None:
                pushes.expire()
            link.publish_truth(msgspec.msgpack.encode(plant.truth(), enc_hook=lambda array: array.tolist()))

    return publish


def _announcing(link: RobotLink) -> Callable[[Event], None]:
    """Events go to the consoles and into the log."""
    levels = {"info": logging.INFO, "warning": logging.WARNING, "alarm": logging.ERROR}

    def announce(event: Event) -> None:
        link.publish_event(event)
        log.log(levels.get(event.level, logging.INFO), event.text, extra={"stamp": event.stamp})

    return announce


def _meta(robot: str, world: World | None, simulated: bool) -> Meta:
    versions = {name: metadata.version(name) for name in VERSIONS}
    versions["python"] = sys.version.split()[0]
    environment = world.plant.environment if world and world.plant else None
    return Meta(
        description=description_text(robot),
        versions=versions,
        pid=os.getpid(),
        simulated=simulated,
        walls=_walls(environment) if environment else None,
        notes=world.notes if world else (),
    )


def _walls(environment: Environment) -> Walls:
    return Walls(
        title=environment.title,
        vertices=environment.vertices.astype("<f4").tobytes(),
        faces=environment.faces.astype("<u4").tobytes(),
        solid_from=len(environment.faces) if environment.solid_from is None else environment.solid_from,
    )
