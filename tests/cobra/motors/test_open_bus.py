"""The whole bus of a described robot, over python-can, to simulated drives; their world tells where they really are."""

import os
from collections import Counter
from pathlib import Path
from typing import Any

import can
import msgspec
import numpy as np
import pytest

from cobra.clock import ManualClock, SystemClock
from cobra.description import RobotDescription
from cobra.motors.bus import BusError
from cobra.motors.channel import Channel
from cobra.motors.open_bus import open_bus
from cobra.simulation.drives import wire_of, world_of
from tests.cobra.motors.handmade_drives import robot


def simulated(description: RobotDescription, **options: Any) -> RobotDescription:
    given = {"twin": "none", "stepping": "inline", **options}
    buses = tuple(msgspec.structs.replace(bus, options=given) for bus in description.buses)
    return msgspec.structs.replace(description, buses=buses)


def on_interface(interface: str, channel: str) -> RobotDescription:
    d = robot(14)
    return msgspec.structs.replace(
        d, buses=(msgspec.structs.replace(d.buses[0], interface=interface, channel=channel, options={}),)
    )


def on_two_channels() -> RobotDescription:
    """Every second drive on a bus of its own, so that the order of the description is not that of the channels."""
    d = robot(14)
    second = msgspec.structs.replace(d.buses[0], name="second", channel="cobra#second")
    drives = tuple(msgspec.structs.replace(drive, bus="second") if i % 2 else drive for i, drive in enumerate(d.drives))
    return msgspec.structs.replace(d, buses=(*d.buses, second), drives=drives)


@pytest.mark.parametrize("protocol", ["rmd-v1", "rmd-v3"])
def test_fourteen_drives_follow_and_the_feedback_is_where_they_are(protocol: str) -> None:
    clock = ManualClock()
    with open_bus(simulated(robot(14, protocol)), clock) as bus:
        assert bus.enable() == ()
        world = world_of("cobra")
        start = bus.exchange(None).angle
        direction = np.where(np.arange(14) % 2, -1.0, 1.0)
        for k in range(1, 301):
            clock.advance(0.01)
            # Up to 5 rad/s: 26 degrees of the motor's shaft in a tick, 20 turns in all.
            feedback = bus.exchange(start + direction * 0.05 * k)
            assert feedback.valid.all()
        for _ in range(20):
            clock.advance(0.01)
            feedback = bus.exchange(start + direction * 15.0)
        truth = np.array([state.angle_rad for state in world.states])
        assert truth == pytest.approx(direction * 15.0, abs=2e-4)
        assert feedback.angle - start == pytest.approx(truth, abs=2e-4)
        assert bus.counts == {}
        assert feedback.faults == ("",) * 14


def test_two_channels_are_one_bus_in_the_order_of_the_description() -> None:
    clock = ManualClock()
    with open_bus(simulated(on_two_channels()), clock) as bus:
        assert bus.enable() == ()
        start = bus.exchange(None).angle
        wanted = start + 0.01 * np.arange(14)
        for _ in range(30):
            clock.advance(0.01)
            feedback = bus.exchange(wanted)
        assert feedback.angle == pytest.approx(wanted, abs=2e-4)
        assert [state.angle_rad for state in world_of("cobra").states] == pytest.approx(0.01 * np.arange(14), abs=2e-4)
        assert all(field.shape == (14,) for field in (feedback.valid, feedback.age, feedback.missed, feedback.voltage))


def test_one_channel_that_cannot_be_enabled_keeps_all_from_taking_setpoints() -> None:
    real = on_two_channels()
    stranger = msgspec.structs.replace(real.drives[0], address=30)
    buses = simulated(real).buses
    d = msgspec.structs.replace(
        real, buses=tuple(msgspec.structs.replace(bus, options={**bus.options, "description": real}) for bus in buses)
    )
    with open_bus(msgspec.structs.replace(d, drives=(stranger, *d.drives[1:])), ManualClock()) as bus:
        (reason,) = bus.enable()
        assert "drive 'S1' (address 30" in reason
        bus.exchange(np.ones(14))
        assert world_of("cobra").servos.commands[1].mode == "off"


