"""One simulated CANopen drive of profile CiA 402: NMT, SDO, PDOs on SYNC, heartbeats, state machine, faults."""

import math
import struct
from typing import Final

import numpy as np

from cobra.clock import Clock
from cobra.description import Motor
from cobra.motors.cia402_frames import (
    EMERGENCY,
    ENABLE_OPERATION,
    FAULT_RESET,
    HEARTBEAT,
    NMT_BOOT_UP,
    NMT_OPERATIONAL,
    QUICK_STOP,
    SDO_REQUEST,
    SHUTDOWN,
    SWITCH_ON,
    SYNC,
    TEMPERATURE,
    VOLTAGE,
    State,
    scale_of,
    statusword_of,
)
from cobra.simulation.cia402_objects import PDO_INVALID, SUPPORTED_MODES, Objects
from cobra.simulation.node import Frame
from cobra.simulation.servos import Command, Servos
from cobra.simulation.servos import State as Servo

POWER_UP_TURNS: Final = 3.0
DEVICE_TYPE: Final = 0x00020192
"""Servo drive by CiA 402."""
NMT_PRE_OPERATIONAL: Final = 0x7F
NMT_STOPPED: Final = 0x04
_NMT: Final = {0x01: NMT_OPERATIONAL, 0x02: NMT_STOPPED, 0x80: NMT_PRE_OPERATIONAL}
_NMT_RESETS: Final = (0x81, 0x82)
_TORQUE_OFF: Final = ("not ready to switch on", "switch on disabled", "ready to switch on", "switched on", "fault")
UNDERVOLTAGE, OVER_TEMPERATURE, FOLLOWING_ERROR, HEARTBEAT_LOST = 0x3220, 0x4210, 0x8611, 0x8130


