"""Simulated drives, asked over python-can with the vendor's bytes, pulling a plant of linear springs."""

import math
import struct
import threading
from collections.abc import Callable, Iterator
from typing import Any

import can
import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cobra.clock import ManualClock
from cobra.description import RobotDescription
from cobra.loading import load_description
from cobra.simulation.drives import SimulatedBus, world_of
from cobra.simulation.plant import Floats, Truth
from cobra.simulation.world import MAX_CATCH_UP_S

TENDONS = 12
TWIST, FEED = 12, 13


class Springs:
    """Each tendon is a spring that is just taut at travel 0; feed and twist are free."""

    environment = None

    def __init__(self, stiffness_N_m: float = 2000.0, bias_N: float = 0.0) -> None:
        self.stiffness = stiffness_N_m
        self.bias = bias_N
        self.calls: list[float] = []
        self.travel = np.zeros(14)
        self.gate: threading.Event | None = None

    def advance(self, travel: Floats, duration_s: float) -> Floats:
        self.calls.append(duration_s)
        self.travel = travel.copy()
        if self.gate is not None:
            self.gate.wait(10.0)
        load = np.zeros(14)
        load[:TENDONS] = np.maximum(0.0, self.bias - self.stiffness * travel[:TENDONS])
        return load

    def truth(self) -> Truth:
        tension = np.maximum(0.0, -self.stiffness * self.travel[:TENDONS])
        return Truth(
            sum(self.calls),
            np.zeros(3),
            np.array([1.0, 0, 0, 0]),
            np.zeros((1, 3)),
            np.zeros((3, 2)),
            tension,
            np.tile(tension[:, None], 5),
        )


def described(protocol: str = "rmd-v1", **motor: Any) -> RobotDescription:
    d = load_description("cobra")
    values = {
        "protocol": protocol, "gear_ratio": 9.0, "torque_constant_Nm_A": 0.25, "current_per_count_A": 0.01,
        "encoder_bits": 14, "max_speed_rad_s": 8.0, "max_acceleration_rad_s2": 80.0, "max_current_A": 4.0,
        "back_drive_torque_Nm": 0.02, "max_temperature_C": 80.0, "min_voltage_V": 20.0, "max_voltage_V": 52.0, **motor,
    }  # fmt: skip
    return msgspec.structs.replace(d, motors=(msgspec.structs.replace(d.motors[0], **values),))


class Desk:
    """A bus on simulated drives whose time goes on only when told to."""

    def __init__(self, channel: str, plant: Springs | str, description: RobotDescription, seed: int) -> None:
        self.clock = ManualClock()
        self.plant = plant
        self.bus = can.Bus(
            interface="cobra-sim", channel=channel, ignore_config=True, twin=plant, clock=self.clock, stepping="inline",
            seed=seed, description=description,
        )  # fmt: skip
        self.world = world_of(channel)
        self.v3 = description.motors[0].protocol == "rmd-v3"
        self.ratio = 1.0 if self.v3 else 9.0

    def ask(self, address: int, data: str | bytes) -> bytes:
        payload = bytes.fromhex(data) if isinstance(data, str) else data
        self.bus.send(can.Message(arbitration_id=0x140 + address, is_extended_id=False, data=payload.ljust(8, b"\0")))
        frame = self.bus.recv(0)
        assert frame is not None, f"no reply to {payload.hex(' ')}"
        assert frame.arbitration_id == (0x240 if self.v3 else 0x140) + address
        assert frame.data[0] == payload[0]
        return bytes(frame.data)

    def angle_deg(self, address: int) -> float:
        """Of the output shaft, by 0x92, unpacked by hand."""
        data = self.ask(address, "92")
        counts = struct.unpack("<i", data[4:])[0] if self.v3 else struct.unpack("<q", data)[0] >> 8
        return counts / 100 / self.ratio

    def go_to(self, address: int, degrees: float, dps: int = 4000) -> bytes:
        """0xA4 with an angle of the output shaft."""
        return self.ask(address, struct.pack("<BBHi", 0xA4, 0, dps, round(degrees * self.ratio * 100)))

    def wait(self, seconds: float) -> None:
        self.clock.advance(seconds)
        assert self.bus.recv(0) is None
        self.world.advance_to(self.clock.now())


