"""CiA 402 drives end to end: simulated drives that serve their object dictionary, driven over python-can and `canopen`."""

import struct
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
from cobra.loading import DescriptionError, contradictions
from cobra.motors.bus import BusError
from cobra.motors.joined_bus import JoinedBus
from cobra.motors.open_bus import open_bus
from cobra.simulation.drives import wire_of, world_of
from tests.cobra.motors.handmade_drives import robot

CHANNEL = "canopen-robot"
INCREMENT = 2 * np.pi / (4096 * 9)


def described(n: int = 3, rate_Hz: float = 100.0, **options: Any) -> RobotDescription:
    d = robot(n, "cia402", loop_rate_Hz=rate_Hz)
    motor = msgspec.structs.replace(d.motors[0], encoder_bits=12, current_per_count_A=0.004)
    given = {"twin": "none", "stepping": "inline", **options}
    bus = msgspec.structs.replace(d.buses[0], channel=CHANNEL, options=given)
    return msgspec.structs.replace(d, motors=(motor,), buses=(bus,))


class Rig:
    """An open bus, its world, and another program's ear on the wire."""

    def __init__(self, description: RobotDescription) -> None:
        self.clock = ManualClock()
        self.description = description
        self.bus: JoinedBus = open_bus(description, self.clock)  # type: ignore[assignment]
        # The ear is there first, so that it hears the set-up.
        self.ear = can.Bus(
            interface="cobra-sim", channel=CHANNEL, ignore_config=True, clock=self.clock, description=description,
            **description.buses[0].options,
        )  # fmt: skip
        self.world = world_of(CHANNEL)
        self.wire = wire_of(CHANNEL, "main")
        self.bus.open()

    def heard(self) -> list[tuple[int, bytes]]:
        frames = []
        while (frame := self.ear.recv(0)) is not None:
            frames.append((frame.arbitration_id, bytes(frame.data)))
        return frames

    def run(self, seconds: float, angles: np.ndarray | None = None) -> Any:
        for _ in range(round(seconds / 0.01)):
            self.clock.advance(0.01)
            feedback = self.bus.exchange(angles)
        return feedback

    def ramp(self, seconds: float, start: np.ndarray, radians: float) -> Any:
        """As a controller does it: a drive that is told to jump reports a following error."""
        for k in range(1, round(seconds / 0.01) + 1):
            feedback = self.run(0.01, start + radians * 0.01 * k / seconds)
        return feedback

    def close(self) -> None:
        self.bus.close()
        self.ear.shutdown()


@pytest.fixture
def rig() -> Iterator[Callable[..., Rig]]:
    made: list[Rig] = []

    def make(description: RobotDescription | None = None) -> Rig:
        made.append(Rig(description or described()))
        return made[-1]

    yield make
    for each in made:
        each.close()


Make = Callable[..., Rig]


def test_the_set_up_is_written_byte_for_byte(rig: Make) -> None:
    r = rig(described(1))
    written = [data.hex(" ") for arbitration_id, data in r.heard() if arbitration_id == 0x601]
    for frame in (
        "2f 60 60 00 08 00 00 00",  # cyclic synchronous position
        "2f c2 60 01 0a 00 00 00",  # 10 ms
        "2b 17 10 00 64 00 00 00",  # heartbeat every 100 ms
        "23 16 10 01 c8 00 7f 00",  # watches node 127 with 200 ms
        "2b 5a 60 00 06 00 00 00",  # quick stop: slow down and stay
        "23 00 16 01 10 00 40 60",  # RPDO 1: controlword, 16 bits
        "23 00 16 02 20 00 7a 60",  # target position, 32 bits
        "23 00 1a 01 10 00 41 60",  # TPDO 1: statusword
        "23 00 1a 02 20 00 64 60",  # position
        "23 00 1a 03 10 00 77 60",  # torque
        "2f 00 18 02 01 00 00 00",  # with every SYNC
    ):
        assert frame in written
    assert written.index("23 00 14 01 01 02 00 80") < written.index("2f 00 16 00 00 00 00 00"), "invalid before mapped"


def test_drives_are_led_to_operation_and_follow_all_at_one_sync(rig: Make) -> None:
    r = rig()
    r.heard()
    assert r.bus.enable() == ()
    words = [struct.unpack("<H", data[:2])[0] for i, data in r.heard() if i == 0x201]
    assert words == [0x06, 0x07, 0x0F]
    start = r.bus.exchange(None).angle
    r.heard()
    r.clock.advance(0.01)
    r.bus.exchange(start + np.array([0.1, -0.2, 0.0]))
    ids = [i for i, _ in r.heard()]
    assert ids[:3] == [0x201, 0x202, 0x203]
    assert ids[3] == 0x080, "targets first, then SYNC"
    assert {0x181, 0x182, 0x183} <= set(ids[4:])
    feedback = r.run(0.5, start + np.array([0.1, -0.2, 0.0]))
    assert feedback.valid.all()
    assert feedback.angle - start == pytest.approx([0.1, -0.2, 0.0], abs=3e-4)
    assert [state.angle_rad for state in r.world.states] == pytest.approx([0.1, -0.2, 0.0], abs=3e-4)
    assert feedback.faults == ("", "", "")
    assert r.bus.counts == {}


