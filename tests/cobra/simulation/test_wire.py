"""The simulated medium: exact times, arbitration, and faults that reach whom they should."""

import can
import pytest

from cobra.clock import ManualClock
from cobra.motors.frame_bits import frame_bits
from cobra.simulation.node import Frame
from cobra.simulation.wire import ADAPTER_QUEUE_FRAMES, Wire

BITRATE = 500_000


class Echo:
    """Answers with its own id and the same bytes."""

    def __init__(self, address: int) -> None:
        self.address = address
        self.heard: list[bytes] = []
        self.listens = frozenset({0x140 + address})

    def hear(self, arbitration_id: int, data: bytes) -> list[Frame]:
        self.heard.append(data)
        return [(0x240 + self.address, data)]

    def unasked(self) -> list[Frame]:
        return []


class Ear:
    def __init__(self) -> None:
        self.frames: list[can.Message] = []
        self.nudged = 0

    def receive(self, frame: can.Message) -> None:
        self.frames.append(frame)

    def nudge(self) -> None:
        self.nudged += 1


def wire(timing: str = "bit-true", n: int = 3, latency_s: float = 0.0) -> tuple[Wire, ManualClock, Ear, list[Echo]]:
    clock, drives = ManualClock(0.0), [Echo(i + 1) for i in range(n)]
    made = Wire({f"d{d.address}": d for d in drives}, clock.now, BITRATE, timing, latency_s, 1)  # type: ignore[arg-type]
    ear = Ear()
    made.adapters = (ear,)
    return made, clock, ear, drives


def ask(address: int) -> can.Message:
    return can.Message(arbitration_id=0x140 + address, is_extended_id=False, data=bytes([address] * 8))


def test_frames_take_their_bits_and_requests_win_the_arbitration() -> None:
    w, clock, ear, drives = wire()
    for address in (1, 2, 3):
        w.send(ear, ask(address))
    requests = [frame_bits(0x140 + a, bytes([a] * 8)) / BITRATE for a in (1, 2, 3)]
    replies = [frame_bits(0x240 + a, bytes([a] * 8)) / BITRATE for a in (1, 2, 3)]
    clock.sleep_until(requests[0] - 1e-9)
    w.settle()
    assert drives[0].heard == []
    clock.sleep_until(1.0)
    w.settle()
    ends = [sum(requests) + sum(replies[: k + 1]) for k in range(3)]
    assert [frame.arbitration_id for frame in ear.frames] == [0x241, 0x242, 0x243]
    assert [frame.timestamp for frame in ear.frames] == pytest.approx(ends, abs=1e-12)


def test_the_next_frame_is_through_when_it_says() -> None:
    w, clock, ear, _ = wire(latency_s=0.001)
    w.send(ear, ask(1))
    seconds = frame_bits(0x141, bytes([1] * 8)) / BITRATE
    assert w.next_s == pytest.approx(seconds)
    clock.sleep_until(w.next_s)
    w.settle()
    assert ear.frames == []
    assert w.next_s == pytest.approx(seconds + 0.001 + frame_bits(0x241, bytes([1] * 8)) / BITRATE)
    clock.sleep_until(w.next_s)
    w.settle()
    assert len(ear.frames) == 1


def test_a_jammed_bus_fills_the_adapters_queue_and_purging_empties_it() -> None:
    w, clock, ear, drives = wire()
    w.faults.jammed = True
    for _ in range(ADAPTER_QUEUE_FRAMES):
        w.send(ear, ask(1))
    with pytest.raises(can.CanOperationError, match="Transmit buffer full"):
        w.send(ear, ask(1))
    w.purge(ear)
    w.faults.jammed = False
    clock.advance(1.0)
    w.settle()
    assert drives[0].heard == [], "what was queued while the bus was dead reaches nobody"


@pytest.mark.parametrize("timing", ["instant", "bit-true"])
def test_faults_reach_the_drive_they_are_for(timing: str) -> None:
    w, clock, ear, drives = wire(timing)
    w.faults.drop["d1"] = 1.0
    w.faults.duplicate["d2"] = 1.0
    w.faults.corrupt["d3"] = 1.0
    for address in (1, 2, 3):
        w.send(ear, ask(address))
    clock.advance(1.0)
    w.settle()
    assert drives[0].heard == []
    assert [frame.arbitration_id for frame in ear.frames] == [0x242, 0x242, 0x243]
    (corrupt,) = (frame for frame in ear.frames if frame.arbitration_id == 0x243)
    assert sum(a != b for a, b in zip(corrupt.data, bytes([3] * 8), strict=True)) == 1
    assert drives[2].heard == [bytes([3] * 8)], "orders are never corrupted: a real bus repeats them"


def test_delayed_replies_come_later_also_without_a_bit_rate() -> None:
    w, clock, ear, _ = wire("instant")
    w.faults.delay_s["d1"] = 0.02
    w.send(ear, ask(1))
    w.send(ear, ask(2))
    assert [frame.arbitration_id for frame in ear.frames] == [0x242]
    clock.advance(0.021)
    w.settle()
    assert [frame.arbitration_id for frame in ear.frames] == [0x242, 0x241]


def test_bus_off_is_told_to_who_sends_and_nothing_passes() -> None:
    w, clock, ear, drives = wire()
    w.faults.off = True
    w.send(ear, ask(1))
    clock.advance(1.0)
    w.settle()
    assert [frame.is_error_frame for frame in ear.frames] == [True]
    assert drives[0].heard == []


@pytest.mark.parametrize("timing", ["instant", "bit-true"])
def test_who_waits_for_a_frame_is_told_when_a_later_one_is_on_its_way(timing: str) -> None:
    """Else it would sleep through a reply that takes a while, and a robot take the bus for a silent one."""
    made, clock, ear, _ = wire(timing, latency_s=0.005)
    ear.nudged = 0
    made.send(ear, ask(1))
    clock.advance(0.002)
    made.settle()
    assert ear.nudged > 0
    assert made.next_s > clock.now()
