"""What the bus does on the wire, seen by handmade drives."""

import errno
import math
import struct
from collections.abc import Callable

import can
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cobra.motors.bus import BusError
from tests.cobra.motors.handmade_drives import GEAR, HandmadeDrive, Rig, plain

Make = Callable[..., Rig]
PER_RAD = math.degrees(1.0) * GEAR


def test_a_setpoint_is_the_motor_shaft_angle_with_the_described_speed_limit(rig: Make) -> None:
    r = rig(2)
    assert r.bus.enable() == ()
    r.wire.sent.clear()
    r.bus.exchange(np.array([1.0, -0.5]))
    # 1 rad x 9 = 515.66 degrees = 51566 hundredths = 0x0000C96E; 8 rad/s x 9 = 4125.3 dps = 0x101D.
    assert (0x141, bytes.fromhex("A4 00 1D 10 6E C9 00 00")) in r.wire.sent
    assert (0x142, bytes.fromhex("A4 00 1D 10 49 9B FF FF")) in r.wire.sent


def test_v3_setpoints_are_output_degrees(rig: Make) -> None:
    r = rig(1, "rmd-v3")
    assert r.bus.enable() == ()
    r.bus.exchange(np.array([math.pi]))
    # 180.00 degrees = 18000 = 0x4650; 8 rad/s = 458.4 dps = 0x01CA.
    assert (0x141, bytes.fromhex("A4 00 CA 01 50 46 00 00")) in r.wire.sent


def test_all_setpoints_are_on_the_wire_before_the_first_reply_is_awaited(rig: Make) -> None:
    r = rig(14)
    r.bus.enable()
    r.wire.history.clear()
    r.bus.exchange(np.zeros(14))
    kinds = [kind for kind, _ in r.wire.history]
    sent = kinds.count("sent")
    assert sent >= 14
    assert kinds[:sent] == ["sent"] * sent


def test_feedback_is_in_units_of_the_output_shaft(rig: Make) -> None:
    def change(drives: list[HandmadeDrive]) -> None:
        drives[0].shaft_deg = 7200.0
        drives[0].speed_dps = -900
        drives[0].iq = 2048

    r = rig(1, change=change)
    feedback = r.bus.exchange(None)
    assert feedback.angle[0] == pytest.approx(math.radians(7200.0 / GEAR), abs=1e-4)
    assert feedback.velocity[0] == pytest.approx(-math.radians(100.0))
    assert feedback.current[0] == pytest.approx(33.0, rel=1e-4)
    assert (feedback.temperature[0], feedback.voltage[0]) == (30.0, 48.0)
    assert feedback.valid.all()
    assert feedback.faults == ("",)


def test_reading_commands_nothing(rig: Make) -> None:
    r = rig(3)
    for _ in range(10):
        r.bus.exchange(None)
    assert r.orders() == []


def test_setpoints_before_enabling_never_reach_a_motor(rig: Make) -> None:
    r = rig(3)
    feedback = r.bus.exchange(np.ones(3))
    assert r.orders() == []
    assert feedback.valid.all()
    assert r.bus.counts["setpoints while not enabled"] == 1


def test_a_setpoint_that_is_no_number_is_not_sent_and_the_others_are(rig: Make) -> None:
    r = rig(3)
    r.bus.enable()
    feedback = r.bus.exchange(np.array([0.1, math.nan, math.inf]))
    assert [len(drive.orders) for drive in r.drives] == [1, 0, 0]
    assert feedback.valid.all()
    assert r.bus.counts["setpoint not finite"] == 2


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(st.lists(st.floats(-40.0, 40.0), min_size=1, max_size=60), st.floats(-1e5, 1e5))
def test_v1_angles_are_followed_through_every_turn_of_the_encoder(rig: Make, steps: list[float], start: float) -> None:
    """Up to full speed, 41 degrees of the motor's shaft in a tick; the encoder wraps every 360."""

    def change(drives: list[HandmadeDrive]) -> None:
        drives[0].shaft_deg = start

    r = rig(1, change=change)
    for step in steps:
        r.clock.advance(0.01)
        r.drives[0].shaft_deg += step
        r.drives[0].speed_dps = round(step * 100)
        angle = r.bus.exchange(None).angle[0]
        assert angle * PER_RAD == pytest.approx(r.drives[0].shaft_deg, abs=360 / 16384 + 0.02)
    assert r.bus.counts == {}