def test_enabling_moves_nothing(rig: Make) -> None:
    r = rig()
    r.bus.enable()
    r.run(0.2)
    assert [state.angle_rad for state in r.world.states] == pytest.approx([0.0] * 3, abs=INCREMENT)


def test_voltage_and_temperature_are_read_now_and_then(rig: Make) -> None:
    r = rig()
    feedback = r.run(0.3)
    assert feedback.voltage == pytest.approx([36.0] * 3, abs=0.1)
    assert feedback.temperature == pytest.approx([25.0] * 3, abs=0.1)


def test_hold_keeps_the_torque_and_setpoints_do_not_lead_back(rig: Make) -> None:
    r = rig()
    r.bus.enable()
    start = r.bus.exchange(None).angle
    r.ramp(0.2, start, 0.5)
    r.bus.hold()
    r.run(0.3)
    held = [state.angle_rad for state in r.world.states]
    assert all(command.mode == "position" for command in r.world.servos.commands)
    r.run(0.3, start + 2.0)
    assert [state.angle_rad for state in r.world.states] == pytest.approx(held, abs=1e-3)
    assert r.bus.counts["setpoints while not enabled"] == 30
    assert r.bus.enable() == ()
    here = r.bus.exchange(None).angle
    assert r.ramp(0.3, here, 0.5).angle == pytest.approx(here + 0.5, abs=0.05)


def test_disable_takes_the_torque(rig: Make) -> None:
    r = rig()
    r.bus.enable()
    r.bus.disable()
    assert [command.mode for command in r.world.servos.commands] == ["off"] * 3


def test_without_the_controllers_heartbeat_drives_stop_and_hold_and_are_not_led_back(rig: Make) -> None:
    r = rig()
    r.bus.enable()
    start = r.bus.exchange(None).angle
    r.ramp(0.3, start, 0.9)
    r.clock.advance(0.3)
    r.world.advance_to(r.clock.now())
    assert [drive.state for drive in r.world.drives] == ["quick stop active"] * 3  # type: ignore[attr-defined]
    stood = [state.angle_rad for state in r.world.states]
    feedback = r.run(0.3, start + 3.0)
    assert [state.angle_rad for state in r.world.states] == pytest.approx(stood, abs=0.05)
    assert all("the controller's heartbeat was lost (0x8130)" in fault for fault in feedback.faults)
    assert r.bus.enable() == ()
    assert r.run(0.1).faults == ("", "", "")


def test_a_drives_fault_is_told_in_words_and_cleared_by_enabling_when_its_cause_is_gone(rig: Make) -> None:
    r = rig()
    r.bus.enable()
    r.world.servos.supply_V = 10.0
    feedback = r.run(0.2, r.bus.exchange(None).angle)
    assert "undervoltage (0x3220)" in feedback.faults[0]
    assert "state 'fault'" in feedback.faults[0]
    reasons = r.bus.enable()
    assert len(reasons) == 3
    assert "undervoltage" in reasons[0]
    r.world.servos.supply_V = 36.0
    r.clock.advance(0.1)
    r.run(0.3)
    assert r.bus.enable() == ()


def test_a_drive_that_was_restarted_is_set_up_and_homed_again(rig: Make) -> None:
    r = rig()
    r.bus.enable()
    start = r.bus.exchange(None).angle
    r.ear.send(can.Message(arbitration_id=0, data=[0x81, 2], is_extended_id=False))
    feedback = r.run(0.2, start)
    assert "restarted: home again" in feedback.faults[1]
    assert feedback.missed[1] > 5
    assert feedback.faults[0] == ""
    assert r.bus.enable() == ()
    assert r.run(0.1, r.bus.exchange(None).angle).valid.all()


def test_a_jump_of_the_setpoint_is_a_following_error(rig: Make) -> None:
    r = rig()
    r.bus.enable()
    fault = r.run(0.1, r.bus.exchange(None).angle + 2.0).faults[0]
    assert "following error: it could not keep up with its setpoint (0x8611)" in fault
    assert [command.mode for command in r.world.servos.commands] == ["off"] * 3


def test_a_slipped_encoder_is_a_fault(rig: Make) -> None:
    r = rig()
    r.bus.enable()
    start = r.bus.exchange(None).angle
    r.world.drives[1].slip(90.0)  # type: ignore[attr-defined]
    faults = r.run(0.02, start).faults
    assert "angle jumped by +90.0 degrees" in faults[1]
    assert "home again" in faults[1]
    assert faults[0] == ""


