"""One robot on two buses and two protocols: its tendons on RMD drives, twist and feed on CiA 402; homed and driven."""

import msgspec
import numpy as np
import pytest

from cobra.description import Bus, RobotDescription
from cobra.loading import contradictions, load_description
from cobra.messages import Intent
from cobra.simulation.drives import wire_of, world_of
from tests.bench import Bench


def mixed() -> RobotDescription:
    d = load_description("cobra")
    positioner = msgspec.structs.replace(
        d.motors[0], name="positioner", protocol="cia402", encoder_bits=12, gear_ratio=24.0, current_per_count_A=0.002
    )
    second = Bus(name="base", interface="cobra-sim", channel="cobra#base")
    drives = tuple(
        drive
        if drive.moves == "tendon"
        else msgspec.structs.replace(drive, motor="positioner", bus="base", address=drive.address - 12)
        for drive in d.drives
    )
    return msgspec.structs.replace(d, motors=(*d.motors, positioner), buses=(*d.buses, second), drives=drives)


def test_it_is_a_valid_description() -> None:
    assert contradictions(mixed()) == []


def test_it_is_armed_homed_and_driven_and_a_fault_on_one_bus_holds_both() -> None:
    with Bench(3, description=mixed()) as bench:
        bench.home()
        start = bench.tick()
        for _ in range(100):
            state = bench.tick(Intent(primary=(1.0, 0.0), twist=1.0, feed=1.0))
        assert state.phase == "driving"
        assert state.bus == {}
        moved = np.array(state.measured) - np.array(start.measured)
        assert moved[0] > np.radians(20.0)
        assert moved[1] > 0.015
        assert np.hypot(*moved[2:4]) > np.radians(10.0)
        world = world_of("cobra")
        assert np.degrees(world.travel[12]) == pytest.approx(np.degrees(state.drives.travel[12]), abs=0.5)

        wire_of("cobra", "base").faults.drop["twist"] = 1.0
        for _ in range(8):
            state = bench.tick(Intent(primary=(1.0, 0.0), twist=1.0))
        assert state.phase == "holding"
        assert "no answer from twist" in state.cause
        held = np.array(state.commanded)
        for _ in range(20):
            state = bench.tick(Intent(primary=(1.0, 0.0)))
        assert np.array(state.commanded) == pytest.approx(held, abs=np.radians(6.0))
        assert all(command.mode == "position" for command in world.servos.commands)