def test_a_dead_channel_does_not_keep_the_other_from_holding(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = ManualClock()
    with open_bus(simulated(on_two_channels()), clock) as bus:
        bus.enable()
        bus.exchange(bus.exchange(None).angle + 1.0)
        clock.advance(0.05)
        world = world_of("cobra")

        def cut(*_: object) -> None:
            raise can.CanOperationError("unplugged")

        monkeypatch.setattr(wire_of("cobra", "main"), "send", cut)
        for act in (bus.hold, lambda: bus.exchange(None)):
            with pytest.raises(BusError, match=r"bus 'main' \(cobra-sim cobra\): sending failed: unplugged"):
                act()
        world.advance_to(clock.now() + 1.0)
        angles = [state.angle_rad for state in world.states]
        assert max(angles[1::2]) < 0.5
        assert min(angles[0::2]) == pytest.approx(1.0, abs=1e-3)


def test_when_a_channel_cannot_be_opened_those_before_it_are_closed_again() -> None:
    d = on_two_channels()
    broken = msgspec.structs.replace(d.buses[1], interface="slcan", channel="/dev/nowhere")
    d = simulated(d)
    with pytest.raises(BusError, match="bus 'second'"):
        open_bus(
            msgspec.structs.replace(d, buses=(d.buses[0], msgspec.structs.replace(broken, options={}))), ManualClock()
        ).open()
    with pytest.raises(KeyError):
        world_of("cobra")


@pytest.mark.parametrize(
    ("interface", "channel", "advice"),
    [
        ("socketcan", "nocan7", "ip link set nocan7 up type can bitrate 1000000"),
        ("slcan", "/dev/nowhere", "check that the adapter is plugged in, its device path"),
        ("pcan", "PCAN_USBBUS1", "PCAN-Basic"),
        ("gs_usb", "0", "python-can[gs-usb]"),
        ("telepathy", "0", "check buses.interface"),
    ],
)
def test_an_adapter_that_is_not_there_is_one_line_with_what_to_do(interface: str, channel: str, advice: str) -> None:
    with pytest.raises(BusError) as caught:
        open_bus(on_interface(interface, channel), ManualClock()).open()
    line = str(caught.value)
    assert line.startswith(f"bus 'main' ({interface} {channel}) cannot be opened: ")
    assert advice in line
    assert "\n" not in line


@pytest.mark.skipif(not hasattr(os, "openpty"), reason="no pseudo-terminals here")
def test_an_adapter_that_reads_late_still_gets_the_commands_that_open_it_and_later_only_whole_lines() -> None:
    ours, theirs = os.openpty()
    os.set_blocking(ours, False)
    bus = msgspec.structs.replace(
        robot(14).buses[0], interface="slcan", channel=os.ttyname(theirs), options={"sleep_after_open": 0}
    )
    channel = Channel(bus, SystemClock(), dict(bus.options), Counter())
    channel.open()
    channel.purge()
    assert [line for line in os.read(ours, 4096).split(b"\r") if line] == [b"C", b"S8", b"O", b"O"]
    channel.send(can.Message(arbitration_id=0x141, data=[0x9A] + 7 * [0], is_extended_id=False), 0.1)
    channel.purge()  # of what nobody has read yet, if it has not gone out
    assert os.read(ours, 4096) in (b"\r", b"t14189A00000000000000\r\r")
    channel.close()
    os.close(ours)
    os.close(theirs)


def test_a_stray_configuration_of_python_can_changes_nothing(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(os.environ, "CAN_INTERFACE", "virtual")
    monkeypatch.setitem(os.environ, "CAN_CHANNEL", "elsewhere")
    with open_bus(simulated(robot(14)), ManualClock()) as bus:
        assert bus.enable() == ()


def test_the_log_has_every_frame_of_every_channel(tmp_path: Path) -> None:
    path = tmp_path / "can.log"
    with open_bus(simulated(on_two_channels()), ManualClock(), can_log=path) as bus:
        bus.enable()
        before = 5
        for _ in range(before):
            bus.exchange(bus.exchange(None).angle)
    frames = list(can.LogReader(path))
    setpoints = [frame for frame in frames if frame.data[0] == 0xA4]
    assert [frame.is_rx for frame in setpoints].count(False) == 14 * before
    assert [frame.is_rx for frame in setpoints].count(True) == 14 * before
    assert {frame.channel for frame in frames} == {"main", "second"}