def test_turns_passed_unseen_are_found_again_as_soon_as_replies_come_back(rig: Make) -> None:
    r = rig(1)
    drive = r.drives[0]
    r.bus.exchange(None)
    drive.silent = True
    for _ in range(7):
        r.clock.advance(0.01)
        drive.shaft_deg += 153.0
        r.bus.exchange(None)
    drive.silent = False
    r.clock.advance(0.01)
    r.bus.exchange(None)
    r.clock.advance(0.01)
    feedback = r.bus.exchange(None)
    assert feedback.angle[0] * PER_RAD == pytest.approx(drive.shaft_deg, abs=0.05)
    assert feedback.faults == ("",)


@pytest.mark.parametrize("protocol", ["rmd-v1", "rmd-v3"])
def test_a_drive_that_lost_its_turn_count_is_a_fault_until_enabled_again(rig: Make, protocol: str) -> None:
    r = rig(2, protocol)
    r.bus.enable()
    r.drives[1].shaft_deg += 3 * 360.0
    for _ in range(4):
        r.clock.advance(0.01)
        feedback = r.bus.exchange(None)
    assert feedback.faults[0] == ""
    degrees = 120.0 if protocol == "rmd-v1" else 1080.0
    assert f"angle jumped by {degrees:+.1f} degrees" in feedback.faults[1]
    assert r.bus.enable() == ()
    assert r.bus.exchange(None).faults == ("", "")


@pytest.mark.parametrize("protocol", ["rmd-v1", "rmd-v3"])
@pytest.mark.parametrize("restarted", [True, False])
def test_a_drive_that_was_silent_is_trusted_only_if_it_is_where_it_was(
    rig: Make, protocol: str, restarted: bool
) -> None:
    """A second without replies: its power was off and it counts turns from anew, or only the cable was out."""
    r = rig(2, protocol)
    r.bus.enable()
    r.bus.exchange(np.zeros(2))
    drive = r.drives[1]
    drive.silent = True
    for _ in range(100):
        r.clock.advance(0.01)
        r.bus.exchange(None)
    drive.silent = False
    drive.shaft_deg += -720.0 if restarted else 15.0
    for _ in range(4):
        r.clock.advance(0.01)
        feedback = r.bus.exchange(None)
    assert ("home again" in feedback.faults[1]) == restarted
    per_rad = PER_RAD if protocol == "rmd-v1" else math.degrees(1.0)
    assert feedback.angle[1] * per_rad == pytest.approx(drive.shaft_deg, abs=0.05)


def test_a_motor_that_does_not_answer_keeps_its_last_values_and_ages(rig: Make) -> None:
    r = rig(3)
    before = r.bus.exchange(None)
    r.drives[1].silent = True
    for k in range(1, 6):
        start = r.clock.now()
        feedback = r.bus.exchange(None)
        assert r.clock.now() - start <= r.bus.reply_timeout_s + 1e-9
        assert feedback.valid.tolist() == [True, False, True]
        assert feedback.missed.tolist() == [0, k, 0]
        assert feedback.age[1] >= k * r.bus.reply_timeout_s - 1e-9
        assert feedback.angle == pytest.approx(before.angle)
    r.drives[1].silent = False
    assert r.bus.exchange(None).missed.tolist() == [0, 0, 0]


def test_a_motor_never_heard_has_no_angle_and_no_age(rig: Make) -> None:
    def change(drives: list[HandmadeDrive]) -> None:
        drives[0].silent = True

    r = rig(2, change=change)
    feedback = r.bus.exchange(None)
    assert math.isnan(feedback.angle[0])
    assert math.isinf(feedback.age[0])
    r.drives[0].silent = False
    for _ in range(3):
        r.clock.advance(0.01)
        feedback = r.bus.exchange(None)
    assert feedback.angle[0] == pytest.approx(0.0, abs=1e-3)
    assert feedback.age[0] < 0.01


def test_a_late_reply_is_discarded_and_counted_and_not_taken_for_the_next(rig: Make) -> None:
    r = rig(2)
    r.wire.latency[2] = r.bus.reply_timeout_s + 0.001
    r.bus.exchange(None)
    r.wire.latency.clear()
    r.clock.advance(0.01)
    r.drives[1].celsius = 55
    feedback = r.bus.exchange(None)
    assert r.bus.counts["late reply"] >= 1
    assert feedback.temperature[1] == 55
    assert feedback.valid.all()


