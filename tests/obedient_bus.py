"""A control loop on drives that stand where they were told to at once: for what the loop asks of them, tick by tick."""

import numpy as np

from cobra.clock import ManualClock
from cobra.control.loop import RobotLoop
from cobra.description import RobotDescription
from cobra.messages import Command, Event, Intent, Reply, Request, RobotState, encode
from cobra.motors.bus import ChannelHealth, Feedback


class ObedientBus:
    """Implements `MotorBus` without drives: every setpoint is reached within the tick, and nothing carries a load."""

    counts: dict[str, int]
    notes: tuple[str, ...] = ()
    health: tuple[ChannelHealth, ...] = ()
    waited_s = 0.0

    def __init__(self, drives: int) -> None:
        self.counts = {}
        self.angles = np.zeros(drives)
        self.faults = ("",) * drives
        self.sent: list[np.ndarray] = []

    def open(self) -> None: ...

    def close(self) -> None: ...

    def enable(self) -> tuple[str, ...]:
        return ()

    def disable(self) -> None: ...

    def hold(self) -> None: ...

    def burst(self, angles: np.ndarray | None) -> None:
        self._asked = angles

    def collect(self) -> Feedback:
        self.gather()
        return self.told()

    def gather(self) -> None:
        self._answer = self.exchange(self._asked)

    def told(self) -> Feedback:
        return self._answer

    def exchange(self, angles: np.ndarray | None) -> Feedback:
        if angles is not None:
            self.angles = angles.copy()
            self.sent.append(angles.copy())
        n = len(self.angles)
        zeros = np.zeros(n)
        return Feedback(
            angle=self.angles.copy(),
            velocity=zeros,
            current=zeros,
            temperature=zeros + 30.0,
            voltage=zeros + 24.0,
            age=zeros,
            valid=np.ones(n, dtype=bool),
            missed=np.zeros(n, dtype=np.int64),
            faults=self.faults,
        )


class ObedientRobot:
    """A robot's loop, armed and homed at `q`, ticked by hand as a driver's commands would."""

    def __init__(self, description: RobotDescription, q: np.ndarray | None = None) -> None:
        self.description = description
        self.clock = ManualClock()
        self.states: list[RobotState] = []
        self.events: list[Event] = []
        self.bus = ObedientBus(len(description.drives))
        self.loop = RobotLoop(description, self.bus, self.clock, self.states.append, self.events.append)
        self._sequence = 0
        reply = self.ask(Request(what="acquire", who="test"))
        self.lease, self.epoch = reply.lease, reply.epoch
        self.tick()
        self.place(self.loop.motion.q if q is None else q)
        reply = self.ask(Request(what="arm", lease=self.lease))
        assert reply.ok, reply.reasons
        self.tick()
        assert self.states[-1].phase == "ready"

    def place(self, q: np.ndarray) -> None:
        """Let the robot stand at q, homed."""
        self.loop.drivetrain.refer(self.bus.angles, self.loop.drivetrain.travel_of(q))
        self.loop.motion.reset(q)
        self.loop.supervisor.homed = True

    @property
    def q(self) -> np.ndarray:
        return self.loop.motion.q

    @property
    def state(self) -> RobotState:
        return self.states[-1]

    def send(self, mode: str = "section", held: bool = False, **intent: object) -> None:
        """One command, without a tick."""
        self._sequence += 1
        command = Command(
            lease=self.lease,
            epoch=self.epoch,
            sequence=self._sequence,
            echo=self.states[-1].stamp,
            mode=mode,
            held=held,
            intent=Intent(**intent),
        )
        self.loop.inbox.command(encode(command))

    def step(self) -> RobotState:
        self.loop.tick()
        self.clock.advance(self.loop.period_s)
        return self.states[-1]

    def tick(self, mode: str = "section", held: bool = False, **intent: object) -> RobotState:
        """One tick with one command."""
        if self.states:
            self.send(mode, held, **intent)
        return self.step()

    def press(self, mode: str, **intent: object) -> None:
        """Let go, choose a mode, wait until it stands, and press with the sticks centred."""
        for _ in range(60):
            self.tick(mode, **intent)
        assert self.tick(mode, held=True, **intent).phase == "driving", self.state.cause

    def drive(self, mode: str, seconds: float, **intent: object) -> None:
        for _ in range(round(seconds / self.loop.period_s)):
            self.tick(mode, held=True, **intent)

    def ask(self, request: Request) -> Reply:
        answers: list[Reply] = []
        self.loop.inbox.request(encode(request), answers.append)
        self.step()
        return answers[0]
