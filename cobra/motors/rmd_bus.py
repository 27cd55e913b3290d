"""All RMD drives of one CAN channel behind one burst-then-collect exchange.

Angles, velocities and currents are those of the output shaft, in the drive's own positive direction: the description's
`direction` is part of `Drive.travel_per_rad` and is applied once, where angles become travel.
"""

import contextlib
from collections import Counter, deque
from collections.abc import Set
from itertools import cycle
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cobra.clock import Clock
from cobra.description import Bus, RobotDescription
from cobra.motors.bus import HOME_AGAIN, BusError, Feedback, Floats
from cobra.motors.bus_load import channel_load
from cobra.motors.channel_bus import WAIT, ChannelBus, reply_window_s
from cobra.motors.multi_turn import RESTART_S, MultiTurn
from cobra.motors.rmd import RMD_V1, RMD_V3, Request, decode
from cobra.motors.rmd_channel import Incoming, Outgoing, RmdChannel
from cobra.motors.rmd_link import RmdLink

WATCHDOG_MS = 500
"""v3: without a request for so long the drive cuts its output. Well above a garbage collection, well below a person."""
ATTEMPTS = 3
"""How often a drive is asked what must be known: arming, holding, switching off."""
MAX_URGENT_POLLS = 2
"""Angles in doubt that are read in one tick on top of the plan."""
SILENT_TICKS = 5
"""When no drive of the channel answered for so long, nothing is commanded until it is enabled again: what an adapter that
does not send still keeps must stay a few setpoints of a standing robot."""

MOTION_FIELDS = 5  # command, temperature, current, speed, position
_INT32 = 2**31 - 1


