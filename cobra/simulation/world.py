"""The world behind a simulated CAN channel: drives, the plant they move, and the passing of time.

Frames are answered at once from the drives' last snapshot; no lock is held that a sender needs while the plant computes.
"""

import logging
import threading
from collections.abc import Callable
from typing import Final, Literal

import numpy as np

from cobra.clock import Clock
from cobra.description import Motor, RobotDescription
from cobra.motors.rmd import DIALECTS
from cobra.simulation.load_cells import amplifiers
from cobra.simulation.lost_motion import LostMotion
from cobra.simulation.node import DriveNode, Frame, Node
from cobra.simulation.plant import Floats, Plant, Truth
from cobra.simulation.rmd_drive import RmdDrive
from cobra.simulation.servos import Servos, State

Stepping = Literal["thread", "inline"]

CHUNK_S: Final = 0.002
"""Drives and plant advance in steps of this length."""
MAX_CATCH_UP_S: Final = 0.1
"""If the machine stalls for longer, the time beyond is dropped and counted: the world must not race afterwards."""
SLACK_M: Final = (0.001, 0.004)
"""Each tendon starts with some slack in this range."""

_log = logging.getLogger(__name__)


class World:
    """Simulated drives of a robot and their plant; `plant=None` is a robot without any load.

    Args:
        description: the robot that its drivers believe in.
        true: the robot that it is; the same by default.
        notes: what people should know of this world.
    """

    def __init__(
        self,
        description: RobotDescription,
        plant: Plant | None,
        clock: Clock,
        stepping: Stepping,
        seed: int,
        true: RobotDescription | None = None,
        notes: tuple[str, ...] = (),
    ) -> None:
        rng = np.random.default_rng(seed)
        true = true or description
        motors = [true.motor_of(drive) for drive in true.drives]
        self.description = description
        self.notes = notes
        self.clock = clock
        self.stepping = stepping
        self.servos = Servos(motors)
        self.drives: tuple[DriveNode, ...] = tuple(
            _node_type(motor)(drive.address, motor, self.servos, i, clock, rng)
            for i, (drive, motor) in enumerate(zip(description.drives, motors, strict=True))
        )
        self._say: Callable[[str, str, list[Frame]], None] = lambda *_: None
        self.dropped_s = 0.0
        """Simulated time lost to a stalled machine."""
        self.failure: Exception | None = None
        """What ended the world, if it ended by itself."""
        self.plant = plant
        # Tension pulls a tendon out, along its travel; the others' loads are forces of the drive, which bears their reaction.
        self._reaction = np.array([1.0 if drive.moves == "tendon" else -1.0 for drive in description.drives])
        self._start_travel: Floats = np.array([_start_travel(description, i, rng) for i in range(len(motors))])
        self._lost_motion = LostMotion(true, np.random.default_rng([seed, 0x5B001]))
        self._travel = self._start_travel
        self._load: Floats = np.zeros(len(motors))
        self.amplifiers = amplifiers(description, lambda: self._load, clock, np.random.default_rng([seed, 0xCE115]))
        """Of the load cells, by bus and name."""
        self._speakers: tuple[tuple[str, str, Node], ...] = tuple(
            (bus.name, name, node)
            for bus in description.buses
            for name, node in self.nodes_on(bus.name).items()
            if node.speaks
        )
        """By bus and name; asked each time, as it must not take time for a drive to answer what it was just told."""
        self._time_s = clock.now()
        self._stepping_lock = threading.Lock()
        self._stopped = threading.Event()
        self._thread: threading.Thread | None = None

    def nodes_on(self, bus_name: str) -> dict[str, Node]:
        """The drives and load cells of a bus, by name."""
        drives = zip(self.description.drives, self.drives, strict=True)
        own: dict[str, Node] = {drive.name: node for drive, node in drives if drive.bus == bus_name}
        return own | {name: node for (bus, name), node in self.amplifiers.items() if bus == bus_name}

    def start(self, say: Callable[[str, str, list[Frame]], None]) -> None:
        """Let time pass. `say(bus name, drive name, frames)` is called with what drives send unasked."""
        self._say = say
        self._time_s = self.clock.now()
        if self.stepping == "thread":
            self._thread = threading.Thread(target=self._run, name="simulated-world", daemon=True)
            self._thread.start()

    def stop(self) -> None:
        self._stopped.set()
        if self._thread is not None:
            self._thread.join()

    @property
    def travel(self) -> Floats:
        """Where the drives' ends really are (drives,): m of tendon paid out, m of feed, rad of twist."""
        return self._travel

    @property
    def load(self) -> Floats:
        """What the plant says the drives bear (drives,): N, or N·m for the twist."""
        return self._load

    @property
    def states(self) -> tuple[State, ...]:
        """The drives' states, one snapshot."""
        return self.servos.states

    @property
    def time_s(self) -> float:
        """Up to when the world has advanced [s, its clock]."""
        return self._time_s

    def truth(self) -> Truth | None:
        """The plant's own truth; None without a plant."""
        return self.plant.truth() if self.plant is not None else None

    def advance_to(self, now_s: float) -> None:
        """Let the world catch up with the clock, in whole chunks."""
        with self._stepping_lock:
            behind = now_s - self._time_s
            if self.stepping == "thread" and behind > MAX_CATCH_UP_S:
                self.dropped_s += behind - MAX_CATCH_UP_S
                self._time_s = now_s - MAX_CATCH_UP_S
            # Half a nanosecond forgives the rounding of clocks that count in decimal steps.
            while self._time_s + CHUNK_S <= now_s + 5e-10 and not self._stopped.is_set():
                self._step()
                self._time_s += CHUNK_S
            for bus, name, node in self._speakers:
                self._say(bus, name, node.unasked())

    def _step(self) -> None:
        torque = self._load * self._reaction * self._lost_motion.lever(self.servos.angle)
        angle = self.servos.step(torque, CHUNK_S)
        self._travel = self._start_travel + self._lost_motion.travel(angle)
        if self.plant is not None:
            self._load = self.plant.advance(self._travel, CHUNK_S)

    def _run(self) -> None:
        try:
            while not self._stopped.wait(CHUNK_S):
                self.advance_to(self.clock.now())
        except Exception as error:
            # Kept for every sender and receiver, who report it as a dead adapter.
            _log.exception("the simulated world stopped")
            self.failure = error


def _start_travel(description: RobotDescription, index: int, rng: np.random.Generator) -> float:
    drive = description.drives[index]
    if drive.moves == "tendon":
        return float(rng.uniform(*SLACK_M))
    return description.feed.start_m if drive.moves == "feed" and description.feed else 0.0


def _node_type(motor: Motor) -> Callable[[int, Motor, Servos, int, Clock, np.random.Generator], DriveNode]:
    if motor.protocol in DIALECTS:
        return RmdDrive
    # Only who has CANopen drives waits for that package.
    from cobra.simulation.cia402_drive import Cia402Drive  # noqa: PLC0415

    return Cia402Drive
