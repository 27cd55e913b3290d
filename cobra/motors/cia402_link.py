"""One CiA 402 drive as its bus sees it: how it is set up, what it last said, and what is wrong with it."""

import math
import struct
from typing import Final

from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError

from cobra.description import Drive, Motor
from cobra.motors.bus import HOME_AGAIN
from cobra.motors.cia402_frames import (
    ACTUALS,
    ACTUALS_MAP,
    CYCLIC_SYNCHRONOUS_POSITION,
    EMERGENCY,
    HEARTBEAT,
    MASTER_NODE,
    NMT_BOOT_UP,
    NMT_OPERATIONAL,
    OTHER_PDOS,
    RPDO1,
    SDO_ABORTS,
    SDO_REPLY,
    SDO_REQUEST,
    TARGETS_MAP,
    TEMPERATURE,
    TPDO1,
    VOLTAGE,
    State,
    error_words,
    scale_of,
    state_of,
)
from cobra.motors.cia402_network import CanopenChannel, CanopenNode
from cobra.motors.drive_limits import beyond_limits

HEARTBEAT_MS: Final = 100
"""Each drive says so often that it lives."""
HEARTBEAT_LOST_S: Final = 0.35
WATCH_MS: Final = 200
"""A drive that has not heard the controller for so long stops and holds."""
QUICK_STOP_AND_HOLD: Final = 6
ON_LOST_CONTROLLER_QUICK_STOP: Final = 3
SYNCHRONOUS: Final = 1
SUPPORTS_CSP: Final = 1 << 7

_UPLOAD, _ABORT = 0x40, 0x80
_WIDTHS = {0x4F: "<b", 0x4B: "<h", 0x43: "<i"}
_UNSIGNED = {VOLTAGE}