@pytest.fixture
def desk() -> Iterator[Callable[..., Desk]]:
    made: list[Desk] = []

    def make(
        plant: Springs | str = "none", description: RobotDescription | None = None, seed: int = 0, channel: str = "desk"
    ) -> Desk:
        made.append(Desk(channel, plant, description or described(), seed))
        return made[-1]

    yield make
    for each in made:
        each.bus.shutdown()


Make = Callable[..., Desk]


def test_the_interface_is_known_to_python_can_by_its_name() -> None:
    with can.Bus(interface="cobra-sim", channel="cobra", ignore_config=True, twin="none") as bus:
        assert isinstance(bus, SimulatedBus)
        bus.send(can.Message(arbitration_id=0x141, is_extended_id=False, data=bytes.fromhex("9A00000000000000")))
        reply = bus.recv(1.0)
        assert reply is not None
        assert reply.data[0] == 0x9A
    assert {"interface": "cobra-sim", "channel": "cobra"} in can.detect_available_configs("cobra-sim")


@pytest.mark.parametrize("protocol", ["rmd-v1", "rmd-v3"])
def test_a_drive_goes_where_it_is_told_and_says_so_in_the_units_of_its_dialect(desk: Make, protocol: str) -> None:
    d = desk(description=described(protocol))
    start = d.angle_deg(3)
    d.go_to(3, start + 40.0)
    d.wait(0.5)
    assert d.angle_deg(3) == pytest.approx(start + 40.0, abs=0.011)
    assert math.degrees(d.world.states[2].angle_rad) == pytest.approx(40.0, abs=0.011)


def test_reads_are_answered_at_once_and_move_nothing(desk: Make) -> None:
    d = desk()
    for command in ("9A", "9C", "9D", "92", "94", "90", "30", "33"):
        d.ask(5, command)
    d.wait(0.2)
    assert [state.angle_rad for state in d.world.states] == [0.0] * 14


def test_status_in_v1_has_volts_at_byte_3_and_v3_at_byte_4(desk: Make) -> None:
    v1 = desk(channel="one").ask(1, "9A")
    v3 = desk(channel="three", description=described("rmd-v3")).ask(1, "9A")
    assert (v1[1], struct.unpack_from("<H", v1, 3)[0], v1[7]) == (25, 360, 0)
    assert (v3[1], v3[3], struct.unpack_from("<HH", v3, 4)) == (25, 1, (360, 0))


def test_undervoltage_and_heat_are_in_the_error_bits(desk: Make) -> None:
    d = desk()
    d.world.servos.supply_V = 18.0
    d.go_to(1, d.angle_deg(1))
    d.wait(0.01)
    status = d.ask(1, "9A")
    assert status[7] == 0x01


@pytest.mark.parametrize("dps", [900, 1800])
def test_speed_stays_under_the_setpoints_limit_and_acceleration_under_the_drives(desk: Make, dps: int) -> None:
    d = desk()
    start = d.angle_deg(1)
    d.go_to(1, start + 200.0, dps)
    speeds = [0.0]
    for _ in range(300):
        d.wait(0.002)
        speeds.append(d.world.states[0].velocity_rad_s)
    assert max(speeds) == pytest.approx(math.radians(dps / 9.0), rel=1e-6)
    assert np.abs(np.diff(speeds)).max() <= 80.0 * 0.002 * (1 + 1e-9)


def test_a_position_is_reached_without_overshoot(desk: Make) -> None:
    d = desk()
    start = d.angle_deg(1)
    d.go_to(1, start + 90.0, 65535)
    track = []
    for _ in range(400):
        d.wait(0.002)
        track.append(math.degrees(d.world.states[0].angle_rad))
    assert max(track) <= 90.0 + 0.01
    assert track[-1] == pytest.approx(90.0, abs=0.01)