NOISE = {
    "unknown id": plain(0x7FF, "A4 00 00 00 00 00 00 00"),
    "reply from a motor never asked": plain(0x151, "9C 1E 00 00 00 00 00 00"),
    "wrong command": plain(0x141, "A1 1E 00 00 00 00 00 00"),
    "late reply": plain(0x141, "9A 1E 00 E0 01 00 00 00"),
    "short frame": plain(0x141, "9C 1E 00"),
    "remote frame": can.Message(arbitration_id=0x141, is_extended_id=False, is_remote_frame=True, dlc=8),
    "extended frame": can.Message(arbitration_id=0x141, is_extended_id=True, data=bytes(8)),
    "error frame": can.Message(arbitration_id=0x040, is_extended_id=False, is_error_frame=True, data=bytes(8)),
    "FD frame": can.Message(arbitration_id=0x141, is_extended_id=False, is_fd=True, data=bytes(12)),
    "own frame": can.Message(
        arbitration_id=0x141, is_extended_id=False, is_rx=False, data=bytes.fromhex("9C" + "00" * 7)
    ),
}


@pytest.mark.parametrize("protocol", ["rmd-v1", "rmd-v3"])
@pytest.mark.parametrize("late_s", [0.012, 0.023, 0.041])
def test_replies_that_are_ticks_late_are_never_taken_for_the_newest(rig: Make, protocol: str, late_s: float) -> None:
    """RMD has no sequence numbers: matched by id and command alone, a reply from three ticks ago would look fresh."""
    r = rig(2, protocol)
    r.bus.enable()
    r.wire.latency[2] = late_s
    for k in range(40):
        r.drives[1].celsius = k
        start = r.clock.now()
        feedback = r.bus.exchange(np.zeros(2))
        assert not feedback.valid[1]
        assert feedback.valid[0]
        r.clock.advance(max(0.0, start + 0.01 - r.clock.now()))
    assert feedback.missed[1] == 40
    assert r.bus.counts["late reply"] > 20


def test_a_lost_reply_costs_one_setpoint_and_no_more(rig: Make) -> None:
    r = rig(2)
    r.bus.enable()
    r.bus.exchange(np.zeros(2))
    r.drives[1].silent = True
    r.bus.exchange(np.zeros(2))
    r.drives[1].silent = False
    r.wire.sent.clear()
    assert r.bus.exchange(np.zeros(2)).valid.all()
    assert [data[0] for i, data in r.wire.sent if i == 0x142 and data[0] in (0xA4, 0x9C)] == [0x9C], "a read instead"
    r.wire.sent.clear()
    assert r.bus.exchange(np.zeros(2)).valid.all()
    assert [data[0] for i, data in r.wire.sent if i == 0x142 and data[0] in (0xA4, 0x9C)] == [0xA4]


@pytest.mark.parametrize("reason", NOISE)
def test_every_frame_that_is_no_reply_is_counted_by_its_reason(rig: Make, reason: str) -> None:
    r = rig(3)
    before = r.bus.exchange(None)
    r.bus.burst(None)
    r.wire.inbox.appendleft(NOISE[reason])
    feedback = r.bus.collect()
    assert r.bus.counts == {reason: 1}
    assert feedback.valid.all()
    assert feedback.angle == pytest.approx(before.angle)


frames = st.builds(
    lambda i, data, **kind: can.Message(arbitration_id=i, data=data, **kind),
    st.one_of(st.integers(0x140, 0x144), st.integers(0x240, 0x244), st.integers(0, 0x1FFFFFFF)),
    st.one_of(
        st.binary(max_size=64),
        st.builds(lambda c, rest: bytes([c]) + rest, st.sampled_from([0x92, 0x9A, 0x9C, 0xA4, 0xF1, 0xB3]), st.binary(min_size=7, max_size=7)),
    ),
    is_extended_id=st.booleans(),
    is_remote_frame=st.booleans(),
    is_error_frame=st.booleans(),
    is_fd=st.booleans(),
    is_rx=st.booleans(),
)  # fmt: skip


