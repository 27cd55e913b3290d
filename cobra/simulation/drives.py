"""Simulated drives as a python-can interface: `can.Bus(interface="cobra-sim", channel="cobra")` works from anywhere.

The channel is the name of a robot or the path of a description, optionally with `#BUS`, one of its buses. There is one world
per robot and process: all Bus objects of a channel see each other's frames, like nodes of a real bus, and the world lives as
long as one of them is open.
"""

import copy
import math
import threading
from queue import Empty, SimpleQueue
from typing import Any, Final, cast, get_args

import can

from cobra.clock import Clock, SystemClock
from cobra.description import RobotDescription
from cobra.loading import DescriptionError, load_description, robot_names
from cobra.simulation.losses import Losses, with_losses
from cobra.simulation.plant import Plant
from cobra.simulation.world import CHUNK_S, Stepping, World

QUEUE_FRAMES: Final = 16384
"""Unread frames that a Bus keeps; later ones are lost, as in a real adapter."""
POLL_S: Final = 0.1
"""How often a receiver that waits for longer looks whether the world still exists."""
TWINS: Final = ("default", "ideal", "none")


class _Network:
    """One world and the Bus objects on its channels."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.nodes: tuple[SimulatedBus, ...] = ()

    def deliver(self, bus_name: str, arbitration_id: int, data: bytes) -> None:
        """Give every node on a bus a frame that a drive sends."""
        for node in self.nodes:
            if node.bus_name == bus_name:
                node.receive(_frame(self.world.clock.now(), arbitration_id, data))

    def forward(self, frame: can.Message, sender: "SimulatedBus") -> None:
        """Give every other node of the sender's bus a copy of its frame."""
        for node in self.nodes:
            if node is not sender and node.bus_name == sender.bus_name:
                copied = copy.deepcopy(frame)
                copied.timestamp, copied.is_rx = self.world.clock.now(), True
                node.receive(copied)


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
        losses: str = "off",
        clock: Clock | None = None,
        stepping: Stepping = "thread",
        seed: int = 0,
        description: RobotDescription | None = None,
        bitrate: int = 1_000_000,
    ) -> None:
        """Join the channel, and make its world if there is none yet.

        Args:
            twin: "default", "ideal" or "none", or a plant of one's own.
            losses: of the default twin: "seeded" draws stiffness, friction, lost motion and routing within ±30 % of the
                description's by `seed`, "nominal" takes the description's, "off" has no friction and no lost motion.
            clock: what the world's time follows; the system's by default.
            stepping: "thread" advances the world in the background, "inline" only in `send` and `recv`.
            seed: of the drives' positions at power-up, the tendons' slack, and the losses.
            description: instead of the file that the channel names.
            bitrate: accepted as from any interface; frames take no time.

        Raises:
            can.CanInitializationError: no such robot, bus, twin or stepping, or the channel is another robot's.
        """
        self.channel_info = f"simulated drives of {channel}"
        self._queue: SimpleQueue[can.Message] = SimpleQueue()
        self.lost = 0
        """Frames lost because nobody read them."""
        self._robot, _, wanted = channel.partition("#")
        with _networks_lock:
            network = _networks.get(self._robot)
            if network is None:
                description = description or _load(self._robot)
                true = with_losses(description, _losses(twin, losses), seed)
                plant = _make_plant(twin, true)
                world = World(description, plant, clock or SystemClock(), _checked(stepping), seed, true)
                network = _Network(world)
            elif description is not None and description != network.world.description:
                raise can.CanInitializationError(f"channel {channel!r} is open already, with another description")
            self._network = network
            self.world = network.world
            self.bus_name = _bus_name(self.world.description, channel, wanted)
            self._inline = self.world.stepping == "inline"
            super().__init__(channel, can_filters)
            network.nodes = (*network.nodes, self)
            if self._robot not in _networks:
                _networks[self._robot] = network
                self.world.start(network.deliver)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Deliver a frame and, at once, the reply of the drive that it asks."""
        self._check()
        if self._inline:
            self._advance()
        network = self._network
        if len(network.nodes) > 1:
            network.forward(msg, self)
        if msg.is_error_frame or msg.is_remote_frame or msg.is_extended_id or msg.is_fd:
            return
        answer = self.world.answer(self.bus_name, msg.arbitration_id, bytes(msg.data))
        if answer is not None:
            network.deliver(self.bus_name, *answer)

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """The next frame; None after `timeout` seconds. Inline, waiting is what lets the clock and the world go on."""
        self._check()
        remaining = math.inf if timeout is None else timeout
        while True:
            step = min(remaining, CHUNK_S if self._inline else POLL_S)
            try:
                if self._inline or step <= 0:
                    return self._queue.get_nowait()
                return self._queue.get(timeout=step)
            except Empty:
                if remaining <= 0:
                    return None
            if self._inline:
                self.world.clock.sleep_until(self.world.clock.now() + step)
                self._advance()
            self._check()
            remaining -= step

    def receive(self, frame: can.Message) -> None:
        """Take a frame that another node sent; called by the network."""
        if not self._matches_filters(frame):
            return
        if self._queue.qsize() < QUEUE_FRAMES:
            self._queue.put(frame)
        else:
            self.lost += 1

    def flush_tx_buffer(self) -> None:
        """Nothing waits here: frames take no time."""

    def shutdown(self) -> None:
        """Leave the channel; the last one ends its world."""
        super().shutdown()
        with _networks_lock:
            network = self._network
            network.nodes = tuple(node for node in network.nodes if node is not self)
            if not network.nodes and _networks.get(self._robot) is network:
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


def _frame(time_s: float, arbitration_id: int, data: bytes) -> can.Message:
    return can.Message(timestamp=time_s, arbitration_id=arbitration_id, is_extended_id=False, data=data)


def _load(robot: str) -> RobotDescription:
    try:
        return load_description(robot)
    except DescriptionError as error:
        raise can.CanInitializationError(str(error)) from None


def _make_plant(twin: str | Plant, description: RobotDescription) -> Plant | None:
    if not isinstance(twin, str):
        return twin
    if twin not in TWINS:
        raise can.CanInitializationError(f"twin = {twin!r}: must be one of {', '.join(TWINS)}")
    if twin == "none":
        return None
    # Only who has a twin waits for the physics to be imported.
    from cobra.simulation.twin import build_twin  # noqa: PLC0415

    return build_twin(description, "ideal" if twin == "ideal" else "default")


def _losses(twin: str | Plant, losses: str) -> Losses:
    """Only the default twin has any: the ideal one is ideal, and a plant of one's own has its own."""
    if losses not in get_args(Losses):
        raise can.CanInitializationError(f"losses = {losses!r}: must be one of {', '.join(get_args(Losses))}")
    return cast(Losses, losses) if twin == "default" else "off"


def _checked(stepping: str) -> Stepping:
    if stepping not in get_args(Stepping):
        raise can.CanInitializationError(f"stepping = {stepping!r}: must be one of {', '.join(get_args(Stepping))}")
    return cast(Stepping, stepping)


def _bus_name(description: RobotDescription, channel: str, wanted: str) -> str:
    """The described bus that a channel stands for: the one named, else the one with this channel, else the first."""
    names = [bus.name for bus in description.buses]
    if not wanted:
        return next((bus.name for bus in description.buses if bus.channel == channel), names[0])
    if wanted not in names:
        raise can.CanInitializationError(f"channel {channel!r}: {description.name} has no bus {wanted!r}, but {names}")
    return wanted
