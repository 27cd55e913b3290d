"""Procedures alone on a bus, without a robot process: some drives of a robot, or one motor that no description knows."""

import threading
from collections.abc import Callable
from typing import Final, Protocol

import msgspec
import numpy as np

from cobra.clock import Clock
from cobra.description import Backbone, Bus, Drive, Motor, RobotDescription, Section, Teleop
from cobra.motors.bus import MotorBus
from cobra.motors.commissioning.procedure import AbortError, Bounds, Floats, Guard, Procedure, Seen, seen_of
from cobra.motors.open_bus import SIMULATED
from cobra.motors.rmd_probe import FoundDrive
from cobra.motors.transmission import Transmission

SETTLE_TICKS: Final = 8
"""Read before anything moves: v3 drives tell their angle only every few ticks."""
BARE_SPEED_RAD_S: Final = {"rmd-v1": 6.0, "rmd-v3": 2.0, "cia402": 2.0}
"""v1 speaks of the motor's shaft."""
BARE_RATE_Hz: Final = 50.0
"""Enough for one motor that moves gently, through any adapter."""
BARE_CURRENT_A: Final = {"rmd-v1": 33.0 / 2048.0, "rmd-v3": 0.01, "cia402": 0.005}
"""Of a count: the protocols' usual ones."""


class Bounded(Procedure, Protocol):
    """A procedure that says which drives it moves, and how far at most."""

    @property
    def moved(self) -> tuple[int, ...]: ...
    @property
    def bounds(self) -> Bounds: ...


class Bench:
    """Drives of one description on an open bus; their travel is 0 where they stood when it was made."""

    def __init__(self, description: RobotDescription, bus: MotorBus, clock: Clock) -> None:
        self.description = description
        self.transmission = Transmission(description)
        self._bus = bus
        self._clock = clock
        self._period_s = 1.0 / description.teleop.loop_rate_Hz
        self.setpoint: Floats = np.zeros(len(description.drives))
        self.seen: Seen | None = None
        """What the drives said last in a procedure."""

    def enable(self) -> None:
        """Read where the drives stand and let them take setpoints. Raises AbortError with the reasons, BusError."""
        reasons = self._bus.enable()
        if reasons:
            raise AbortError("; ".join(reasons))
        for _ in range(SETTLE_TICKS):
            feedback = self._bus.exchange(None)
            self._clock.sleep_until(self._clock.now() + self._period_s)
        if np.any(np.isnan(feedback.angle)):
            silent = [self.description.drives[i].name for i in np.flatnonzero(np.isnan(feedback.angle))]
            raise AbortError(f"no angle is known of {', '.join(silent)}")
        self.transmission.refer(feedback.angle, np.zeros(len(feedback.angle)))
        self.setpoint = np.zeros(len(feedback.angle))

    def run(self, procedure: Bounded, tell: Callable[[str], None], stop: threading.Event | None = None) -> None:
        """Step it to its end; `tell` hears what it does.

        Whatever ends it, the drives then stand still with torque.

        Raises:
            AbortError: it went beyond its bounds, cannot go on, or was stopped.
            BusError: the bus is gone.
        """
        guard = Guard(self.description, procedure.moved, procedure.bounds)
        said = ""
        deadline = self._clock.now()
        try:
            while not procedure.done:
                if stop is not None and stop.is_set():
                    raise AbortError("it was stopped")
                feedback = self._bus.exchange(self.transmission.angle(self.setpoint))
                seen = self.seen = seen_of(feedback, self.transmission)
                guard.check(self.setpoint, seen, self._period_s)
                self.setpoint = procedure.step(self.setpoint, seen, self._period_s)
                if procedure.progress != said:
                    tell(said := procedure.progress)
                deadline = max(deadline + self._period_s, self._clock.now())
                self._clock.sleep_until(deadline)
        except AbortError:
            self._bus.hold()
            raise


def only(description: RobotDescription, indices: tuple[int, ...]) -> RobotDescription:
    """The same robot with some of its drives alone: the others need not be there yet."""
    drives = tuple(description.drives[i] for i in indices)
    used = {drive.bus for drive in drives}

    def kept(bus: Bus) -> Bus:
        # A simulated world is still that of the whole robot.
        options = {"description": description, **bus.options} if bus.interface == SIMULATED else bus.options
        return msgspec.structs.replace(bus, options=options)

    buses = tuple(kept(bus) for bus in description.buses if bus.name in used)
    return msgspec.structs.replace(description, drives=drives, buses=buses, load_cells=())


def bare(found: FoundDrive, bus: Bus) -> RobotDescription:
    """A robot that is nothing but one motor, of which only the address is known: travel is the angle of its shaft [rad]."""
    name = f"{found.address}"
    speed = BARE_SPEED_RAD_S[found.protocol]
    motor = Motor(
        name=name, protocol=found.protocol, gear_ratio=1.0, torque_constant_Nm_A=1.0,
        current_per_count_A=BARE_CURRENT_A[found.protocol], encoder_bits=14 if found.protocol == "rmd-v1" else 12,
        max_speed_rad_s=speed, max_acceleration_rad_s2=10.0 * speed, max_current_A=4.0, back_drive_torque_Nm=0.0,
        max_temperature_C=80.0, min_voltage_V=7.0, max_voltage_V=60.0,
    )  # fmt: skip
    drive = Drive(
        name=name, moves="feed", motor=name, bus=bus.name, address=found.address, spool_radius_m=1.0,
        travel_range=(-1e6, 1e6),
    )  # fmt: skip
    section = Section(
        name="none", length_m=0.1, max_bend_deg=1.0, vertebrae=2, vertebra_thickness_m=0.01, bending_stiffness_Nm2=1.0,
        torsional_stiffness_Nm2=1.0,
    )  # fmt: skip
    return RobotDescription(
        name="motor",
        title="A motor",
        backbone=Backbone(total_length_m=0.1, diameter_m=0.01, mass_per_length_kg_m=0.01),
        sections=(section,),
        motors=(motor,),
        drives=(drive,),
        buses=(bus,),
        teleop=Teleop(bend_rate_deg_s=1.0, bend_acceleration_deg_s2=1.0, loop_rate_Hz=BARE_RATE_Hz),
    )
