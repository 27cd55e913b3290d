"""The motor bus: frames encoded and decoded, a burst of 14 drives against one drive after the other, the log's price."""

import os
import sys
import time
from collections import Counter, deque
from collections.abc import Callable
from pathlib import Path

import can
import msgspec
import numpy as np
import pytest

from cobra.clock import ManualClock, SystemClock
from cobra.loading import load_description
from cobra.motors.frame_bits import frame_bits
from cobra.motors.open_bus import open_bus
from cobra.motors.rmd import RMD_V1, decode, encode
from cobra.motors.rmd_channel import RmdChannel, outgoing
from cobra.motors.serial_reading import read_ahead

pytestmark = pytest.mark.benchmark

REPLY_LATENCY_S = 0.0011
"""Of a real drive, as users measured."""
FRAMES = 20_000


def times_of(call: Callable[[], object], n: int) -> np.ndarray:
    out = np.empty(n)
    for i in range(n):
        start = time.perf_counter()
        call()
        out[i] = time.perf_counter() - start
    return out


def paced(call: Callable[[], object], n: int) -> np.ndarray:
    """Like `times_of`, but a call every 10 ms."""
    clock, out = SystemClock(), np.empty(n)
    due = clock.now()
    for i in range(n):
        due += 0.01
        clock.sleep_until(due)
        start = time.perf_counter()
        call()
        out[i] = time.perf_counter() - start
    return out


def p50_p99(seconds: np.ndarray, unit: float) -> str:
    p50, p99 = np.percentile(seconds, (50, 99)) / unit
    return f"p50 {p50:8.3f}  p99 {p99:8.3f}"


def cobra(**options):
    d = load_description("cobra")
    given = {"twin": "none", "stepping": "inline", **options}
    return msgspec.structs.replace(d, buses=(msgspec.structs.replace(d.buses[0], options=given),))


class LatentDrives(can.BusABC):
    """Fourteen drives that each answer so long after they were asked, as on a real bus: all at the same time."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[float, can.Message]] = deque()
        super().__init__("latent")

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        reply = can.Message(arbitration_id=msg.arbitration_id, is_extended_id=False, data=bytes(msg.data))
        self._waiting.append((time.perf_counter() + REPLY_LATENCY_S, reply))

    def recv(self, timeout: float | None = None) -> can.Message | None:
        if not self._waiting or (timeout == 0 and self._waiting[0][0] > time.perf_counter()):
            return None
        while (remaining := self._waiting[0][0] - time.perf_counter()) > 0:
            time.sleep(remaining)
        return self._waiting.popleft()[1]


@pytest.mark.skipif(sys.platform == "win32", reason="pseudo-terminals of POSIX")
def test_reading_a_serial_adapter(capsys: pytest.CaptureFixture[str]) -> None:
    """python-can's slcan driver on its own port, one byte after the other, and on one that reads ahead."""
    import tty  # POSIX only

    replies = b"t1418A4320000D00700FF\r\r" * 14
    cpu: list[float] = []
    for reads_ahead in (False, True):
        far, near = os.openpty()
        tty.setraw(near)
        bus = can.Bus(
            interface="slcan", channel=os.ttyname(near), bitrate=1_000_000, sleep_after_open=0, ignore_config=True
        )
        if reads_ahead:
            read_ahead(bus)
        began = time.thread_time()
        for _ in range(200):
            os.write(far, replies)
            got = 0
            while got < 14:
                got += bus.recv(0.1) is not None
        cpu.append((time.thread_time() - began) / (200 * 14))
        bus.shutdown()
        os.close(far)
        os.close(near)
    with capsys.disabled():
        print(
            f"\nslcan, a reply read: {1e6 * cpu[0]:.0f} us of CPU byte by byte, {1e6 * cpu[1]:.0f} us reading ahead "
            f"({cpu[0] / cpu[1]:.1f} times less)"
        )
    assert cpu[1] < cpu[0]


def test_encoding_and_decoding(capsys: pytest.CaptureFixture[str]) -> None:
    reply = bytes.fromhex("A4 1E 0C 00 2A 03 D2 1F")
    layout, struct_only = RMD_V1.entries["status_2"].reply, RMD_V1.entries["position"].request.struct
    rates = {
        "encode + decode, by name": times_of(
            lambda: (encode(RMD_V1, "position", speed_dps=4125, angle_deg=123.45), decode(RMD_V1, "position", reply)),
            FRAMES,
        ),
        "encode + decode, raw counts": times_of(
            lambda: (struct_only.pack(0xA4, 4125, 12345), layout.struct.unpack(reply)), FRAMES
        ),
        "exact bits of a frame": times_of(lambda: (frame_bits(0x141, reply), frame_bits(0x142, reply)), FRAMES),
    }
    slowest = max(np.median(seconds) for seconds in rates.values())
    with capsys.disabled():
        print("\nRMD frames, median of two at a time")
        for name, seconds in rates.items():
            pair = np.median(seconds)
            print(f"  {name:28s} {2 / pair:12.0f} frames/s   {slowest / pair:5.1f} times the slowest")
    assert len(rates) == 3


def test_a_burst_against_one_drive_after_the_other(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    d = cobra()
    requests = [
        outgoing(RMD_V1, address, "position", {"speed_dps": 4125, "angle_deg": 1.0}) for address in range(1, 15)
    ]
    monkeypatch.setattr("can.Bus", lambda **_: LatentDrives())
    channel = RmdChannel(d.buses[0], SystemClock(), {}, Counter())
    channel.open()
    burst = times_of(lambda: channel.transact(requests, 0.02), 300)
    sequential = times_of(lambda: [channel.transact([request], 0.02) for request in requests], 60)
    channel.close()
    with capsys.disabled():
        print(f"\n14 drives that answer after {REPLY_LATENCY_S * 1e3:g} ms each, cycle [ms]")
        print(f"  burst, then collect   {p50_p99(burst, 1e-3)}   {1 / np.median(burst):6.0f} Hz")
        print(f"  one after the other   {p50_p99(sequential, 1e-3)}   {1 / np.median(sequential):6.0f} Hz")
        print(f"  ratio p50 {np.median(sequential) / np.median(burst):.1f}, p99 {np.percentile(sequential, 99) / np.percentile(burst, 99):.1f}")  # fmt: skip
    assert np.median(burst) < np.median(sequential)


def test_the_computation_of_an_exchange_and_the_price_of_the_log(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Setpoints at 100 Hz to 14 simulated drives that answer at once; their own computation is part of it."""
    seconds = {}
    for name, log in (("without log", None), ("with --can-log", tmp_path / "can.log")):
        with open_bus(cobra(), ManualClock(), can_log=log) as bus:
            bus.enable()
            angles = bus.exchange(None).angle
            seconds[name] = paced(lambda bus=bus, angles=angles: bus.exchange(angles), 400)
            assert bus.counts == {}
    ratio = np.median(seconds["with --can-log"]) / np.median(seconds["without log"])
    with capsys.disabled():
        print("\nexchange with 14 drives and a poll, computation alone [ms]")
        for name, taken in seconds.items():
            print(f"  {name:15s} {p50_p99(taken, 1e-3)}")
        print(f"  ratio p50 {ratio:.2f}")
    assert ratio > 0
