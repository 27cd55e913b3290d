"""The mechanics of all simulated drives at once: position sources with limited speed, acceleration and torque.

A drive pushes with a torque between the bounds of its mode (± its maximum, or exactly what is commanded; nothing when off).
With the load's torque and Coulomb friction of the gear this bounds its velocity, so that one law covers following,
stalling, slipping under overload, and being back-driven when off. All quantities at the output shaft.
"""

from collections.abc import Sequence
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cobra.description import Motor

Floats = NDArray[np.float64]
Mode = Literal["off", "position", "speed", "torque"]

POSITION_GAIN: Final = 100.0
"""Of the drive's own position loop [1/s]: it follows a ramp 10 ms late."""
BRAKING: Final = 0.85
"""Part of the acceleration that is planned for braking, so that a step's delay does not carry it past the target."""
RELEASE: Final = 0.2
"""Part of its torque by which an overpowered drive is pushed back at full speed."""
AMBIENT_C: Final = 25.0
HEATING: Final = 0.7
"""Warming at full current, as part of the way from ambient to the limit."""
THERMAL_TIME_S: Final = 150.0
SUPPLY_RESISTANCE_OHM: Final = 0.05
STANDSTILL_RAD_S: Final = 1e-3


class Command(NamedTuple):
    """What one drive is told: a position [rad], a speed [rad/s] or a current [A], and how fast it may be done."""

    mode: Mode
    value: float = 0.0
    speed_rad_s: float = np.inf
    acceleration_rad_s2: float = np.inf


class State(NamedTuple):
    """One drive at one instant."""

    angle_rad: float
    """0 at power-up."""
    velocity_rad_s: float
    current_A: float
    temperature_C: float
    voltage_V: float


class Servos:
    """Mechanics of n drives. `commands[i]` may be replaced by any thread at any time; `states` are whole snapshots."""

    def __init__(self, motors: Sequence[Motor]) -> None:
        n = len(motors)
        self.commands: list[Command] = [Command("off")] * n
        self.supply_V = float(np.mean([(m.min_voltage_V + m.max_voltage_V) / 2 for m in motors]))
        self._max_speed = np.array([m.max_speed_rad_s for m in motors])
        self._max_acceleration = np.array([m.max_acceleration_rad_s2 for m in motors])
        self._friction = np.array([m.back_drive_torque_Nm for m in motors])
        self._constant = np.array([m.torque_constant_Nm_A for m in motors])
        self._max_current = np.array([m.max_current_A for m in motors])
        self._max_temperature = np.array([m.max_temperature_C for m in motors])
        self._max_torque = self._max_current * self._constant
        self._slip = self._max_speed / (RELEASE * np.maximum(self._max_torque, self._friction))
        self.angle: Floats = np.zeros(n)
        self._velocity: Floats = np.zeros(n)
        self._torque: Floats = np.zeros(n)
        self._temperature: Floats = np.full(n, AMBIENT_C)
        self.stalled: set[int] = set()
        """Shafts that are blocked."""
        self.heated_C: dict[int, float] = {}
        """Drives that are as hot as this, whatever they do."""
        self.states: tuple[State, ...] = self._snapshot()

    def step(self, load_torque: Floats, duration_s: float) -> Floats:
        """Let `duration_s` pass under `load_torque` (n,) [N·m] on the shafts; gives the angles (n,) [rad]."""
        modes, values, speeds, accelerations = zip(*self.commands, strict=True)
        mode, value = np.array(modes), np.array(values)
        hot = self._temperature > self._max_temperature
        pushed = np.where(mode == "torque", np.clip(value * self._constant, -self._max_torque, self._max_torque), 0.0)
        served = ((mode == "position") | (mode == "speed")) & ~hot
        pushed[hot] = 0.0
        low, high = np.where(served, -self._max_torque, pushed), np.where(served, self._max_torque, pushed)

        acceleration = np.minimum(np.array(accelerations), self._max_acceleration)
        top = np.minimum(np.array(speeds), self._max_speed)
        wanted = np.where(mode == "position", _approach(value - self.angle, acceleration), value)
        wanted = np.clip(
            np.where(mode == "position", np.clip(wanted, -top, top), wanted), -self._max_speed, self._max_speed
        )
        wanted = np.clip(wanted, self._free_speed(low + load_torque), self._free_speed(high + load_torque))

        change = acceleration * duration_s
        self._velocity = self._velocity + np.clip(wanted - self._velocity, -change, change)
        stalled = list(self.stalled)
        self._velocity[stalled] = 0.0
        self.angle = self.angle + self._velocity * duration_s
        self._torque = np.clip(self._bearing_torque(load_torque), low, high)
        if stalled:
            # A blocked drive pushes towards its target as hard as it may.
            push = np.where(mode == "position", np.sign(value - self.angle), np.sign(value))
            self._torque[stalled] = np.where(served, push * self._max_torque, 0.5 * (low + high))[stalled]
        self._warm_up(duration_s)
        self.states = self._snapshot()
        return self.angle

    def _free_speed(self, torque: Floats) -> Floats:
        """Velocity at which a net torque is used up: none while friction holds it."""
        beyond = np.sign(torque) * np.maximum(np.abs(torque) - self._friction, 0.0)
        return np.clip(beyond * self._slip, -self._max_speed, self._max_speed)

    def _bearing_torque(self, load_torque: Floats) -> Floats:
        """What the motor needs against load and friction; at rest friction carries a part and the rest keeps its value."""
        direction = np.where(np.abs(self._velocity) > STANDSTILL_RAD_S, np.sign(self._velocity), 0.0)
        at_rest = np.clip(self._torque, -load_torque - self._friction, -load_torque + self._friction)
        return np.where(direction == 0.0, at_rest, -load_torque + self._friction * direction)

    def _warm_up(self, duration_s: float) -> None:
        use = self._torque / self._max_torque
        final = AMBIENT_C + HEATING * (self._max_temperature - AMBIENT_C) * use**2
        self._temperature = self._temperature + (final - self._temperature) * (duration_s / THERMAL_TIME_S)
        for index, celsius in list(self.heated_C.items()):
            self._temperature[index] = celsius

    def _snapshot(self) -> tuple[State, ...]:
        current = self._torque / self._constant
        voltage = self.supply_V - SUPPLY_RESISTANCE_OHM * float(np.abs(current).sum())
        columns = np.stack((self.angle, self._velocity, current, self._temperature), axis=1)
        return tuple(State(a, v, i, t, voltage) for a, v, i, t in columns.tolist())


def _approach(error: Floats, acceleration: Floats) -> Floats:
    """Velocity towards a target: proportional near it, else as fast as can still be braked."""
    braking = BRAKING * acceleration
    near = braking / POSITION_GAIN**2
    distance = np.abs(error)
    far_speed = np.sqrt(2.0 * braking * np.maximum(distance - near / 2.0, 0.0))
    return np.sign(error) * np.where(distance < near, POSITION_GAIN * distance, far_speed)