def test_one_lost_answer_is_no_exception_and_a_silent_bus_needs_arming_again(rig: Make) -> None:
    r = rig()
    r.bus.enable()
    start = r.bus.exchange(None).angle
    r.wire.faults.drop["E1"] = 1.0
    r.clock.advance(0.01)
    feedback = r.run(0.03, start)
    assert feedback.valid.tolist() == [True, False, True]
    assert feedback.missed.tolist() == [0, 3, 0]
    r.wire.faults.drop.update({"S1": 1.0, "N1": 1.0})
    assert "nobody answers on bus 'main'" in r.run(0.1, start).faults[0]
    r.wire.faults.drop.clear()
    r.run(0.1, start + 1.0)
    assert [state.angle_rad for state in r.world.states] == pytest.approx([0.0] * 3, abs=1e-3)
    assert r.bus.enable() == ()


def test_drives_that_are_not_there_are_named(rig: Make) -> None:
    real = described(2)
    stranger = msgspec.structs.replace(real.drives[1], address=77)
    options = {**real.buses[0].options, "description": real}
    d = msgspec.structs.replace(
        real, drives=(real.drives[0], stranger), buses=(msgspec.structs.replace(real.buses[0], options=options),)
    )
    clock = ManualClock()
    with open_bus(d, clock) as bus:
        (reason,) = bus.enable()
        assert "drive 'E1' (node 77 on bus 'main'" in reason
        assert "does not answer: check its power, node id" in reason


@pytest.mark.parametrize("rate_Hz", [275.0, 300.0, 60.0])
def test_a_period_that_is_not_whole_milliseconds_is_refused(rate_Hz: float) -> None:
    with pytest.raises(BusError, match="whole milliseconds"):
        open_bus(described(2, rate_Hz), ManualClock())


def test_too_many_drives_at_too_high_a_rate_are_refused_with_the_sum() -> None:
    with pytest.raises(BusError, match=r"bus 'main': 1\d\d% of 1000 kbit/s at 500 Hz .* bits x 500 Hz"):
        open_bus(described(14, 500.0), ManualClock())


def test_one_bus_has_one_kind_of_protocol() -> None:
    d = described(3)
    other = msgspec.structs.replace(d.motors[0], name="other", protocol="rmd-v3")
    mixed = msgspec.structs.replace(
        d, motors=(*d.motors, other), drives=(d.drives[0], msgspec.structs.replace(d.drives[1], motor="other"))
    )
    assert (
        "buses: bus 'main' has drives of cia402 and rmd-v3; give CiA 402 drives a bus of their own"
        in contradictions(mixed)
    )
    assert issubclass(DescriptionError, Exception)


frames = st.builds(
    lambda i, data, **kind: can.Message(arbitration_id=i, data=data, **kind),
    st.integers(0, 0x7FF) | st.sampled_from([0x081, 0x181, 0x182, 0x581, 0x582, 0x701, 0x702, 0x000, 0x7E4]),
    st.binary(max_size=8),
    is_extended_id=st.just(False),
    is_remote_frame=st.booleans(),
    is_error_frame=st.booleans(),
)


@given(bursts=st.lists(st.lists(frames, max_size=8), min_size=1, max_size=4))
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_nothing_on_the_wire_raises_or_moves_a_motor(rig: Make, bursts: list[list[can.Message]]) -> None:
    r = rig(described(2))
    try:
        r.bus.enable()
        target = r.bus.exchange(None).angle
        before = [state.angle_rad for state in r.world.states]
        (adapter,) = (a for a in r.wire.adapters if a is not r.ear)
        for burst in bursts:
            for frame in burst:
                adapter.receive(frame)
            r.clock.advance(0.01)
            r.bus.exchange(target)
        assert [state.angle_rad for state in r.world.states] == pytest.approx(before, abs=1e-3)
    finally:
        r.close()


def test_what_is_no_answer_is_counted(rig: Make) -> None:
    r = rig(described(2))
    (adapter,) = (a for a in r.wire.adapters if a is not r.ear)
    for arbitration_id, data in ((0x181, b"\1\2"), (0x081, b"\1"), (0x701, b""), (0x123, b"x"), (0x599, bytes(8))):
        adapter.receive(can.Message(arbitration_id=arbitration_id, data=data, is_extended_id=False))
    r.run(0.01)
    assert r.bus.counts == {
        "PDO of another length": 1, "short frame": 2, "unknown id": 1, "node never asked": 1,
    }  # fmt: skip


def test_drives_may_take_most_of_a_tick_to_answer(rig: Make) -> None:
    """A serial adapter or a busy machine needs it, and it costs only when an answer is missing."""
    r = rig(described(latency_ms=6.0))
    assert r.bus.enable() == ()
    feedback = r.run(0.5, np.zeros(3))
    assert feedback.valid.all()
    assert not feedback.missed.any()
    before = r.clock.now()
    r.bus.exchange(np.zeros(3))
    assert r.clock.now() - before < 0.01