class RmdBus(ChannelBus):
    """`MotorBus` for the RMD drives of one channel; entries are in the order of `indices`.

    v1: multi-turn angle from the encoder in every reply, anchored by 0x92. v3: 0x92 of as many drives a tick as fit.
    """

    def __init__(self, description: RobotDescription, bus: Bus, clock: Clock, options: dict[str, Any]) -> None:
        self.indices = tuple(i for i, drive in enumerate(description.drives) if drive.bus == bus.name)
        """Position of each drive in the description."""
        drives = [description.drives[i] for i in self.indices]
        self._drives = [RmdLink(drive, description.motor_of(drive)) for drive in drives]
        self._where = bus.name
        self._clock = clock
        count: Counter[str] = Counter()
        self._channel = RmdChannel(bus, clock, options, count)
        super().__init__(self._channel, count)
        self._channel.welcome |= {link.alarm_key for link in self._drives}
        self._load = channel_load(description, bus)
        period_s = 1.0 / description.teleop.loop_rate_Hz
        # A bus that is busy for most of a tick may run into the next one now and then; the loop keeps the rate.
        most_s = (0.9 if self._load.wire_time_s < WAIT * period_s else 1.25) * period_s
        self.reply_timeout_s = reply_window_s(self._load.wire_time_s, most_s, period_s)
        self._enabled = False
        self._watched = False
        self._silent = False

        n = len(self._drives)
        ratio = np.array([link.shaft_ratio for link in self._drives])
        self._counts_per_rad = ratio * np.degrees(1.0) * 100.0
        self._rad_per_degree = np.radians(1.0) / ratio
        self._amperes = np.array([link.motor.current_per_count_A for link in self._drives])
        self._coarse = np.array([link.coarse for link in self._drives], dtype=bool)
        per_turn = np.array([2.0**link.motor.encoder_bits for link in self._drives])
        full_speed = ratio * np.array([link.motor.max_speed_rad_s for link in self._drives])
        self._turns = MultiTurn(per_turn, np.degrees(full_speed))
        self._motion: list[tuple[int, ...]] = [(0,) * MOTION_FIELDS] * n
        self._columns: Floats = np.zeros((n, MOTION_FIELDS))
        self._motion_time: Floats = np.full(n, np.nan)
        self._seen = np.zeros(n, dtype=bool)
        self._angle_deg: Floats = np.full(n, np.nan)
        self._angle_time: Floats = np.full(n, -np.inf)
        self._voltage: Floats = np.full(n, np.nan)
        self._missed = np.zeros(n, dtype=np.int64)
        self._sent: list[Outgoing] = []
        self._gathered: tuple[list[Outgoing], dict[int, Incoming]] = ([], {})
        self._asked: list[Outgoing] = []
        self._angle_of = {link.angle.key: i for i, link in enumerate(self._drives)}
        self._status_of = {link.status.key: i for i, link in enumerate(self._drives)}
        self._angle_cycle = cycle([link.angle for link in self._drives if link.coarse])
        # The turn count of a v1 drive is checked as often as its status is read.
        slow = [
            poll for link in self._drives for poll in ((link.status,) if link.coarse else (link.status, link.angle))
        ]
        self._slow_cycle = cycle(slow)
        self._slow_credit = 0.0
        self._urgent: deque[int] = deque()

    @property
    def notes(self) -> tuple[str, ...]:
        """What people should know about these drives."""
        bare = [link.name for link in self._drives if not link.coarse]
        if not bare:
            return ()
        return (
            f"bus {self._where!r}: rmd-v1 drives have no watchdog ({', '.join(bare)}): "
            "they hold their last setpoint when the controller is gone",
        )

    # -- life -----------------------------------------------------------------------------------------------------

    def open(self) -> None:
        """Open the channel and find the drives; who does not answer is told by `enable`. Raises BusError."""
        self._channel.open()
        try:
            self._channel.purge()
            self._find()
        except BusError:
            self._channel.close()
            raise

    def close(self) -> None:
        """The drives keep what they were last told: the watchdog of those that have one is taken off."""
        self._enabled = False
        if self._watched:
            with contextlib.suppress(BusError):  # where the channel is gone, the watchdog does its work
                self._set_watchdogs([link for link in self._drives if link.coarse], 0)
        self._channel.close()

    def enable(self) -> tuple[str, ...]:
        """Purge, probe every drive, clear its errors, arm the watchdogs. Returns what prevents it, in words.

        No drive is told to run (0x88): it would resume a motion from before a stop. The first setpoint is what moves it.

        Raises:
            BusError: the channel is gone.
        """
        self._enabled = self._silent = False
        self._channel.purge()
        self._channel.interrupted = False
        self._channel.noted.clear()
        for link in self._drives:
            link.lost = ""
        # The first command after a watchdog has cut the output is only echoed.
        self._ask([link.status for link in self._drives if link.coarse])
        reasons = self._find()
        if clearable := [link for link in self._drives if link.errors and not link.coarse]:
            self._channel.transact([link.request("clear_errors") for link in clearable], self.reply_timeout_s)
            reasons = self._find()
        if not reasons:
            reasons = self._arm_watchdogs()
        self._enabled = not reasons
        return tuple(reasons)

    def refuse_setpoints(self) -> None:
        """Only read from now on, until enabled."""
        self._enabled = False

    def disable(self) -> None:
        """Torque off (0x80). Raises BusError."""
        self.refuse_setpoints()
        self._tell_all("off")

    def hold(self) -> None:
        """Stop with torque (0x81). Raises BusError."""
        self._tell_all("stop")

    # -- the tick -------------------------------------------------------------------------------------------------

    def burst(self, angles: Floats | None) -> None:
        """The sending half. Only enabled drives are commanded, and only with finite setpoints; others are read."""
        self._channel.check_open()
        if self._channel.interrupted:
            self._channel.interrupted = False
            self._distrust("its bus was gone: arm again")
        for key in self._channel.discard_late():
            for link in self._drives:
                link.unanswered.pop(key, None)
        self._sent = self._reads() if angles is None else self._setpoints(angles)
        # One question a tick until somebody answers: nothing piles up in an adapter that does not send.
        self._asked = [next(self._slow_cycle)] if self._silent else self._unambiguous(self._sent, self._polls())
        self._channel.send_burst(self._asked, self.reply_timeout_s)

    def gather(self) -> None:
        """Take the replies; what they say is `told`. Raises BusError."""
        self._gathered = self._sent, {}
        replies = self._channel.collect()
        self._gathered = self._sent, replies
        self._note_answers(replies)

    def told(self) -> Feedback:
        """What the replies say that were gathered last. Raises BusError."""
        sent, replies = self._gathered
        valid = self._take(sent, replies)
        self._missed = np.where(valid, 0, self._missed + 1)
        if replies:
            self._silent = False
        elif self._channel.told_off:
            self._channel.check_off()
        elif not self._silent and self._missed.min() >= SILENT_TICKS:
            self._channel.check_off()
            self._silent = True
            if self._enabled:
                self._distrust(
                    f"nobody answers on {self._channel.label}: check power, cable and adapter, then arm again"
                )
        return self._feedback(valid)

    def _unambiguous(self, wanted: list[Outgoing], polls: list[Outgoing]) -> list[Outgoing]:
        """RMD has no sequence numbers: a reply that comes ticks late must not be taken for the newest one's."""
        if not any(link.unanswered for link in self._drives):
            return [*wanted, *polls]
        burst = {}
        for link, request in zip(self._drives, wanted, strict=True):
            chosen = link.unambiguous(request)
            burst[chosen.key] = chosen
        waiting = set().union(*(link.unanswered for link in self._drives))
        return [*burst.values(), *(poll for poll in polls if poll.key not in waiting and poll.key not in burst)]

    def _note_answers(self, replies: dict[int, Incoming]) -> None:
        answered = replies.keys()
        if len(answered) == len(self._asked) and not any(link.unanswered for link in self._drives):
            return
        for link in self._drives:
            asked = [request.key for request in self._asked if request.key >> 8 == link.status.key >> 8]
            link.note_answers(asked, answered)

    def _distrust(self, why: str) -> None:
        """Nothing is commanded until the drives were probed and enabled again."""
        self._count["channel lost"] += 1
        self._enabled = False
        for link in self._drives:
            link.lost = link.lost or why

    def _reads(self) -> list[Outgoing]:
        return [link.motion for link in self._drives]

    def _setpoints(self, angles: Floats) -> list[Outgoing]:
        if not self._enabled:
            self._count["setpoints while not enabled"] += 1
            return self._reads()
        finite = np.isfinite(angles)
        counts = np.where(finite, np.clip(np.rint(angles * self._counts_per_rad), -_INT32, _INT32), 0).astype(int)
        sent = []
        for link, count, usable in zip(self._drives, counts.tolist(), finite.tolist(), strict=True):
            if usable:
                link.setpoint.message.data[4:8] = count.to_bytes(4, "little", signed=True)
                sent.append(link.setpoint)
            else:
                self._count["setpoint not finite"] += 1
                sent.append(link.motion)
        return sent

    def _polls(self) -> list[Outgoing]:
        """Reads of this tick beside the setpoints, none twice."""
        polls = [next(self._angle_cycle) for _ in range(self._load.angle_polls)]
        self._slow_credit += self._load.slow_polls
        if self._slow_credit >= 1.0:
            self._slow_credit -= 1.0
            polls.append(next(self._slow_cycle))
        if not self._urgent:
            self._urgent.extend(np.flatnonzero(self._turns.doubtful & ~self._coarse).tolist())
        for _ in range(min(MAX_URGENT_POLLS, len(self._urgent))):
            polls.append(self._drives[self._urgent.popleft()].angle)
        return list({poll.key: poll for poll in polls}.values())

    def _take(self, sent: list[Outgoing], replies: dict[int, Incoming]) -> NDArray[np.bool_]:
        """Take motion, angles and status from the replies; True for every drive whose entry of `sent` was answered."""
        if self._channel.noted:
            replies = self._without_alarmed(replies)
        valid = np.zeros(len(self._drives), dtype=bool)
        # v3 differs in its last field only, whole degrees, which is not used.
        unpack = RMD_V1.entries["status_2"].reply.struct.unpack
        for i, request in enumerate(sent):
            # Where a read stands in for a setpoint, it tells the same.
            reply = replies.get(request.key) or replies.get(self._drives[i].motion.key)
            if reply is not None:
                self._motion[i] = unpack(reply.data)
                self._motion_time[i] = reply.time_s
                valid[i] = True
        self._seen |= valid
        columns = self._columns = np.array(self._motion, dtype=float)
        self._turns.advance(columns[:, 4], columns[:, 3], np.where(self._coarse, np.nan, self._motion_time))
        for link, jump_deg in zip(self._drives, self._turns.jump_deg.tolist(), strict=True):
            if jump_deg:
                self._jumped(link, jump_deg / link.shaft_ratio)
        for key, reply in replies.items():
            if key in self._angle_of:
                self._take_angle(self._angle_of[key], reply, valid)
            elif key in self._status_of:
                self._take_status(self._status_of[key], reply)
        return valid

    def _take_angle(self, i: int, reply: Incoming, valid: NDArray[np.bool_]) -> None:
        link = self._drives[i]
        angle = decode(link.dialect, "multi_turn_angle", reply.data)["angle_deg"]
        if not link.coarse:
            # Comparable only with an encoder reading of the same moment.
            if valid[i] and (turns := self._turns.anchor(i, angle)):
                self._jumped(link, turns * 360.0 / link.shaft_ratio)
            return
        gap = reply.time_s - self._angle_time[i]
        jump = angle - self._angle_deg[i]
        # Twice the distance possible at full speed and some for the delay of the reply; after a silence, what is left of
        # the way to its last setpoint.
        if abs(jump) > (20.0 if gap > RESTART_S else 2.0 * link.speed_limit_dps * gap + 10.0):
            self._jumped(link, jump)
        self._angle_deg[i] = angle
        self._angle_time[i] = reply.time_s

    def _jumped(self, link: RmdLink, degrees: float) -> None:
        self._count["angle jumped"] += 1
        link.lost = f"its angle jumped by {degrees:+.1f} degrees (power lost, or encoder slipped): {HOME_AGAIN}"

    def _take_status(self, i: int, reply: Incoming) -> None:
        link = self._drives[i]
        status = decode(link.dialect, "status_1", reply.data)
        self._voltage[i] = status["voltage_V"]
        link.take_status(status)

    def _without_alarmed(self, replies: dict[int, Incoming]) -> dict[int, Incoming]:
        """Note the alarms. Such a drive answers first with an echo, and must not be moved before it is enabled again."""
        alarmed = {link.alarm_key >> 8: link for link in self._drives if link.alarm_key in self._channel.noted}
        self._channel.noted.clear()
        for link in alarmed.values():
            self._count["watchdog alarm"] += 1
            link.lost = "its watchdog has cut the output: enable again"
        self._enabled = False
        return {key: reply for key, reply in replies.items() if key >> 8 not in alarmed}

    def _feedback(self, valid: NDArray[np.bool_]) -> Feedback:
        columns = np.where(self._seen[:, None], self._columns, np.nan)
        degrees = np.where(self._coarse, self._angle_deg, self._turns.angle_deg)
        time_s = np.where(self._coarse, self._angle_time, np.where(np.isnan(degrees), -np.inf, self._motion_time))
        return Feedback(
            angle=degrees * self._rad_per_degree,
            velocity=columns[:, 3] * self._rad_per_degree,
            current=columns[:, 2] * self._amperes,
            temperature=columns[:, 1],
            voltage=self._voltage.copy(),
            age=self._clock.now() - time_s,
            valid=valid,
            missed=self._missed,
            faults=tuple(link.fault for link in self._drives),
        )

    # -- asking until answered ------------------------------------------------------------------------------------

    def _ask(self, requests: list[Outgoing]) -> dict[int, Incoming]:
        """Replies by key; who does not answer is asked again."""
        replies: dict[int, Incoming] = {}
        for _ in range(ATTEMPTS):
            missing = [request for request in requests if request.key not in replies]
            if not missing:
                break
            replies |= self._channel.transact(missing, self.reply_timeout_s)
        return replies

    def _tell_all(self, request: Request) -> None:
        told = self._ask([link.request(request) for link in self._drives])
        if silent := len(self._drives) - len(told):
            self._count[f"no answer to {request}"] += silent

    def _find(self) -> list[str]:
        """Read status, motion and angle of every drive. What prevents arming, in words."""
        foreign = {link.foreign_status_key for link in self._drives} - self._status_of.keys()
        self._channel.welcome |= foreign
        replies = self._ask([link.status for link in self._drives])
        motions = [link.motion for link in self._drives]
        here = [link for link in self._drives if link.status.key in replies]
        replies |= self._ask([link.motion for link in here]) | self._ask([link.angle for link in here])
        self._channel.welcome -= foreign
        strangers = self._channel.noted & foreign
        self._channel.noted -= foreign
        self._take(motions, replies)
        return [reason for link in self._drives if (reason := self._prevents(link, replies.keys(), strangers))]

    def _prevents(self, link: RmdLink, answered: Set[int], strangers: Set[int]) -> str:
        who = f"drive {link.name!r} (address {link.address} on {self._channel.label})"
        if link.foreign_status_key in strangers:
            spoken, described = (RMD_V1 if link.coarse else RMD_V3).name, link.dialect.name
            return f"{who} speaks {spoken}, described is {described}: correct motors.protocol of {link.motor.name!r}"
        if link.status.key not in answered:
            return f"{who} does not answer: check its power, address, bit rate and the bus termination"
        if not {link.motion.key, link.angle.key} <= answered:
            return f"{who} answers, but does not tell its angle: switch it off and on"
        return f"{who}: {link.fault}" if link.fault else ""

    def _arm_watchdogs(self) -> list[str]:
        """v3: direct tracking instead of a trapezoid per setpoint, and the watchdog, set and read back."""
        links = [link for link in self._drives if link.coarse]
        for index in (0, 1):  # planning acceleration and deceleration; written only if needed, since it wears flash
            asked = {link.request("read_acceleration", index=index).key: link for link in links}
            told = self._ask([link.request("read_acceleration", index=index) for link in links])
            planning = [
                asked[key]
                for key, reply in told.items()
                if decode(RMD_V3, "read_acceleration", reply.data)["acceleration_dps2"] != 0
            ]
            self._ask([link.request("write_acceleration", index=index, acceleration_dps2=0) for link in planning])
        return self._set_watchdogs(links, WATCHDOG_MS)

    def _set_watchdogs(self, links: list[RmdLink], timeout_ms: int) -> list[str]:
        requests = {link.name: link.request("watchdog", timeout_ms=timeout_ms) for link in links}
        told = self._ask(list(requests.values()))
        self._watched = bool(links) and timeout_ms > 0
        return [
            f"drive {name!r} did not take its watchdog of {timeout_ms} ms: its firmware may lack 0xB3"
            for name, request in requests.items()
            if request.key not in told or decode(RMD_V3, "watchdog", told[request.key].data)["timeout_ms"] != timeout_ms
        ]