class Cia402Link:
    """Subscribes to all that its drive sends."""

    def __init__(self, drive: Drive, motor: Motor, network: CanopenChannel) -> None:
        self.name = drive.name
        self.address = drive.address
        self.motor = motor
        self.scale = scale_of(motor)
        self.state: State = "not ready to switch on"
        self.increments: int | None = None
        self.permille = 0
        self.heard_s = -math.inf
        """When TPDO 1 came last."""
        self.answered = False
        """Since who asks has cleared it."""
        self.polled: dict[tuple[int, int], float] = {VOLTAGE: math.nan, TEMPERATURE: math.nan}
        """[V] and [°C]; NaN until read; an object that the drive does not have is left out."""
        self.configured = False
        self.lost = ""
        self._emergency = ""
        self._operational = False
        self._beaten_s = math.inf
        self._previous: tuple[float, int] | None = None
        self._velocity = math.nan
        self._configuring = False
        self._node = CanopenNode(drive.address)
        self._network = network
        network.add_node(self._node)
        # Only one may take each answer, and nothing may be kept without bound.
        for service in (SDO_REPLY, EMERGENCY, HEARTBEAT):
            network.unsubscribe(service + drive.address)
        network.subscribers.pop(0, None)
        network.subscribe(SDO_REPLY + drive.address, self._take_sdo)
        network.subscribe(EMERGENCY + drive.address, self._take_emergency)
        network.subscribe(HEARTBEAT + drive.address, self._take_heartbeat)
        network.subscribe(TPDO1 + drive.address, self._take_actuals)

    # -- setting up -------------------------------------------------------------------------------------------------

    def configure(self, period_ms: int) -> str:
        """Write mode, cycle, heartbeats and mapping, and start the node. What went wrong in words, or nothing."""
        self._configuring = True
        try:
            self._write_all(period_ms)
        except SdoAbortedError as error:
            code = getattr(error, "code", 0)
            return f"does not take its set-up: {SDO_ABORTS.get(code, 'refused')} (0x{code:08X})"
        except SdoCommunicationError:
            return "does not answer: check its power, node id, bit rate and the bus termination"
        finally:
            self._configuring = False
        self.configured = True
        return ""

    def _write_all(self, period_ms: int) -> None:
        node, sdo = self._node, self._node.sdo
        node.nmt.state = "PRE-OPERATIONAL"
        if not sdo[0x6502].raw & SUPPORTS_CSP:
            raise SdoAbortedError(0x06090030)
        sdo[0x6060].raw = CYCLIC_SYNCHRONOUS_POSITION
        sdo[0x60C2][2].raw = -3
        sdo[0x60C2][1].raw = period_ms
        sdo[0x605A].raw = QUICK_STOP_AND_HOLD
        sdo[0x6007].raw = ON_LOST_CONTROLLER_QUICK_STOP
        sdo[0x1017].raw = HEARTBEAT_MS
        sdo[0x1016][1].raw = MASTER_NODE << 16 | WATCH_MS
        for pdos, base, mapped in ((node.rpdo, RPDO1, TARGETS_MAP), (node.tpdo, TPDO1, ACTUALS_MAP)):
            pdo = pdos[1]
            pdo.cob_id, pdo.enabled, pdo.trans_type = base + self.address, True, SYNCHRONOUS
            pdo.clear()
            for index, subindex, bits in mapped:
                pdo.add_variable(index, subindex, bits)
            pdo.save()
        # What the package would keep of each TPDO is not needed: `_take_actuals` reads it.
        self._network.unsubscribe(TPDO1 + self.address, node.tpdo[1].on_message)
        self._network.unsubscribe(RPDO1 + self.address)
        for number in OTHER_PDOS:
            for index in (0x1400, 0x1800):
                base = (RPDO1 if index == 0x1400 else TPDO1) + 0x100 * (number - 1) + self.address
                sdo[index + number - 1][1].raw = 1 << 31 | base
        node.nmt.state = "OPERATIONAL"
        self._operational = True

    # -- what it says -----------------------------------------------------------------------------------------------

    @property
    def fault(self) -> str:
        """What is wrong, in words."""
        now = self._network.channel.clock.now()
        beats = "" if now - self._beaten_s < HEARTBEAT_LOST_S or self._beaten_s == math.inf else "its heartbeat is lost"
        limits = beyond_limits(self.motor, self.polled.get(TEMPERATURE, math.nan), self.polled.get(VOLTAGE, math.nan))
        return "; ".join(words for words in (self._emergency, *limits, beats, self.lost) if words)

    @property
    def velocity_rad_s(self) -> float:
        """From the last two positions."""
        return self._velocity

    def forget_errors(self) -> None:
        """Before it is enabled: what it still means, it says again."""
        self.lost = self._emergency = ""

    def poll(self, key: tuple[int, int]) -> tuple[int, bytes]:
        """The request for an object that is read now and then: id and data."""
        return SDO_REQUEST + self.address, struct.pack("<BHB4x", _UPLOAD, *key)

    def _take_actuals(self, _: int, data: bytearray, now_s: float) -> None:
        if len(data) != ACTUALS.size:
            self._network.channel.counts["PDO of another length"] += 1
            return
        statusword, increments, self.permille = ACTUALS.unpack(data)
        self.state = state_of(statusword)
        if self._previous is not None and now_s > self._previous[0]:
            gap, moved = now_s - self._previous[0], increments - self._previous[1]
            self._velocity = moved / self.scale.increments_per_rad / gap
            # Twice the way possible at full speed, and ten degrees of the motor's shaft.
            possible = self.scale.increments_per_rad * 2.0 * self.motor.max_speed_rad_s * gap
            if abs(moved) > possible + 2.0**self.motor.encoder_bits / 36.0:
                self._network.channel.counts["angle jumped"] += 1
                degrees = math.degrees(moved / self.scale.increments_per_rad)
                self.lost = f"its angle jumped by {degrees:+.1f} degrees (power lost, or encoder slipped): {HOME_AGAIN}"
        self._previous = (now_s, increments)
        self.increments, self.heard_s, self.answered = increments, now_s, True

    def _take_emergency(self, _: int, data: bytearray, now_s: float) -> None:
        (code,) = struct.unpack_from("<H", data)
        self._emergency = error_words(code)

    def _take_heartbeat(self, _: int, data: bytearray, now_s: float) -> None:
        self._beaten_s = now_s
        state = data[0] & 0x7F
        if state == NMT_BOOT_UP and self._operational:
            self.lost = f"it was restarted: {HOME_AGAIN}"
        elif state not in (NMT_OPERATIONAL, NMT_BOOT_UP) and self._operational:
            self.lost = self.lost or "it left the operational state: arm again"
        if state != NMT_OPERATIONAL and not self._configuring:
            self.configured = self._operational = False

    def _take_sdo(self, can_id: int, data: bytearray, now_s: float) -> None:
        if self._configuring:
            self._node.sdo.on_response(can_id, data, now_s)
            return
        command, index, subindex = struct.unpack_from("<BHB", data)
        key = (index, subindex)
        if key not in self.polled:
            self._network.channel.counts["late reply"] += 1
        elif command == _ABORT:
            del self.polled[key]
        elif command in _WIDTHS:
            (raw,) = struct.unpack_from(_WIDTHS[command], data, 4)
            self.polled[key] = (raw & 0xFFFF if key in _UNSIGNED else raw) / 10.0