def test_the_encoder_has_14_bits_of_the_motors_turn_and_is_not_the_multi_turn_angle(desk: Make) -> None:
    d = desk()
    start = d.angle_deg(1)
    first = struct.unpack_from("<H", d.ask(1, "9C"), 6)[0]
    d.go_to(1, start + 10.0)
    d.wait(0.5)
    second = struct.unpack_from("<H", d.ask(1, "9C"), 6)[0]
    assert (second - first) % 16384 == pytest.approx(90.0 / 360.0 * 16384, abs=2)
    assert first < 16384
    assert abs(first / 16384 * 360.0 - start * 9.0 % 360.0) > 0.1


def test_power_up_is_arbitrary_but_the_same_for_the_same_seed(desk: Make) -> None:
    def facts(d: Desk) -> list[float]:
        return [d.angle_deg(address) for address in range(1, 15)] + d.world.travel.tolist()

    one, same, other = (facts(desk(channel=f"seed{i}", seed=seed)) for i, seed in enumerate((1, 1, 2)))
    assert one == same
    assert all(a != b for a, b in zip(one[:26], other[:26], strict=True))
    assert len(set(one[:14])) == 14


def test_each_tendon_starts_with_1_to_4_mm_of_slack_and_the_feed_where_it_is_described(desk: Make) -> None:
    d = desk()
    travel = d.world.travel
    assert ((travel[:TENDONS] >= 0.001) & (travel[:TENDONS] <= 0.004)).all()
    assert travel[TWIST] == 0.0
    assert travel[FEED] == d.world.description.feed.start_m


def test_a_positive_angle_pays_out_and_a_reversed_drive_winds_in(desk: Make) -> None:
    description = described()
    drives = (
        description.drives[0],
        msgspec.structs.replace(description.drives[1], direction=-1),
        *description.drives[2:],
    )
    d = desk(description=msgspec.structs.replace(description, drives=drives))
    before = d.world.travel
    for address in (1, 2):
        d.go_to(address, d.angle_deg(address) + math.degrees(1.0))
    d.wait(1.0)
    moved = d.world.travel - before
    assert moved[:2] == pytest.approx([0.010, -0.010], abs=2e-6)


def test_a_wound_tendon_shows_its_tension_as_current_within_the_gears_friction(desk: Make) -> None:
    springs = Springs()
    d = desk(springs)
    wind = 0.015 + d.world.travel[0]
    d.go_to(1, d.angle_deg(1) - math.degrees(wind / 0.010))
    d.wait(1.5)
    assert d.world.load[0] == pytest.approx(30.0, rel=0.01)
    amperes = struct.unpack_from("<h", d.ask(1, "9C"), 2)[0] * 0.01
    # 30 N x 10 mm = 0.3 N·m, 0.02 N·m of friction either way, 0.25 N·m/A; winding in is the negative direction.
    assert -(0.32 / 0.25) - 0.006 <= amperes <= -(0.28 / 0.25) + 0.006
    assert d.world.truth().tensions[0] == pytest.approx(30.0, rel=0.01)


def test_a_drive_stalls_where_its_torque_ends(desk: Make) -> None:
    d = desk(Springs(stiffness_N_m=20_000.0))
    target = d.angle_deg(1) - math.degrees(0.030 / 0.010)
    d.go_to(1, target)
    d.wait(3.0)
    # 4 A x 0.25 N·m/A on 10 mm, and at rest 0.02 N·m of friction either way.
    assert 97.5 <= d.world.load[0] <= 102.5
    assert d.world.states[0].velocity_rad_s == pytest.approx(0.0, abs=0.01)
    assert d.angle_deg(1) > target + 20.0
    assert abs(d.world.states[0].current_A) <= 4.0 + 1e-9


def test_an_overload_pulls_a_holding_drive_along(desk: Make) -> None:
    springs = Springs(stiffness_N_m=500.0)
    d = desk(springs)
    d.go_to(1, d.angle_deg(1))
    d.wait(0.1)
    held = d.world.travel[0]
    springs.bias = 90.0
    d.wait(0.5)
    assert d.world.travel[0] == pytest.approx(held, abs=1e-4)
    springs.bias = 130.0
    d.wait(2.0)
    assert d.world.travel[0] > held + 0.005


