"""All CiA 402 drives of one CAN channel: cyclic synchronous position, one SYNC a tick.

A tick is RPDOs with the targets, then SYNC, at which all drives take theirs together and answer with TPDO 1. The controller's
heartbeat is sent by the tick, so that it stops when the loop does: the drives then stop and hold by themselves. Angles,
velocities and currents are those of the output shaft, in the drive's own positive direction.
"""

from collections import Counter
from itertools import cycle
from typing import Any, Final

import can
import numpy as np

from cobra.clock import Clock
from cobra.description import Bus, RobotDescription
from cobra.motors.bus import BusError, Feedback, Floats
from cobra.motors.bus_load import channel_load, whole_milliseconds
from cobra.motors.channel import Channel
from cobra.motors.channel_bus import ChannelBus, reply_window_s
from cobra.motors.cia402_frames import (
    DISABLE_VOLTAGE,
    ENABLE_OPERATION,
    HEARTBEAT,
    MASTER_NODE,
    NMT_OPERATIONAL,
    QUICK_STOP,
    RPDO1,
    SYNC,
    TARGETS,
    TEMPERATURE,
    VOLTAGE,
    State,
    towards_operation,
)
from cobra.motors.cia402_link import Cia402Link
from cobra.motors.cia402_network import CanopenChannel

HEARTBEAT_PERIOD_S: Final = 0.05
STALL_S: Final = 0.15
"""Without a heartbeat for so long, which is under what the drives wait for."""
SILENT_TICKS: Final = 5
"""As for RMD: then nothing is commanded until the drives are enabled again."""
STATE_TIMEOUT_S: Final = 1.0
"""To reach a state; a brake or the search for the rotor takes some tenths of a second."""
STEP_S: Final = 0.005
_INT32 = 2**31 - 1


