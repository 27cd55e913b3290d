"""Simulated drives as a python-can interface: `can.Bus(interface="cobra-sim", channel="cobra")` works from anywhere.

The channel is the name of a robot or the path of a description, optionally with `#BUS`, one of its buses. There is one world
per robot and process: all Bus objects of a channel see each other's frames, like nodes of a real bus, and the world lives as
long as one of them is open.
"""

import math
import threading
from collections.abc import Sequence
from queue import Empty, SimpleQueue
from typing import Any, Final, get_args

import can

from cobra.clock import Clock, SystemClock
from cobra.description import RobotDescription
from cobra.loading import DescriptionError, load_description, robot_names
from cobra.simulation.losses import Losses
from cobra.simulation.node import Frame
from cobra.simulation.options import NOWHERE_ELSE, Simulation, SimulationError
from cobra.simulation.plant import Plant
from cobra.simulation.wire import Timing, Wire
from cobra.simulation.world import CHUNK_S, Stepping, World

QUEUE_FRAMES: Final = 16384
"""Unread frames that a Bus keeps; later ones are lost, as in a real adapter."""
POLL_S: Final = 0.1
"""How often a receiver that waits for longer looks whether the world still exists."""


class _Network:
    """One world and the wires of its buses."""

    def __init__(self, world: World, timing: Timing, latency_s: float, seed: int) -> None:
        self.world = world
        self.wires = {
            bus.name: Wire(world.nodes_on(bus.name), world.clock.now, bus.bitrate, timing, latency_s, seed)
            for bus in world.description.buses
        }

    @property
    def used(self) -> bool:
        return any(wire.adapters for wire in self.wires.values())

    def say(self, bus_name: str, drive: str, frames: list[Frame]) -> None:
        self.wires[bus_name].say(drive, frames)


_networks: dict[str, _Network] = {}
_networks_lock = threading.Lock()


def world_of(channel: str) -> World:
    """The world behind an open channel, for tests and for publishing its truth.

    Raises:
        KeyError: no Bus of this channel is open in this process.
    """
    robot = channel.partition("#")[0]
    with _networks_lock:
        if robot not in _networks:
            raise KeyError(f"no simulated channel {robot!r} is open in this process; open are {sorted(_networks)}")
        return _networks[robot].world


def wire_of(channel: str, bus: str) -> Wire:
    """The medium of a described bus of an open channel, to make faults on it. Raises KeyError like `world_of`."""
    world_of(channel)
    return _networks[channel.partition("#")[0]].wires[bus]