@pytest.mark.parametrize(("tension", "moves"), [(1.9, False), (2.1, True)])
def test_a_drive_that_is_off_is_moved_only_by_more_than_its_back_drive_torque(
    desk: Make, tension: float, moves: bool
) -> None:
    """0.02 N·m on a spool of 10 mm: 2 N."""
    springs = Springs(stiffness_N_m=0.0, bias_N=tension)
    d = desk(springs)
    before = d.world.travel[0]
    d.ask(1, "80")
    d.wait(0.5)
    assert (d.world.travel[0] > before + 1e-4) == moves
    assert struct.unpack_from("<h", d.ask(1, "9C"), 2)[0] == 0


def test_switching_off_lets_a_loaded_tendon_go_and_stopping_does_not(desk: Make) -> None:
    d = desk(Springs())
    start = d.angle_deg(1)
    for address in (1, 2):
        d.go_to(address, d.angle_deg(address) - 100.0)
    d.wait(1.0)
    tight = d.world.load[:2].copy()
    d.ask(1, "80")
    d.ask(2, "81")
    d.wait(2.0)
    assert d.world.load[0] < 3.0 < tight[0]
    assert d.world.load[1] == pytest.approx(tight[1], rel=0.02)
    assert d.angle_deg(1) > start - 100.0


def test_stopping_in_motion_brakes_at_once_and_holds(desk: Make) -> None:
    d = desk()
    d.go_to(1, d.angle_deg(1) + 300.0, 4000)
    d.wait(0.3)
    speed, angle = d.world.states[0].velocity_rad_s, d.world.states[0].angle_rad
    assert speed > 5.0
    d.ask(1, "81")
    d.wait(1.0)
    assert d.world.states[0].velocity_rad_s == pytest.approx(0.0, abs=1e-3)
    assert d.world.states[0].angle_rad - angle == pytest.approx(speed**2 / (2 * 80.0), rel=0.15)


def test_torque_drives_against_friction_and_up_to_the_limit_of_speed(desk: Make) -> None:
    d = desk()
    d.ask(1, "A1 00 00 00 05 00 00 00")
    d.wait(0.2)
    assert d.world.states[0].angle_rad == 0.0
    d.ask(1, "A1 00 00 00 2C 01 00 00")
    d.wait(1.0)
    assert d.world.states[0].velocity_rad_s == pytest.approx(8.0, rel=0.01)


def test_holding_a_load_warms_the_motor(desk: Make) -> None:
    d = desk(Springs())
    for _ in range(40):
        d.go_to(1, d.angle_deg(1) - 30.0) if d.world.load[0] < 70.0 else None
        d.wait(1.0)
    assert d.ask(1, "9A")[1] >= 27
    assert d.ask(2, "9A")[1] == 25


@pytest.mark.parametrize(
    "frame",
    [
        can.Message(arbitration_id=0x141, is_extended_id=False, data=bytes.fromhex("A4")),
        can.Message(arbitration_id=0x141, is_extended_id=True, data=bytes.fromhex("A400F401A08C0000")),
        can.Message(arbitration_id=0x141, is_extended_id=False, is_remote_frame=True, dlc=8),
        can.Message(arbitration_id=0x141, is_extended_id=False, is_error_frame=True, data=bytes.fromhex("A400F401A08C0000")),
        can.Message(arbitration_id=0x141, is_extended_id=False, is_fd=True, data=bytes.fromhex("A400F401A08C0000") * 2),
        can.Message(arbitration_id=0x141, is_extended_id=False, data=bytes.fromhex("B300000064000000")),
        can.Message(arbitration_id=0x160, is_extended_id=False, data=bytes.fromhex("A400F401A08C0000")),
    ],
    ids=["short", "extended", "remote", "error", "fd", "not of v1", "other address"],
)  # fmt: skip
def test_what_is_no_request_is_neither_answered_nor_obeyed(desk: Make, frame: can.Message) -> None:
    d = desk()
    d.bus.send(frame)
    assert d.bus.recv(0) is None
    d.wait(0.2)
    assert d.world.states[0].angle_rad == 0.0