class Cia402Bus(ChannelBus):
    """`MotorBus` for the CiA 402 drives of one channel; entries are in the order of `indices`."""

    def __init__(self, description: RobotDescription, bus: Bus, clock: Clock, options: dict[str, Any]) -> None:
        self.indices = tuple(i for i, drive in enumerate(description.drives) if drive.bus == bus.name)
        self._clock = clock
        count: Counter[str] = Counter()
        self._channel = Channel(bus, clock, options, count)
        super().__init__(self._channel, count)
        self._network = CanopenChannel(self._channel)
        drives = [description.drives[i] for i in self.indices]
        self._drives = [Cia402Link(drive, description.motor_of(drive), self._network) for drive in drives]
        self._period_ms = whole_milliseconds(description.teleop.loop_rate_Hz)
        load = channel_load(description, bus)
        period_s = self._period_ms / 1000.0
        self.reply_timeout_s = reply_window_s(load.wire_time_s, 0.9 * period_s, period_s)
        n = len(drives)
        self._per_rad = np.array([link.scale.increments_per_rad for link in self._drives])
        self._amperes = np.array([link.scale.amperes_per_permille for link in self._drives])
        self._missed = np.zeros(n, dtype=np.int64)
        self._valid = np.zeros(n, dtype=bool)
        self._enabled = False
        self._silent = False
        self._beat_s = -np.inf
        self._asked_s = 0.0
        self._slow_polls = load.slow_polls
        self._slow_credit = 0.0
        self._poll_cycle = cycle([(link, key) for link in self._drives for key in (VOLTAGE, TEMPERATURE)])
        self._sync = _message(SYNC, b"")
        self._heartbeat = _message(HEARTBEAT + MASTER_NODE, bytes([NMT_OPERATIONAL]))
        self._targets = [_message(RPDO1 + link.address, bytes(TARGETS.size)) for link in self._drives]

    # -- life -----------------------------------------------------------------------------------------------------

    def open(self) -> None:
        """Open the channel and set up the drives; what is wrong with them is told by `enable`. Raises BusError."""
        self._channel.open()
        try:
            self._channel.purge()
            self._configure()
        except BusError:
            self._channel.close()
            raise

    def close(self) -> None:
        """Without the controller's heartbeat the drives stop, and hold."""
        self._enabled = False
        self._channel.close()

    def enable(self) -> tuple[str, ...]:
        """Purge, set up who needs it, clear faults, and lead all drives to `operation enabled`, standing where they are.

        Returns what prevents it, in words. Raises BusError: the channel is gone.
        """
        self._enabled = self._silent = False
        self._channel.purge()
        self._channel.interrupted = False
        for link in self._drives:
            link.forget_errors()
        reasons = self._configure()
        if not reasons:
            reasons = self._lead_to("operation enabled", towards_operation)
        reasons += [f"{self._who(link)}: {link.fault}" for link in self._drives if not reasons and link.fault]
        self._enabled = not reasons
        return tuple(reasons)

    def refuse_setpoints(self) -> None:
        """Only read from now on, until enabled."""
        self._enabled = False

    def disable(self) -> None:
        """Torque off. Raises BusError."""
        self.refuse_setpoints()
        for reason in self._lead_to("switch on disabled", lambda _: DISABLE_VOLTAGE):
            self._count[f"not switched off: {reason}"] += 1

    def hold(self) -> None:
        """Quick stop: they slow down and stay, with torque. Raises BusError."""
        self.refuse_setpoints()
        standing = [link for link in self._drives if link.state in ("operation enabled", "quick stop active")]
        if standing:
            self._lead_to("quick stop active", lambda _: QUICK_STOP, standing)

    # -- the tick -------------------------------------------------------------------------------------------------

    def burst(self, angles: Floats | None) -> None:
        """The sending half. Only enabled drives get targets, and only finite ones."""
        self._channel.check_open()
        if self._channel.interrupted:
            self._channel.interrupted = False
            self._distrust("its bus was gone: arm again")
        self._channel.drain(self._network.take)
        if angles is not None and not self._enabled:
            self._count["setpoints while not enabled"] += 1
        elif angles is not None and self._clock.now() - self._beat_s > STALL_S:
            # The drives may have stopped by themselves: a target now would lead them back. First see how they stand.
            self._count["setpoint withheld after a stall"] += 1
        elif angles is not None:
            self._command(angles)
        self._ask()

    def gather(self) -> None:
        """Take all answers; what they say is `told`. Raises BusError."""
        self._valid = np.zeros(len(self._drives), dtype=bool)
        deadline = self._asked_s + self.reply_timeout_s
        self._network.read_until(lambda: all(link.answered for link in self._drives), deadline)
        self._valid = np.array([link.answered for link in self._drives], dtype=bool)

    def told(self) -> Feedback:
        """What was gathered last. Raises BusError."""
        valid = self._valid
        self._missed = np.where(valid, 0, self._missed + 1)
        if valid.any():
            self._silent = False
        elif self._channel.told_off or self._missed.min() == SILENT_TICKS:
            self._channel.check_off()
            self._silent = True
            if self._enabled:
                self._distrust(
                    f"nobody answers on {self._channel.label}: check power, cable and adapter, then arm again"
                )
        return self._feedback(valid)

    def _command(self, angles: Floats) -> None:
        for link, angle, per_rad, message in zip(
            self._drives, angles.tolist(), self._per_rad.tolist(), self._targets, strict=True
        ):
            if link.state != "operation enabled":
                # It must not be led back by the next setpoint: whatever took it out is looked at first.
                link.lost = link.lost or f"it is in the state '{link.state}': arm again"
                word, target = QUICK_STOP, link.increments or 0
            elif not np.isfinite(angle):
                self._count["setpoint not finite"] += 1
                continue
            else:
                word, target = ENABLE_OPERATION, round(max(-_INT32, min(_INT32, angle * per_rad)))
            message.data[:] = TARGETS.pack(word, target)
            self._send(message)

    def _ask(self) -> None:
        """SYNC, the heartbeat when it is due, and a read now and then."""
        now = self._asked_s = self._clock.now()
        for link in self._drives:
            link.answered = False
        self._send(self._sync)
        if now - self._beat_s >= HEARTBEAT_PERIOD_S:
            self._beat_s = now
            self._send(self._heartbeat)
        self._slow_credit += 0.0 if self._silent else self._slow_polls
        if self._slow_credit >= 1.0:
            self._slow_credit -= 1.0
            link, key = next(self._poll_cycle)
            if key in link.polled:
                self._network.send_message(*link.poll(key))

    def _send(self, message: can.Message) -> None:
        self._channel.send(message, self._clock.now() + self.reply_timeout_s)

    def _feedback(self, valid: Any) -> Feedback:
        links = self._drives
        increments = np.array([np.nan if link.increments is None else link.increments for link in links])
        unknown = np.isnan(increments)
        return Feedback(
            angle=increments / self._per_rad,
            velocity=np.array([link.velocity_rad_s for link in links]),
            current=np.where(unknown, np.nan, np.array([link.permille for link in links]) * self._amperes),
            temperature=np.array([link.polled.get(TEMPERATURE, np.nan) for link in links]),
            voltage=np.array([link.polled.get(VOLTAGE, np.nan) for link in links]),
            age=self._clock.now() - np.array([link.heard_s for link in links]),
            valid=valid,
            missed=self._missed,
            faults=tuple(link.fault for link in links),
        )

    # -- leading the drives -----------------------------------------------------------------------------------------

    def _configure(self) -> list[str]:
        """Set up every drive that is not; why one cannot be, in words."""
        reasons = []
        for link in self._drives:
            if not link.configured and (reason := link.configure(self._period_ms)):
                reasons.append(f"{self._who(link)} {reason}")
        self._beat_s = -np.inf
        self._ask()
        self.collect()
        return reasons

    def _lead_to(self, wanted: State, word_in: Any, links: list[Cia402Link] | None = None) -> list[str]:
        """Send controlwords until all are in the wanted state; why one is not, in words."""
        links = self._drives if links is None else links
        deadline = self._clock.now() + STATE_TIMEOUT_S
        while True:
            for link in links:
                message = self._targets[self._drives.index(link)]
                message.data[:] = TARGETS.pack(word_in(link.state), link.increments or 0)
                self._send(message)
            self._ask()
            self.collect()
            late = [link for link in links if link.state != wanted or not link.answered]
            now = self._clock.now()
            if not late or now >= deadline:
                break
            self._clock.sleep_until(min(deadline, now + STEP_S))
        return [f"{self._who(link)} stays in the state '{link.state}'{_because(link.fault)}" for link in late]

    def _distrust(self, why: str) -> None:
        self._count["channel lost"] += 1
        self._enabled = False
        for link in self._drives:
            link.lost = link.lost or why

    def _who(self, link: Cia402Link) -> str:
        return f"drive {link.name!r} (node {link.address} on {self._channel.label})"


def _because(fault: str) -> str:
    return f": {fault}" if fault else ": check its enable input and its power"


def _message(arbitration_id: int, data: bytes) -> can.Message:
    return can.Message(arbitration_id=arbitration_id, is_extended_id=False, is_rx=False, data=data)
