"""One simulated RMD drive: what it answers, byte for byte, and what it makes of what it is told."""

import math
from collections.abc import Callable

import numpy as np

from cobra.clock import Clock
from cobra.description import Motor
from cobra.motors.rmd import DIALECTS, REQUEST_ID, RMD_V3, WATCHDOG_ALARM, Request, decode_request, encode_reply
from cobra.simulation.node import Frame
from cobra.simulation.servos import Command, Servos, State

ALARM_PERIOD_S = 1.0
POWER_UP_TURNS = 3.0
"""A drive wakes up anywhere within so many turns of its shaft around zero."""
FIRMWARE_DATE = 20220206
MODEL = b"SIM-RMD"
MODES = {"off": 0, "torque": 1, "speed": 2, "position": 3}
SHIPPED_PLANNING_DPS2 = 10000
"""Acceleration of the trapezoid that a v3 drive plans for each setpoint until it is set to 0."""

Values = dict[str, float]


class RmdDrive:
    """Drive `index` of `servos`, in the dialect of its motor."""

    def __init__(
        self, address: int, motor: Motor, servos: Servos, index: int, clock: Clock, rng: np.random.Generator
    ) -> None:
        self.address = address
        self.dialect = DIALECTS[motor.protocol]
        self._motor = motor
        self._servos = servos
        self._index = index
        self._clock = clock
        self._output = self.dialect is RMD_V3
        self._ratio = 1.0 if self._output else motor.gear_ratio
        self._boot_deg = 360.0 * float(rng.uniform(-POWER_UP_TURNS, POWER_UP_TURNS))
        self._turn = 1 << motor.encoder_bits
        self._encoder_zero = int(rng.integers(self._turn))
        self._gains: Values = {
            "position_kp": 100, "position_ki": 100, "speed_kp": 50, "speed_ki": 40, "current_kp": 50, "current_ki": 50,
        }  # fmt: skip
        self._planning = {0: SHIPPED_PLANNING_DPS2, 1: SHIPPED_PLANNING_DPS2} if self._output else {0: 0}
        self._watchdog_s = 0.0
        self._heard_s = self._booted_s = clock.now()
        self._tripped = False
        self._alarmed_s = -math.inf
        self._before_stop = Command("off")
        self._handlers: dict[Request, Callable[[Values], Values]] = {
            "status_1": self._status_1,
            "status_2": self._motion,
            "status_3": self._phases,
            "clear_errors": self._status_1,
            "multi_turn_angle": self._multi_turn_angle,
            "single_turn_angle": self._single_turn_angle,
            "position": self._position,
            "speed": self._speed,
            "torque": self._torque_command,
            "stop": self._stop,
            "off": self._off,
            "run": self._run,
            "read_gains": lambda _: self._gains,
            "write_gains": self._write_gains,
            "write_gains_rom": self._write_gains,
            "read_acceleration": self._read_acceleration,
            "write_acceleration": self._write_acceleration,
            "read_encoder": self._read_encoder,
            "write_encoder_offset": lambda values: values,
            "zero_encoder": lambda _: {"offset": self._encoder_zero},
            "restart": self._off,
            "watchdog": self._watchdog,
            "position_full_speed": lambda values: self._position({**values, "speed_dps": 65535}),
            "single_turn_position": self._single_turn,
            "single_turn_position_full_speed": lambda values: self._single_turn({**values, "speed_dps": 65535}),
            "increment": lambda values: self._position(
                {**values, "angle_deg": self._shaft_deg() + values["angle_deg"]}
            ),
            "mode": lambda _: {"mode": MODES[self._servos.commands[self._index].mode]},
            "power": lambda _: {"power_W": abs(self._state.current_A) * self._state.voltage_V},
            "release_brake": lambda _: {},
            "lock_brake": lambda _: {},
            "uptime": lambda _: {"milliseconds": int(1000 * (self._clock.now() - self._booted_s)) % 2**32},
            "version": lambda _: {"date": FIRMWARE_DATE},
            "model": lambda _: {"text": int.from_bytes(MODEL, "little")},
        }

    @property
    def listens(self) -> frozenset[int]:
        return frozenset({REQUEST_ID + self.address})

    @property
    def speaks(self) -> bool:
        # v1 has no watchdog that could.
        return self._output

    def hear(self, arbitration_id: int, data: bytes) -> list[Frame]:
        """The reply to its request; nothing to what it does not understand."""
        reply = self._answer(data)
        return [] if reply is None else [(self.dialect.reply_id + self.address, reply)]

    def unasked(self) -> list[Frame]:
        """A v3 drive whose watchdog ran out says so about once a second."""
        alarm = self._alarm()
        return [] if alarm is None else [(self.dialect.reply_id + self.address, alarm)]

    def slip(self, degrees: float) -> None:
        """The encoder slips on its shaft, by degrees of the output."""
        self._boot_deg += degrees * self._ratio

    def _answer(self, data: bytes) -> bytes | None:
        """The reply to 8 bytes; None for what is no request of this dialect. Never raises."""
        try:
            request, values = decode_request(self.dialect, data)
        except ValueError:
            return None
        self._heard_s = self._clock.now()
        if self._tripped:
            # The first command after a trip is echoed and not obeyed.
            self._tripped = False
            return bytes(data)
        return encode_reply(self.dialect, request, **self._handlers[request](values))

    def _alarm(self) -> bytes | None:
        now = self._clock.now()
        if self._watchdog_s and not self._tripped and now - self._heard_s > self._watchdog_s:
            self._tripped = True
            self._servos.commands[self._index] = Command("off")
        if self._tripped and now - self._alarmed_s >= ALARM_PERIOD_S:
            self._alarmed_s = now
            return bytes([WATCHDOG_ALARM, 0, 0, 0, 0, 0, 0, 0])
        return None

    @property
    def _state(self) -> State:
        return self._servos.states[self._index]

    def _order(self, command: Command) -> None:
        self._servos.commands[self._index] = command

    def _shaft_deg(self) -> float:
        return self._boot_deg + math.degrees(self._state.angle_rad) * self._ratio

    def _output_rad(self, shaft_deg: float) -> float:
        return math.radians((shaft_deg - self._boot_deg) / self._ratio)

    def _encoder(self) -> int:
        return (math.floor(self._shaft_deg() / 360.0 * self._turn) + self._encoder_zero) % self._turn

    def _planned(self, index: int = 0) -> float:
        planned = self._planning[index]
        return math.radians(planned) / self._ratio if planned > 0 else math.inf

    def _motion(self, _: Values) -> Values:
        state = self._state
        values: Values = {
            "temperature_C": state.temperature_C,
            "current": _saturated(state.current_A / self._motor.current_per_count_A),
            "speed_dps": _saturated(math.degrees(state.velocity_rad_s) * self._ratio),
        }
        if self._output:
            values["angle_deg"] = (self._shaft_deg() + 32768) % 65536 - 32768
        else:
            values["encoder"] = self._encoder()
        return values

    def _status_1(self, _: Values) -> Values:
        state, motor = self._state, self._motor
        words = {
            "undervoltage": state.voltage_V < motor.min_voltage_V,
            "overvoltage": state.voltage_V > motor.max_voltage_V,
            "over-temperature": state.temperature_C > motor.max_temperature_C,
            "motor over-temperature": state.temperature_C > motor.max_temperature_C,
        }
        flags = sum(bit for bit, word in self.dialect.faults.items() if words.get(word, False))
        return {
            "temperature_C": state.temperature_C, "voltage_V": state.voltage_V, "flags": flags, "brake_released": 1,
        }  # fmt: skip

    def _phases(self, _: Values) -> Values:
        amperes = self._state.current_A
        electrical = math.radians(self._shaft_deg())
        return {
            f"phase_{phase}_A": amperes * math.cos(electrical - k * 2.0 * math.pi / 3.0)
            for k, phase in enumerate("abc")
        }

    def _multi_turn_angle(self, _: Values) -> Values:
        return {"angle_deg": self._shaft_deg()}

    def _single_turn_angle(self, _: Values) -> Values:
        degrees = self._shaft_deg() % 360.0
        return {"angle_deg": math.floor(degrees * 100.0) / 100.0}

    def _read_encoder(self, _: Values) -> Values:
        if self._output:
            return {"encoder": self._shaft_deg() / 360.0 * self._turn}
        encoder = self._encoder()
        return {"encoder": encoder, "raw": (encoder + self._encoder_zero) % self._turn, "offset": self._encoder_zero}

    def _position(self, values: Values) -> Values:
        speed = math.radians(values["speed_dps"]) / self._ratio
        if self._output and speed == 0.0:
            speed = math.inf
        self._order(Command("position", self._output_rad(values["angle_deg"]), speed, self._planned()))
        return self._motion(values)

    def _single_turn(self, values: Values) -> Values:
        """To an angle within the turn, the way round that is asked for (0: clockwise, towards larger angles)."""
        here = self._shaft_deg()
        ahead = (values["angle_deg"] - here) % 360.0
        way = ahead if values["direction"] == 0 else ahead - 360.0
        reply = self._position({"angle_deg": here + way, "speed_dps": values["speed_dps"]})
        return {**reply, "encoder": self._encoder()}

    def _speed(self, values: Values) -> Values:
        self._order(Command("speed", math.radians(values["speed_dps"]) / self._ratio))
        return self._motion(values)

    def _torque_command(self, values: Values) -> Values:
        per_count = self._motor.current_per_count_A * self.dialect.command_per_feedback_current
        self._order(Command("torque", values["current"] * per_count))
        return self._motion(values)

    def _stop(self, _: Values) -> Values:
        current = self._servos.commands[self._index]
        state, braking = self._state, self._motor.max_acceleration_rad_s2
        rest = state.angle_rad + state.velocity_rad_s * abs(state.velocity_rad_s) / (2.0 * braking)
        self._before_stop = current
        if current.mode != "off":
            self._order(Command("position", rest))
        return {}

    def _off(self, _: Values) -> Values:
        self._before_stop = Command("off")
        self._order(Command("off"))
        return {}

    def _run(self, _: Values) -> Values:
        self._order(self._before_stop)
        return {}

    def _write_gains(self, values: Values) -> Values:
        self._gains = values
        return values

    def _read_acceleration(self, values: Values) -> Values:
        index = int(values.get("index", 0))
        return {"index": index, "acceleration_dps2": self._planning.get(index, 0)}

    def _write_acceleration(self, values: Values) -> Values:
        self._planning[int(values.get("index", 0))] = int(values["acceleration_dps2"])
        return values

    def _watchdog(self, values: Values) -> Values:
        self._watchdog_s = values["timeout_ms"] / 1000.0
        return values


def _saturated(counts: float) -> float:
    """What a field of 16 bits can hold."""
    return min(32767.0, max(-32768.0, counts))