@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(st.sampled_from(["rmd-v1", "rmd-v3"]), st.lists(st.lists(frames, max_size=12), min_size=1, max_size=4))
def test_nothing_on_the_wire_raises_or_moves_a_motor(rig: Make, protocol: str, bursts: list[list[can.Message]]) -> None:
    """Any frames, before and between the replies: only the caller's own setpoints are ever commanded."""
    r = rig(3, protocol)
    r.bus.enable()
    for drive in r.drives:
        drive.orders.clear()
    wanted = np.array([0.1, 0.2, 0.3])
    for noise in bursts:
        r.wire.inbox.extend(noise)
        r.bus.burst(wanted)
        r.wire.inbox.extend(noise)
        feedback = r.bus.collect()
        assert feedback.valid.shape == (3,)
    scale = GEAR if protocol == "rmd-v1" else 1.0
    for drive, angle in zip(r.drives, wanted, strict=True):
        for order in drive.orders:
            assert order[0] == 0xA4
            assert struct.unpack_from("<i", order, 4)[0] == round(math.degrees(angle) * scale * 100)


def test_a_flood_cannot_keep_the_exchange_from_ending(rig: Make) -> None:
    r = rig(2)
    junk = plain(0x123, bytes(8))
    for drive in r.drives:
        drive.silent = True
    r.wire.inbox.extend([junk] * 20_000)
    feedback = r.bus.exchange(None)
    assert not feedback.valid.any()
    assert r.bus.counts["unknown id"] > 1000


def test_arming_says_which_drive_is_missing_and_what_to_check(rig: Make) -> None:
    def change(drives: list[HandmadeDrive]) -> None:
        drives[2].silent = True

    r = rig(3, change=change)
    (reason,) = r.bus.enable()
    assert "drive 'N1' (address 3 on bus 'main'" in reason
    assert "does not answer" in reason
    r.bus.exchange(np.ones(3))
    assert r.orders() == []


@pytest.mark.parametrize(("described", "spoken"), [("rmd-v1", "rmd-v3"), ("rmd-v3", "rmd-v1")])
def test_the_dialect_is_probed_by_the_id_of_the_reply(rig: Make, described: str, spoken: str) -> None:
    def change(drives: list[HandmadeDrive]) -> None:
        drives[0].v3 = spoken == "rmd-v3"

    r = rig(2, described, change=change)
    (reason,) = r.bus.enable()
    assert f"drive 'S1' (address 1 on bus 'main' (cobra-sim cobra)) speaks {spoken}, described is {described}" in reason
    assert "correct motors.protocol of 'small'" in reason


@pytest.mark.parametrize(
    ("protocol", "state", "words"),
    [
        ("rmd-v1", {"flags": 0x01, "decivolts": 190}, "undervoltage; 19 V, must be 20 to 52"),
        ("rmd-v1", {"flags": 0x08, "celsius": 85}, "over-temperature; 85 °C, at most 80"),
        ("rmd-v3", {"flags": 0x0002}, "motor stalled"),
    ],
)
def test_arming_tells_errors_in_words(rig: Make, protocol: str, state: dict[str, int], words: str) -> None:
    def change(drives: list[HandmadeDrive]) -> None:
        drives[0].__dict__.update(state)

    r = rig(2, protocol, change=change)
    (reason,) = r.bus.enable()
    assert reason.endswith(": " + words)
    assert r.bus.exchange(None).faults[0] == words


def test_errors_that_come_later_are_seen_within_a_round(rig: Make) -> None:
    r = rig(4)
    r.bus.enable()
    r.drives[2].flags = 0x08
    for _ in range(8):
        feedback = r.bus.exchange(None)
    assert feedback.faults == ("", "", "over-temperature", "")


def test_enabling_clears_old_errors_and_never_resumes_an_old_motion(rig: Make) -> None:
    r = rig(1)
    r.drives[0].flags = 0x01
    r.bus.enable()
    assert [order[0] for order in r.orders()] == [0x9B]


def test_v3_watchdog_is_set_and_read_back_and_taken_off_at_the_end(rig: Make) -> None:
    r = rig(2, "rmd-v3")
    assert r.bus.enable() == ()
    assert [order for order in r.drives[0].orders if order[0] == 0xB3] == [bytes.fromhex("B3 00 00 00 F4 01 00 00")]
    r.bus.close()
    assert r.drives[0].orders[-1] == bytes.fromhex("B3 00 00 00 00 00 00 00")


def test_v3_without_a_watchdog_is_not_armed(rig: Make) -> None:
    def change(drives: list[HandmadeDrive]) -> None:
        drives[1].watchdog_taken = False

    (reason,) = rig(2, "rmd-v3", change=change).bus.enable()
    assert reason == "drive 'E1' did not take its watchdog of 500 ms: its firmware may lack 0xB3"


