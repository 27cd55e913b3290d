"""What has arrived since the last tick, in the order of its weight: STOP, commands and fed lengths, requests."""

from collections import Counter, deque
from collections.abc import Callable

import msgspec

from cobra.control.authority import Authority
from cobra.control.inbox import Inbox
from cobra.control.motion import Motion
from cobra.control.requests import Requests
from cobra.control.supervisor import Drive, Health, Supervisor
from cobra.control.witness import Witness
from cobra.messages import Command, Event, HandFedLength, Stop, decode

REMEMBERED_STOPS = 8


class Arrivals:
    """Empties the inbox. `drive` is the driver's newest accepted command; None while nobody drives.

    `stops` are the marks of the newest STOPs; each is obeyed once, however often it is said.

    What cannot be read or obeyed is counted in `dropped`, by reason.
    """

    def __init__(
        self,
        inbox: Inbox,
        authority: Authority,
        supervisor: Supervisor,
        motion: Motion,
        announce: Callable[[Event], None],
        witness: Witness,
        dropped: Counter[str],
    ) -> None:
        self.drive: Drive | None = None
        self.dropped = dropped
        self.stops: deque[str] = deque(maxlen=REMEMBERED_STOPS)
        self.requests = Requests(authority, self.lose_driver, announce)
        self._inbox = inbox
        self._authority = authority
        self._supervisor = supervisor
        self._motion = motion
        self._announce = announce
        self._witness = witness

    def lose_driver(self) -> None:
        """What the driver said last does not count any more."""
        self.drive = None

    def revoke(self) -> None:
        """Nobody drives from now on."""
        self._authority.revoke()
        self.drive = None

    def take_stops(self, now_s: float) -> None:
        while self._inbox.stops:
            data = self._inbox.stops.popleft()
            try:
                stop = decode(data, Stop)
            except msgspec.MsgspecError:
                # A stop that cannot be read is still a stop.
                self.dropped["malformed stop (obeyed)"] += 1
                stop = Stop(who="somebody", reason="the message was damaged")
            if stop.press in self.stops:
                continue
            if stop.press:
                self.stops.append(stop.press)
            self.revoke()
            self._supervisor.stop(stop.who, stop.reason)
            self._announce(Event(stamp=now_s, level="alarm", text=self._supervisor.cause))

    def take_commands(self, now_s: float) -> None:
        while self._inbox.commands:
            self._take_command(self._inbox.commands.popleft(), now_s)
        while self._inbox.lengths:
            self._take_length(self._inbox.lengths.popleft(), now_s)

    def take_requests(self, now_s: float, health: Health) -> None:
        while self._inbox.requests:
            asked = self._inbox.requests.popleft()
            reply = self.requests.answer(asked.data, now_s, health)
            asked.answer(reply)
            self._witness.request(asked.data, reply, now_s)

    def choose_mode(self) -> None:
        """Take the mode of the newest command; while driving another one ends the drive."""
        if self.drive is None:
            return
        command = self.drive.command
        if self._supervisor.phase != "driving":
            self._motion.choose(command.mode, command.intent.pose)
        elif command.held and (command.mode, command.intent.pose) != (self._motion.mode, self._motion.pose):
            self._supervisor.hold("the mode was changed while driving. Let go, centre, press again.")

    def _take_command(self, data: bytes, now_s: float) -> None:
        try:
            command = decode(data, Command)
        except msgspec.MsgspecError:
            self.dropped["malformed message"] += 1
            return
        if command.mode in self._motion.names:
            dropped = self._authority.accept(command, now_s)
        else:
            dropped = "unknown mode"
            self.dropped[dropped] += 1
        if dropped is None:
            self.drive = Drive(command, now_s)
        self._witness.command(command, dropped, now_s)

    def _take_length(self, data: bytes, now_s: float) -> None:
        try:
            length = decode(data, HandFedLength)
        except msgspec.MsgspecError:
            self.dropped["malformed length"] += 1
            return
        if self._motion.hand_feed.measured(length.length_m, now_s):
            self.dropped["length out of range or not asked for"] += 1