@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(
    st.sampled_from(["rmd-v1", "rmd-v3"]),
    st.lists(st.tuples(st.integers(0, 0x7FF) | st.integers(0x141, 0x14E), st.binary(max_size=8)), max_size=20),
)
def test_any_bytes_to_any_drive_leave_a_world_that_goes_on(
    desk: Make, protocol: str, frames: list[tuple[int, bytes]]
) -> None:
    d = desk(
        Springs(), described(protocol, max_speed_rad_s=100.0, max_acceleration_rad_s2=1e4), channel=f"any {protocol}"
    )
    for arbitration_id, data in frames:
        d.bus.send(can.Message(arbitration_id=arbitration_id, is_extended_id=False, data=data))
        d.clock.advance(0.004)
        d.bus.recv(0)
    assert np.isfinite(d.world.travel).all()
    d.bus.shutdown()


def test_two_robots_cannot_share_a_channel(desk: Make) -> None:
    desk()
    with pytest.raises(can.CanInitializationError, match="'desk' is open already, with another description"):
        desk(description=described("rmd-v3"))


def test_a_v3_watchdog_cuts_the_output_raises_the_alarm_and_then_echoes_once(desk: Make) -> None:
    d = desk(Springs(), described("rmd-v3"))
    d.ask(1, "B3 00 00 00 C8 00 00 00")
    d.go_to(1, d.angle_deg(1) - 120.0)
    while d.world.load[0] < 10.0:
        d.clock.advance(0.05)
        d.ask(1, "9C")
    d.clock.advance(0.3)
    alarm = d.bus.recv(1.5)
    assert alarm is not None
    assert (alarm.arbitration_id, alarm.data[0]) == (0x241, 0xF1)
    assert d.bus.recv(1.5) is not None, "the alarm is repeated"
    assert d.world.load[0] < 3.0
    request = bytes.fromhex("A4 00 F4 01 00 00 00 00")
    assert d.ask(1, request) == request
    assert d.ask(1, "9A")[1] == 25


def test_gains_and_planning_are_kept(desk: Make) -> None:
    d = desk(description=described("rmd-v3"))
    d.ask(2, "31 00 01 02 03 04 05 06")
    assert d.ask(2, "30") == bytes.fromhex("30 00 01 02 03 04 05 06")
    d.ask(2, "43 01 00 00 88 13 00 00")
    assert d.ask(2, "42 01") == bytes.fromhex("42 01 00 00 88 13 00 00")


def test_nodes_of_a_channel_see_each_others_frames_and_share_the_world(desk: Make) -> None:
    d = desk()
    with can.Bus(interface="cobra-sim", channel="desk", ignore_config=True) as other:
        d.bus.send(can.Message(arbitration_id=0x141, is_extended_id=False, data=bytes.fromhex("9C00000000000000")))
        request, reply = other.recv(0), other.recv(0)
        assert request is not None
        assert reply is not None
        assert request.data == bytes.fromhex("9C00000000000000")
        assert len(reply.data) == 8
        assert d.bus.recv(0) is not None, "the sender gets the reply"
        assert d.bus.recv(0) is None, "but not its own request"
        assert world_of("desk") is d.world


def test_the_world_ends_with_its_last_bus(desk: Make) -> None:
    d = desk()
    d.bus.shutdown()
    with pytest.raises(KeyError, match="no simulated channel 'desk' is open"):
        world_of("desk")
    with pytest.raises(can.CanOperationError, match="shut down"):
        d.bus.recv(0)


def test_a_second_channel_of_a_robot_is_addressed_by_its_name(desk: Make) -> None:
    description = described()
    second = msgspec.structs.replace(description.buses[0], name="base", channel="desk#base")
    drives = tuple(
        msgspec.structs.replace(drive, bus="base", address=1 if drive.moves == "twist" else 2)
        if drive.moves != "tendon"
        else drive
        for drive in description.drives
    )
    d = desk(description=msgspec.structs.replace(description, buses=(*description.buses, second), drives=drives))
    with can.Bus(interface="cobra-sim", channel="desk#base", ignore_config=True) as base:
        base.send(can.Message(arbitration_id=0x142, is_extended_id=False, data=bytes.fromhex("A200000040420F00")))
        assert base.recv(0) is not None
        assert d.bus.recv(0) is None
        d.wait(0.1)
        assert [i for i, state in enumerate(d.world.states) if state.angle_rad] == [FEED]