def test_v1_says_that_it_has_no_watchdog(rig: Make) -> None:
    (note,) = rig(2).bus.notes
    assert "no watchdog (S1, E1)" in note
    assert rig(2, "rmd-v3").bus.notes == ()


def test_v3_planning_is_set_to_direct_tracking_only_where_it_is_not(rig: Make) -> None:
    def change(drives: list[HandmadeDrive]) -> None:
        drives[1].acceleration = 10_000

    r = rig(2, "rmd-v3", change=change)
    r.bus.enable()
    written = [[order for order in drive.orders if order[0] == 0x43] for drive in r.drives]
    assert written == [[], [bytes.fromhex("43 00 00 00 00 00 00 00"), bytes.fromhex("43 01 00 00 00 00 00 00")]]


def test_a_tripped_watchdog_is_a_fault_and_no_setpoint_follows(rig: Make) -> None:
    r = rig(2, "rmd-v3")
    r.bus.enable()
    r.bus.exchange(np.zeros(2))
    r.wire.inbox.append(plain(0x242, "F1 00 00 00 00 00 00 00"))
    feedback = r.bus.exchange(np.zeros(2))
    assert feedback.faults == ("", "its watchdog has cut the output: enable again")
    assert feedback.valid.tolist() == [True, False]
    before = len(r.orders())
    r.bus.exchange(np.ones(2))
    assert len(r.orders()) == before
    assert r.bus.enable() == ()
    assert r.bus.exchange(np.zeros(2)).faults == ("", "")


def test_fourteen_v3_drives_all_tell_a_fresh_angle_within_two_ticks(rig: Make) -> None:
    r = rig(14, "rmd-v3")
    for k in range(6):
        r.clock.advance(0.01)
        for drive in r.drives:
            drive.shaft_deg += 1.0
        feedback = r.bus.exchange(None)
        if k >= 2:
            truth = np.radians([drive.shaft_deg for drive in r.drives])
            assert np.abs(feedback.angle - truth).max() <= math.radians(1.0) + 1e-6
    assert feedback.age.max() <= 0.021


@pytest.mark.parametrize(("act", "command"), [("hold", 0x81), ("disable", 0x80)])
def test_stopping_is_repeated_for_a_drive_that_does_not_answer(rig: Make, act: str, command: int) -> None:
    r = rig(2)
    r.drives[1].silent = True
    getattr(r.bus, act)()
    assert [[order[0] for order in drive.orders] for drive in r.drives] == [[command], [command] * 3]
    assert r.bus.counts[f"no answer to {'stop' if act == 'hold' else 'off'}"] == 1


def test_no_setpoint_follows_disabling(rig: Make) -> None:
    r = rig(1)
    r.bus.enable()
    r.bus.disable()
    r.bus.exchange(np.ones(1))
    assert [order[0] for order in r.orders()] == [0x80]


@pytest.mark.parametrize(
    "error", [can.CanOperationError("network is down", errno.ENETDOWN), OSError(errno.EIO, "input/output error")]
)
def test_a_channel_that_is_gone_is_one_clear_line(rig: Make, error: Exception) -> None:
    r = rig(2)
    r.wire.broken = error
    for act in (lambda: r.bus.exchange(None), r.bus.hold, r.bus.disable, r.bus.enable):
        with pytest.raises(
            BusError, match=r"^bus 'main' \(cobra-sim cobra\): \w+ failed: .*check the adapter"
        ) as caught:
            act()
        assert "\n" not in str(caught.value)
    r.bus.close()


def test_a_full_kernel_queue_is_waited_for(rig: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    r = rig(3)
    refusals = iter([True, True, False] * 100)
    send = r.wire.send

    def sometimes(message: can.Message, timeout: float | None = None) -> None:
        if next(refusals):
            raise can.CanOperationError("no buffer space", errno.ENOBUFS)
        send(message, timeout)

    monkeypatch.setattr(r.wire, "send", sometimes)
    assert r.bus.exchange(None).valid.all()
    assert r.bus.counts["transmit queue full"] > 0


def test_a_serial_line_that_is_no_frame_is_counted(rig: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    r = rig(2)
    receive, garbage = r.wire.recv, iter([ValueError("invalid literal"), IndexError("string index")])

    def garbled(timeout: float | None = None) -> can.Message | None:
        if (error := next(garbage, None)) is not None:
            raise error
        return receive(timeout)

    monkeypatch.setattr(r.wire, "recv", garbled)
    assert r.bus.exchange(None).valid.all()
    assert r.bus.counts == {"garbled frame": 2}
