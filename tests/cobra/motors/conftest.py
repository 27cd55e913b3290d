"""A bus under test on a wire with handmade drives."""

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from cobra.clock import ManualClock
from cobra.motors.rmd_bus import RmdBus
from tests.cobra.motors.handmade_drives import HandmadeDrive, Rig, Wire, robot


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Rig]]:
    """Make a bus of n handmade drives; `change` may alter them before they are found."""

    made: list[RmdBus] = []

    def make(
        n: int = 3,
        protocol: str = "rmd-v1",
        change: Callable[[list[HandmadeDrive]], None] = lambda drives: None,
        **teleop: Any,
    ) -> Rig:
        clock = ManualClock()
        drives = [HandmadeDrive(i + 1, v3=protocol == "rmd-v3", shaft_deg=100.0 * i) for i in range(n)]
        change(drives)
        wire = Wire(clock, drives)
        monkeypatch.setattr("can.Bus", lambda **_: wire)
        description = robot(n, protocol, **teleop)
        bus = RmdBus(description, description.buses[0], clock, {})
        bus.open()
        made.append(bus)
        return Rig(bus, wire, clock)

    yield make
    for bus in made:
        bus.close()