class Cia402Drive:
    """Drive `index` of `servos`, as node `address`."""

    def __init__(
        self, address: int, motor: Motor, servos: Servos, index: int, clock: Clock, rng: np.random.Generator
    ) -> None:
        self.address = address
        self._motor = motor
        self._servos = servos
        self._index = index
        self._clock = clock
        self._per_rad = scale_of(motor).increments_per_rad
        self._boot_rad = math.tau / motor.gear_ratio * float(rng.uniform(-POWER_UP_TURNS, POWER_UP_TURNS))
        self._serial = int(rng.integers(1, 1 << 31))
        self._reset()

    def _reset(self) -> None:
        self._objects = Objects(
            self.address,
            {
                (0x1000, 0): lambda: DEVICE_TYPE,
                (0x1001, 0): lambda: int(self._error != 0),
                (0x1018, 0): lambda: 4,
                (0x1018, 1): lambda: 0x5EED,
                (0x1018, 4): lambda: self._serial,
                (0x603F, 0): lambda: self._error,
                (0x6041, 0): lambda: statusword_of(self.state),
                (0x6061, 0): lambda: self._objects[0x6060, 0],
                (0x6064, 0): lambda: self._increments,
                (0x6077, 0): self._permille,
                (0x6502, 0): lambda: SUPPORTED_MODES,
                VOLTAGE: lambda: round(10 * self._servo.voltage_V),
                TEMPERATURE: lambda: round(10 * self._servo.temperature_C),
            },
            {0x1008: f"Simulated {self._motor.name}", 0x100A: "1.0"},
        )
        self.state: State = "switch on disabled"
        self._nmt = NMT_BOOT_UP
        self._error = 0
        self._staged: bytes | None = None
        self._beaten_s = -math.inf
        self._heard_s: float | None = None
        self._order(Command("off"))

    @property
    def listens(self) -> frozenset[int]:
        # 0x200 + node is where RPDO 1 of every profile's default connection set is.
        own = {0x200 + self.address, SDO_REQUEST + self.address}
        return frozenset({0, SYNC, *own, *range(HEARTBEAT + 1, HEARTBEAT + 128)})

    @property
    def speaks(self) -> bool:
        return True

    def slip(self, degrees: float) -> None:
        """The encoder slips on its shaft, by degrees of the output."""
        self._boot_rad += math.radians(degrees)

    def hear(self, arbitration_id: int, data: bytes) -> list[Frame]:
        """What it answers. Never raises."""
        if arbitration_id == 0:
            self._manage(data)
        elif arbitration_id >= HEARTBEAT:
            if arbitration_id - HEARTBEAT == self._objects[0x1016, 1] >> 16 & 0x7F:
                self._heard_s = self._clock.now()
        elif arbitration_id == SDO_REQUEST + self.address:
            if self._nmt in (NMT_OPERATIONAL, NMT_PRE_OPERATIONAL):
                return self._objects.ask(arbitration_id, data)
        elif self._nmt == NMT_OPERATIONAL:
            if arbitration_id == SYNC:
                return self._synchronise()
            if self._objects[0x1400, 1] == arbitration_id:
                self._staged = data
        return []

    def unasked(self) -> list[Frame]:
        """Boot-up, heartbeats, emergencies."""
        now = self._clock.now()
        frames = []
        if self._nmt == NMT_BOOT_UP:
            frames.append((HEARTBEAT + self.address, bytes([NMT_BOOT_UP])))
            self._nmt = NMT_PRE_OPERATIONAL
        period_s = self._objects[0x1017, 0] / 1000.0
        if period_s and now - self._beaten_s >= period_s:
            self._beaten_s = now
            frames.append((HEARTBEAT + self.address, bytes([self._nmt])))
        return frames + self._watch(now)

    # ---------------------------------------------------------------------------------------------------------------

    @property
    def _servo(self) -> Servo:
        return self._servos.states[self._index]

    @property
    def _increments(self) -> int:
        return round((self._boot_rad + self._servo.angle_rad) * self._per_rad)

    def _permille(self) -> int:
        permille = self._servo.current_A / self._motor.current_per_count_A
        return round(min(32767.0, max(-32768.0, permille)))

    def _order(self, command: Command) -> None:
        self._servos.commands[self._index] = command

    def _manage(self, data: bytes) -> None:
        if len(data) != 2 or data[1] not in (0, self.address):
            return
        if data[0] in _NMT_RESETS:
            self._reset()
        self._nmt = _NMT.get(data[0], self._nmt)

    def _synchronise(self) -> list[Frame]:
        """SYNC: what RPDO 1 brought takes effect, and TPDO 1 says how it stands."""
        staged, self._staged = self._staged, None
        mapping = self._objects.mapping(0x1600)
        if staged is not None and len(staged) == sum(size for _, size in mapping):
            values = {}
            for key, size in mapping:
                signed = key == (0x607A, 0)
                values[key], staged = int.from_bytes(staged[:size], "little", signed=signed), staged[size:]
            if (0x6040, 0) in values:
                self._control(values[0x6040, 0])
            if self.state == "operation enabled" and (0x607A, 0) in values:
                self._order(Command("position", values[0x607A, 0] / self._per_rad - self._boot_rad))
        cob_id = self._objects[0x1800, 1]
        if cob_id & PDO_INVALID or self._objects[0x1800, 2] != 1:
            return []
        return [(cob_id & 0x7FF, self._objects.pack(0x1A00))]

    def _control(self, word: int) -> None:
        """The state machine of CiA 402, figure 'power drive system': bits 7, then 3, 2, 1, 0 of the controlword."""
        state = self.state
        if state == "fault":
            if word & FAULT_RESET:
                self._error = 0
                self._enter("switch on disabled")
            return
        command = word & 0x0F
        if not command & 0x02:
            self._enter("switch on disabled")
        elif not command & QUICK_STOP << 1:
            if state == "operation enabled":
                self._stop()
            elif state != "quick stop active":
                self._enter("switch on disabled")
        elif command == ENABLE_OPERATION:
            if state in ("switched on", "quick stop active"):
                if self._objects[0x6060, 0] != 8:
                    return
                self._order(Command("position", self._servo.angle_rad))
                self._enter("operation enabled")
            elif state == "ready to switch on":
                self._enter("switched on")
        elif command & 0x07 == SWITCH_ON:
            if state in ("ready to switch on", "operation enabled"):
                self._enter("switched on")
        elif command & 0x07 == SHUTDOWN and state != "quick stop active":
            self._enter("ready to switch on")

    def _enter(self, state: State) -> None:
        self.state = state
        if state in _TORQUE_OFF:
            self._order(Command("off"))

    def _stop(self) -> None:
        """Quick stop with option 6: slow down and stay, with torque."""
        servo, braking = self._servo, self._motor.max_acceleration_rad_s2
        self._order(
            Command("position", servo.angle_rad + servo.velocity_rad_s * abs(servo.velocity_rad_s) / (2.0 * braking))
        )
        self.state = "quick stop active"

    def _watch(self, now_s: float) -> list[Frame]:
        servo, motor = self._servo, self._motor
        consumer_s = (self._objects[0x1016, 1] & 0xFFFF) / 1000.0
        if self._heard_s is not None and consumer_s and now_s - self._heard_s > consumer_s:
            self._heard_s = None
            if self.state == "operation enabled":
                self._stop()
            return [self._emergency(HEARTBEAT_LOST)]
        if self._error:
            return []
        if servo.voltage_V < motor.min_voltage_V:
            return self._fail(UNDERVOLTAGE)
        if servo.temperature_C > motor.max_temperature_C:
            return self._fail(OVER_TEMPERATURE)
        command = self._servos.commands[self._index]
        window = self._objects[0x6065, 0]
        late = abs(command.value - servo.angle_rad) * self._per_rad if command.mode == "position" else 0.0
        if self.state == "operation enabled" and window != 0xFFFFFFFF and late > window:
            return self._fail(FOLLOWING_ERROR)
        return []

    def _fail(self, code: int) -> list[Frame]:
        self._error = code
        self._enter("fault")
        return [self._emergency(code)]

    def _emergency(self, code: int) -> Frame:
        return (EMERGENCY + self.address, struct.pack("<HB5x", code, 1 if code else 0))