@pytest.mark.parametrize(
    ("channel", "options", "words"),
    [
        ("nobody", {}, "nobody: cannot be read"),
        ("cobra#left", {"twin": "none"}, "cobra has no bus 'left'"),
        ("cobra", {"twin": "perfect"}, "must be one of default, ideal, dynamics, none"),
        ("cobra", {"twin": "none", "stepping": "fast"}, "must be one of thread, inline"),
    ],
)
def test_what_cannot_be_simulated_is_said(channel: str, options: dict[str, str], words: str) -> None:
    with pytest.raises(can.CanInitializationError, match=words):
        can.Bus(interface="cobra-sim", channel=channel, ignore_config=True, **options)
    with pytest.raises(KeyError):
        world_of(channel)


def test_filters_of_python_can_work(desk: Make) -> None:
    d = desk()
    d.bus.set_filters([{"can_id": 0x142, "can_mask": 0x7FF}])
    for address in (1, 2):
        d.bus.send(
            can.Message(arbitration_id=0x140 + address, is_extended_id=False, data=bytes.fromhex("9C00000000000000"))
        )
    frame = d.bus.recv(0)
    assert frame is not None
    assert frame.arbitration_id == 0x142
    assert d.bus.recv(0) is None


class Threaded:
    """A world in its own thread on the system's clock, with a plant that can be made to wait or fail."""

    def __init__(self, plant: Any) -> None:
        self.bus = can.Bus(
            interface="cobra-sim", channel="threaded", ignore_config=True, twin=plant, description=described()
        )
        self.world = world_of("threaded")


def until(condition: Callable[[], bool], bus: can.BusABC) -> None:
    """Await a condition, 10 s at most; receiving is how a test waits without sleeping."""
    for _ in range(1000):
        if condition():
            return
        bus.recv(0.01)
    raise AssertionError("the condition did not come true within 10 s")


def test_in_a_thread_the_world_follows_the_clock_by_itself() -> None:
    springs = Springs()
    t = Threaded(springs)
    with t.bus:
        start = t.world.time_s
        until(lambda: t.world.time_s > start + 0.2, t.bus)
        assert sum(springs.calls) == pytest.approx(t.world.time_s - start - t.world.dropped_s, abs=0.02)


def test_a_busy_plant_does_not_delay_a_reply_and_lost_time_is_dropped_not_raced() -> None:
    springs = Springs()
    springs.gate = threading.Event()
    t = Threaded(springs)
    with t.bus:
        until(lambda: len(springs.calls) == 1, t.bus)
        t.bus.send(can.Message(arbitration_id=0x141, is_extended_id=False, data=bytes.fromhex("9C00000000000000")))
        assert t.bus.recv(0) is not None, "answered while the plant computes"
        start = t.world.clock.now()
        until(lambda: t.world.clock.now() > start + 3 * MAX_CATCH_UP_S, t.bus)
        springs.gate.set()
        until(lambda: t.world.dropped_s > 0, t.bus)
        assert t.world.dropped_s > MAX_CATCH_UP_S


def test_a_plant_that_fails_is_a_dead_adapter_and_not_a_silent_one(caplog: pytest.LogCaptureFixture) -> None:
    class Broken(Springs):
        def advance(self, travel: Floats, duration_s: float) -> Floats:
            raise FloatingPointError("diverged")

    t = Threaded(Broken())
    try:
        with pytest.raises(can.CanOperationError, match="the world stopped: diverged"):
            until(lambda: False, t.bus)
        with pytest.raises(can.CanOperationError, match="the world stopped: diverged"):
            t.bus.send(can.Message(arbitration_id=0x141, is_extended_id=False, data=bytes(8)))
        assert "the simulated world stopped" in caplog.text
    finally:
        t.bus.shutdown()
