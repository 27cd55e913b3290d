"""The control loop on simulated drives and the twin, ticked by hand with a clock of the test's own."""

import msgspec

from cobra.clock import ManualClock
from cobra.control.loop import RobotLoop
from cobra.description import RobotDescription
from cobra.loading import load_description
from cobra.messages import Calibration, Command, Event, Intent, Reply, Request, RobotState, encode
from cobra.motors.cell_readings import LoadCells
from cobra.motors.open_bus import open_bus
from cobra.simulation.losses import Losses
from cobra.simulation.options import Simulation, TwinKind

CHANNEL = "cobra"


class Bench:
    """The control loop on its twin, ticked by hand."""

    def __init__(
        self,
        seed: int,
        twin: TwinKind = "default",
        robot: str = CHANNEL,
        description: RobotDescription | None = None,
        losses: Losses = "off",
        world: str = "free",
    ) -> None:
        description = description or load_description(robot)
        options = {"twin": twin, "stepping": "inline", "seed": seed, "losses": losses, "world": world}
        buses = tuple(
            msgspec.structs.replace(bus, channel=f"{robot}#{bus.name}", options=options) for bus in description.buses
        )
        self.description = msgspec.structs.replace(description, buses=buses)
        self.believed = Simulation(twin=twin, losses=losses, seed=seed).told(self.description)
        self.clock = ManualClock()
        self.states: list[RobotState] = []
        self.events: list[Event] = []
        self.calibrations: list[Calibration] = []
        self._sequence = 0
        self.mode = "section"

    def __enter__(self):
        cells = LoadCells(self.description, self.clock)
        self._bus = open_bus(self.description, self.clock, cells=cells)
        self._bus.open()
        self.loop = RobotLoop(
            self.believed,
            self._bus,
            self.clock,
            self.states.append,
            self.events.append,
            calibrated=self.calibrations.append,
            cells=cells,
        )
        reply = self.ask(Request(what="acquire", who="test"))
        self.lease, self.epoch = reply.lease, reply.epoch
        return self

    def __exit__(self, *_: object) -> None:
        self._bus.close()

    def tick(self, intent: Intent | None = None) -> RobotState:
        """One tick with a command of the driver: hold the dead-man with this intent, or let go."""
        self._sequence += 1
        command = Command(
            lease=self.lease,
            epoch=self.epoch,
            sequence=self._sequence,
            echo=self.states[-1].stamp,
            mode=self.mode,
            held=intent is not None,
            intent=intent or Intent(),
        )
        self.loop.inbox.command(encode(command))
        self.loop.tick()
        self.clock.advance(self.loop.period_s)
        return self.states[-1]

    def ask(self, request: Request) -> Reply:
        answers: list[Reply] = []
        self.loop.inbox.request(encode(request), answers.append)
        self.loop.tick()
        self.clock.advance(self.loop.period_s)
        return answers[0]

    def home(self, seconds: float = 30.0) -> RobotState:
        for _ in range(5):
            self.tick()
        reply = self.ask(Request(what="arm", lease=self.lease))
        assert reply.ok, reply.reasons
        for _ in range(round(seconds / self.loop.period_s)):
            if self.tick().phase != "homing":
                break
        return self.states[-1]
