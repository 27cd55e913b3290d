"""Whatever is asked in whatever order: nothing jumps, no tendon is overloaded, and homing ends straight or says why not."""

from collections import deque

import numpy as np
import pytest

from cobra.messages import Intent, Request, RobotState, Stop, encode
from cobra.simulation.drives import world_of
from tests.bench import Bench

MOVING = ("driving", "ready", "holding")
STEP_M = 0.002
"""No tendon is told to go further in a tick."""
STRAIGHT_DEG = 3.0
OVER_N = 1.0
"""What a tension may be above its limit until a drive has answered."""


class Operator:
    """Does something at random, and looks at every tick."""

    def __init__(self, bench: Bench, robot: str, seed: int) -> None:
        self.bench, self.robot = bench, robot
        self.rng = np.random.default_rng([seed, 0xA11])
        self.done: deque[str] = deque(maxlen=6)
        self._own = list(bench.description.tendon_drives)
        self._last: RobotState | None = None
        assert bench.home().homed
        self.wait(0.05)

    def tick(self, intent: Intent | None = None) -> RobotState:
        state, last = self.bench.tick(intent), self._last
        if last and state.phase in MOVING and last.phase in MOVING:
            step = np.subtract(state.drives.setpoint, last.drives.setpoint)[self._own]
            assert np.abs(step).max() < STEP_M, self.done
        if state.phase in MOVING and state.tendons.tension:
            tendon = self.bench.description.tendon
            assert world_of(self.robot).truth().tensions.max() < tendon.max_tension_N + OVER_N, self.done
        self._last = state
        return state

    def wait(self, seconds: float) -> None:
        for _ in range(round(seconds / self.bench.loop.period_s)):
            self.tick()

    def ask(self, what: str, **more) -> bool:
        return self.bench.ask(Request(what=what, lease=self.bench.lease, **more)).ok

    def until_homed(self) -> None:
        while self.tick().phase in ("homing", "disarmed"):
            pass

    def something(self) -> None:
        what = self.rng.choice(["drive"] * 6 + ["mode"] * 2 + ["home", "tighten", "switch", "stop", "disarm", "lock"])
        self.done.append(str(what))
        getattr(self, what)()
        self.wait(0.4)

    def drive(self) -> None:
        def stick() -> tuple[float, float]:
            x, y = self.rng.uniform(-1.0, 1.0, 2)
            return float(x), float(y)

        twist, feed, length = (float(x) * (self.rng.uniform() < 0.4) for x in self.rng.uniform(-1.0, 1.0, 3))
        section = int(self.rng.integers(len(self.bench.description.active_sections)))
        intent = Intent(primary=stick(), secondary=stick(), twist=twist, feed=feed, length=length, section=section)
        for _ in range(int(self.rng.integers(30, 400))):
            self.tick(intent)

    def mode(self) -> None:
        self.bench.mode = str(self.rng.choice([name for name in self.bench.loop.motion.names if name != "pose"]))

    def home(self) -> None:
        self.wait(1.0)
        if self.ask("home"):
            self.until_homed()
            assert self.bench.states[-1].phase == "ready", self.bench.states[-1].cause
            bends = np.degrees(np.linalg.norm(world_of(self.robot).truth().bends, axis=1))
            assert bends.max() < STRAIGHT_DEG, self.done

    def tighten(self) -> None:
        self.ask("pretension", value=float(self.rng.uniform(2.0, 25.0)))
        self.wait(2.0)

    def switch(self) -> None:
        self.ask("compensation", value=float(self.rng.integers(2)))

    def stop(self) -> None:
        self.bench.loop.inbox.stop(encode(Stop(who="test", reason="somebody came near")))
        self.wait(0.3)
        assert self.bench.states[-1].phase == "stopped"
        reply = self.bench.ask(Request(what="acquire", who="test"))
        self.bench.lease, self.bench.epoch = reply.lease, reply.epoch
        assert self.ask("clear")

    def disarm(self) -> None:
        assert self.ask("disarm")
        self.wait(1.0)
        assert self.ask("arm")
        self.until_homed()

    def lock(self) -> None:
        self.ask(str(self.rng.choice(["lock", "unlock"])))
        for _ in range(300):
            self.tick(Intent())


@pytest.mark.long
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("robot", ["cobra", "cobra-active", "src-bot"])
def test_whatever_is_asked_in_whatever_order_nothing_jumps_and_homing_ends_straight(robot: str, seed: int) -> None:
    with Bench(seed=seed, robot=robot, losses="seeded") as bench:
        operator = Operator(bench, robot, seed)
        for _ in range(40):
            operator.something()
        operator.home()
