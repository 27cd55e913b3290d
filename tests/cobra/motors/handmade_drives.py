"""A wire of our own: drives built by hand from the vendor's documents, byte by byte, without the program's codec."""

import struct
from collections import deque
from dataclasses import dataclass, field
from typing import Any

import can
import msgspec

from cobra.clock import ManualClock
from cobra.description import RobotDescription
from cobra.loading import load_description
from cobra.motors.rmd_bus import RmdBus

GEAR = 9.0


@dataclass
class HandmadeDrive:
    """Answers like the vendor prints it. `shaft_deg` is of the motor's shaft (v1) or the output shaft (v3)."""

    address: int
    v3: bool = False
    shaft_deg: float = 0.0
    encoder_zero: int = 1234
    speed_dps: int = 0
    iq: int = 0
    celsius: int = 30
    decivolts: int = 480
    flags: int = 0
    silent: bool = False
    acceleration: int = 0
    watchdog_taken: bool = True
    orders: list[bytes] = field(default_factory=list)
    """Everything that was asked but reads."""

    def reply(self, data: bytes) -> bytes | None:
        command = data[0]
        if command not in (0x92, 0x9A, 0x9C, 0x42):
            self.orders.append(data)
        if self.silent:
            return None
        if command in (0x9C, 0xA4):
            last = (
                struct.pack("<h", int(self.shaft_deg) % 100)
                if self.v3
                else struct.pack("<H", (int(self.shaft_deg / 360 * 16384 // 1) + self.encoder_zero) % 16384)
            )
            return bytes([command]) + struct.pack("<bhh", self.celsius, self.iq, self.speed_dps) + last
        if command == 0x92:
            counts = round(self.shaft_deg * 100)
            return b"\x92\0\0\0" + struct.pack("<i", counts) if self.v3 else b"\x92" + struct.pack("<q", counts)[:7]
        if command in (0x9A, 0x9B) and self.v3:
            return b"\x9a" + struct.pack("<bBBHH", self.celsius, 0, 1, self.decivolts, self.flags)
        if command in (0x9A, 0x9B):
            return b"\x9a" + struct.pack("<bBHBBB", self.celsius, 0, self.decivolts, 0, 0, self.flags)
        if command == 0x42:
            return data[:4] + struct.pack("<I", self.acceleration)
        if command == 0xB3 and not self.watchdog_taken:
            return bytes([0xB3, 0, 0, 0, 0, 0, 0, 0])
        return data


class Wire(can.BusABC):
    """A channel without a medium: what is sent is answered at once; waiting moves the clock."""

    def __init__(self, clock: ManualClock, drives: list[HandmadeDrive]) -> None:
        self.clock = clock
        self.drives = {drive.address: drive for drive in drives}
        self.inbox: deque[can.Message] = deque()
        self.history: list[tuple[str, int]] = []
        """("sent" | "received", first byte), in order."""
        self.sent: list[tuple[int, bytes]] = []
        self.broken: Exception | None = None
        self.latency: dict[int, float] = {}
        """Seconds that a drive's replies wait, by address."""
        self._later: list[tuple[float, can.Message]] = []
        super().__init__("wire")

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        if self.broken:
            raise self.broken
        data = bytes(msg.data)
        assert len(data) == 8
        assert not msg.is_extended_id
        self.history.append(("sent", data[0]))
        self.sent.append((msg.arbitration_id, data))
        drive = self.drives.get(msg.arbitration_id - 0x140)
        if drive and (reply := drive.reply(data)) is not None:
            frame = plain((0x240 if drive.v3 else 0x140) + drive.address, reply)
            self._later.append((self.clock.now() + self.latency.get(drive.address, 0.0), frame))

    def recv(self, timeout: float | None = None) -> can.Message | None:
        if self.broken:
            raise self.broken
        self._deliver()
        if not self.inbox and timeout:
            self.clock.advance(min([timeout, *(max(0.0, at - self.clock.now()) for at, _ in self._later)]))
            self._deliver()
            if not self.inbox:
                return None
        if not self.inbox:
            return None
        frame = self.inbox.popleft()
        if frame.data:
            self.history.append(("received", frame.data[0]))
        return frame

    def _deliver(self) -> None:
        now = self.clock.now() + 1e-12
        self.inbox.extend(frame for at, frame in self._later if at <= now)
        self._later = [(at, frame) for at, frame in self._later if at > now]


def plain(arbitration_id: int, data: bytes | str) -> can.Message:
    payload = bytes.fromhex(data) if isinstance(data, str) else data
    return can.Message(arbitration_id=arbitration_id, is_extended_id=False, data=payload)


def robot(n: int, protocol: str = "rmd-v1", **teleop: Any) -> RobotDescription:
    """COBRA with the first n of its drives, which is enough for a bus."""
    d = load_description("cobra")
    motor = msgspec.structs.replace(
        d.motors[0], protocol=protocol, gear_ratio=GEAR, max_speed_rad_s=8.0,
        current_per_count_A=33 / 2048, encoder_bits=14, max_temperature_C=80.0,
        min_voltage_V=20.0, max_voltage_V=52.0,
    )  # fmt: skip
    return msgspec.structs.replace(
        d, motors=(motor,), drives=d.drives[:n], teleop=msgspec.structs.replace(d.teleop, **teleop)
    )


@dataclass
class Rig:
    """A bus under test on a wire."""

    bus: RmdBus
    wire: Wire
    clock: ManualClock

    @property
    def drives(self) -> list[HandmadeDrive]:
        return list(self.wire.drives.values())

    def orders(self) -> list[bytes]:
        return [order for drive in self.drives for order in drive.orders]