class SimulatedBus(can.BusABC):
    """A node on a simulated channel.

    Who opens the first one decides on the world; the options of later ones must be left out or be the same.
    """

    def __init__(
        self,
        channel: str = "cobra",
        can_filters: Any = None,
        *,
        twin: str | Plant = "default",
        losses: Losses = "off",
        world: str = "free",
        world_scale: float = 1.0,
        world_pose: Sequence[float] = NOWHERE_ELSE,
        payload_kg: float = 0.0,
        gravity_m_s2: Sequence[float] | None = None,
        clock: Clock | None = None,
        stepping: Stepping = "thread",
        seed: int = 0,
        timing: str = "instant",
        latency_ms: float = 0.0,
        description: RobotDescription | None = None,
        bitrate: int = 1_000_000,
    ) -> None:
        """Join the channel, and make its world if there is none yet.

        Args:
            twin: "default", "ideal", "dynamics" (the equations of motion instead of MuJoCo, for robots that have them) or
                "none", or a plant of one's own.
            losses: of the default twin: "seeded" draws stiffness, friction, lost motion and routing within ±30 % of the
                description's by `seed`, "nominal" takes the description's, "off" has no friction and no lost motion.
            world, world_scale, world_pose, payload_kg, gravity_m_s2: as in `Simulation`. A world that cannot be used
                leaves the robot in free space; `World.notes` say why.
            clock: what the world's time follows; the system's by default.
            stepping: "thread" advances the world in the background, "inline" only in `send` and `recv`.
            seed: of the drives' positions at power-up, the tendons' slack, and the losses.
            timing: "instant", or "bit-true": frames take their exact bits at the described bit rate and arbitrate.
            latency_ms: how long a drive thinks before it answers.
            description: instead of the file that the channel names.
            bitrate: accepted as from any interface; the described one counts.

        Raises:
            can.CanInitializationError: no such robot, bus, twin, stepping or timing, or the channel is another robot's.
        """
        self.channel_info = f"simulated drives of {channel}"
        self._queue: SimpleQueue[can.Message | None] = SimpleQueue()
        self._waits = False
        self.lost = 0
        """Frames lost because nobody read them."""
        self._robot, _, wanted = channel.partition("#")
        with _networks_lock:
            network = _networks.get(self._robot)
            if network is None:
                description = description or _load(self._robot)
                simulation = _simulation(
                    twin=twin if isinstance(twin, str) else "none",
                    losses=losses,
                    seed=seed,
                    world=world,
                    world_scale=world_scale,
                    world_pose=tuple(world_pose),
                    payload_kg=payload_kg,
                    gravity_m_s2=tuple(gravity_m_s2) if gravity_m_s2 is not None else None,
                )
                step = _checked("stepping", stepping, Stepping)
                made = _make_world(description, simulation, twin, clock or SystemClock(), step)
                network = _Network(made, _checked("timing", timing, Timing), latency_ms / 1000.0, seed)
            elif description is not None and description != network.world.description:
                raise can.CanInitializationError(f"channel {channel!r} is open already, with another description")
            self._network = network
            self.world = network.world
            self.bus_name = _bus_name(self.world.description, channel, wanted)
            self._inline = self.world.stepping == "inline"
            super().__init__(channel, can_filters)
            self._wire = network.wires[self.bus_name]
            self._wire.adapters = (*self._wire.adapters, self)
            if self._robot not in _networks:
                _networks[self._robot] = network
                self.world.start(network.say)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Put a frame on the bus; with instant timing the drives' replies are there when it returns."""
        self._check()
        if self._inline:
            self._advance()
        self._wire.send(self, msg)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """The next frame; None after `timeout` seconds. Inline, waiting is what lets the clock and the world go on."""
        self._check()
        clock = self.world.clock
        deadline = math.inf if timeout is None else clock.now() + timeout
        while True:
            self._waits = not self._inline
            self._wire.settle()
            now = clock.now()
            wake = min(deadline, self._wire.next_s, now + (CHUNK_S if self._inline else POLL_S))
            try:
                frame = self._queue.get_nowait() if self._inline or wake <= now else self._queue.get(timeout=wake - now)
                if frame is not None:
                    return frame
            except Empty:
                if now >= deadline:
                    return None
            finally:
                self._waits = False
            if self._inline:
                clock.sleep_until(wake)
                self._advance()
            self._check()

    def nudge(self) -> None:
        """A frame is on its way that whoever waits here does not know of; called by the wire."""
        if self._waits:
            self._waits = False
            self._queue.put(None)

    def receive(self, frame: can.Message) -> None:
        """Take a frame that another node sent; called by the wire."""
        if not self._matches_filters(frame):
            return
        if self._queue.qsize() < QUEUE_FRAMES:
            self._queue.put(frame)
        else:
            self.lost += 1

    def flush_tx_buffer(self) -> None:
        """Forget what still waits to be sent."""
        self._wire.purge(self)

    def shutdown(self) -> None:
        """Leave the channel; the last one ends its world."""
        super().shutdown()
        with _networks_lock:
            network = self._network
            self._wire.leave(self)
            if not network.used and _networks.get(self._robot) is network:
                del _networks[self._robot]
                network.world.stop()

    @staticmethod
    def _detect_available_configs() -> list[Any]:
        return [{"interface": "cobra-sim", "channel": name} for name in robot_names()]

    def _advance(self) -> None:
        self.world.advance_to(self.world.clock.now())

    def _check(self) -> None:
        if self._is_shutdown:
            raise can.CanOperationError(f"{self.channel_info}: the bus is shut down")
        if self.world.failure is not None:
            raise can.CanOperationError(f"{self.channel_info}: the world stopped: {self.world.failure}")


def _load(robot: str) -> RobotDescription:
    try:
        return load_description(robot)
    except DescriptionError as error:
        raise can.CanInitializationError(str(error)) from None


def _simulation(**options: Any) -> Simulation:
    try:
        return Simulation(**options)
    except SimulationError as error:
        raise can.CanInitializationError(str(error)) from None


def _make_world(
    description: RobotDescription, simulation: Simulation, twin: str | Plant, clock: Clock, stepping: Stepping
) -> World:
    try:
        true = simulation.true(description)
    except SimulationError as error:
        raise can.CanInitializationError(str(error)) from None
    notes: list[str] = []
    plant = _make_plant(true, simulation, notes) if isinstance(twin, str) else twin
    return World(description, plant, clock, stepping, simulation.seed, true, tuple(notes))


def _make_plant(true: RobotDescription, simulation: Simulation, notes: list[str]) -> Plant | None:
    if simulation.twin == "none":
        return None
    if simulation.twin == "dynamics":
        from cobra.simulation.chain_plant import ChainPlant  # noqa: PLC0415

        return ChainPlant(true)
    # Only who has a twin waits for the physics to be imported.
    from cobra.simulation.environments import WallsError, environment  # noqa: PLC0415
    from cobra.simulation.twin import build_twin  # noqa: PLC0415

    try:
        walls = environment(simulation.world, true, simulation.world_scale, simulation.world_pose)
    except WallsError as fault:
        walls = None
        notes.append(f"{fault}; going on in free space")
    twin = build_twin(true, simulation.twin, simulation.payload_kg, walls)
    if true.hand_fed and twin.chain.longest_m < true.backbone.total_length_m:
        notes.append(f"among walls the simulated hand feeds it out by {twin.chain.longest_m * 1e3:.0f} mm at most")
    return twin


def _checked(option: str, value: str, allowed: Any) -> Any:
    if value not in get_args(allowed):
        raise can.CanInitializationError(f"{option} = {value!r}: must be one of {', '.join(get_args(allowed))}")
    return value


def _bus_name(description: RobotDescription, channel: str, wanted: str) -> str:
    """The described bus that a channel stands for: the one named, else the one with this channel, else the first."""
    names = [bus.name for bus in description.buses]
    if not wanted:
        return next((bus.name for bus in description.buses if bus.channel == channel), names[0])
    if wanted not in names:
        raise can.CanInitializationError(f"channel {channel!r}: {description.name} has no bus {wanted!r}, but {names}")
    return wanted
