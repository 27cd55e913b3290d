"""The driver's stream: what the pilot wants, as commands under the lease, at a steady rate and at once on every change."""

import threading
from collections import Counter
from collections.abc import Callable
from concurrent.futures import Future

import msgspec

from app.console.page_socket import SeatRequest
from app.console.page_state import SeatState
from app.console.pilot import Pilot, Wanted
from app.console.robot_lag import RobotLag
from app.console.seat import Occupant, Seat
from app.link.console_end import ConsoleLink
from app.link.stopping import UNCONFIRMED, Stopping
from cobra.clock import Clock
from cobra.control.realtime import OTHERS_PRIORITY, ask_for_realtime
from cobra.messages import Command, Reply, Request, RobotState

PERIOD_S = 0.02
"""Repetition of unchanged commands: a tenth of their validity."""
ACQUIRE_PERIOD_S = 0.3
GONE = Reply(ok=False, reasons=("the robot process is gone: restart it",))


class Driver:
    """A thread that keeps the lease and sends commands; requests are made from whatever thread asks.

    `link` gives the present link, or None while there is no robot process.
    """

    def __init__(
        self,
        seat: Seat,
        pilot: Pilot,
        link: Callable[[], ConsoleLink | None],
        clock: Clock,
        warn: Callable[[str], None] = lambda text: None,
        sent: Callable[[Wanted, Command], None] = lambda wanted, command: None,
    ) -> None:
        """`warn` tells the operator, in words, of a button that could not do what it asks; `sent` hears every command."""
        self._warn = warn
        self._sent = sent
        self._seat = seat
        self._pilot = pilot
        self._link = link
        self._clock = clock
        self._wake = threading.Event()
        self._done = threading.Event()
        self._lock = threading.Lock()
        self._lease = ""
        self._leased_on: ConsoleLink | None = None
        self._tickets: dict[str, tuple[Occupant, str]] = {}
        """By page: who asks for the controls, and with which ticket they get them."""
        self._epoch = 0
        self._sequence = 0
        self._next_try = 0.0
        self._lag = RobotLag()
        self._stopping = Stopping(self._send_stop, self._latest)
        self.errors: Counter[str] = Counter()
        self._thread = threading.Thread(target=self._run, name="driver", daemon=True)

    def start(self) -> None:
        self._thread.start()

    @property
    def lag_s(self) -> float:
        """Round trip to the robot process [s]."""
        return self._lag.seconds

    def stop(self) -> None:
        """Let go of the controls."""
        self._done.set()
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join(1.0)
        if (link := self._link()) and self._lease:
            link.request(Request(what="release", lease=self._lease))

    def wake(self) -> None:
        """An input changed: send now rather than at the next repetition. Safe from any thread."""
        self._wake.set()

    def halt(self, who: str, reason: str = "") -> Future[bool]:
        """STOP, past every queue. Safe from any thread. Tells whether the robot confirmed it."""
        confirmed = self._stopping.say(who, reason)
        confirmed.add_done_callback(lambda done: None if done.result() else self._warn(f"{UNCONFIRMED}."))
        return confirmed

    def ask(self, request: Request, asker: Occupant | None = None) -> Reply:
        """Make a request under our lease, taking the lease first when it is free. `asker` is None for the console's pad."""
        link = self._link()
        if link is None:
            return GONE
        if request.what == "mark" and asker:
            return link.request(msgspec.structs.replace(request, who=asker.name))
        with self._lock:
            self._forget_lost_lease(link)
            if self._lease and asker and not self._seat.sits(asker.page):
                return _no(self._who_drives(asker))
            refused = None if self._lease else self._acquire(link, asker)
            lease = self._lease
        if refused is not None:
            return refused
        who = asker.name if asker else self._seat.holder
        return link.request(msgspec.structs.replace(request, lease=lease, who=request.who or who))

    def change(self, asker: Occupant, what: SeatRequest, text: str, yes: bool) -> Reply:
        """What somebody at a page wants with the controls; see `app.console.seen.Seat`."""
        match what:
            case "acquire":
                return self._claim(asker)
            case "release":
                return self._release(asker.page)
            case "take":
                return self._take(asker, text)
            case "ask":
                return self._beg(asker)
            case "withdraw":
                return self._withdraw(asker.page)
            case "grant" | "refuse":
                return self._decide(asker, text, give=what == "grant")
            case "console_pad":
                refusal = self._seat.use_pad(asker.page, yes)
                return _no(refusal) if refusal else Reply(ok=True)

    def seat_state(self) -> SeatState:
        occupant = self._seat.occupant
        page = occupant.page if occupant else ""
        return SeatState(shared=self._seat.shared, page=page, console_pad=self._seat.pad)

    def _claim(self, asker: Occupant) -> Reply:
        """Take the controls that nobody has, or one's own from another page."""
        link = self._link()
        if link is None:
            return GONE
        with self._lock:
            self._forget_lost_lease(link)
            if self._lease:
                if self._seat.holder != asker.name:
                    return _no(self._who_drives(asker))
                if self._seat.sits(asker.page):
                    return Reply(ok=True)
                self._let_go(link)
            return self._acquire(link, asker) or Reply(ok=True)

    def _release(self, page: str) -> Reply:
        """Let go of the controls; a page that has none lets go of nothing."""
        link = self._link()
        with self._lock:
            if link and self._lease and self._seat.sits(page):
                self._let_go(link)
        return Reply(ok=True)

    def _take(self, asker: Occupant, reason: str) -> Reply:
        """Take the controls over from whoever has them. That the asker may, the front door has seen to."""
        link = self._link()
        if link is None:
            return GONE
        with self._lock:
            reply = link.request(Request(what="take", who=asker.name, reason=reason))
            if reply.ok:
                self._seat.take(asker)
                self._leased(link, reply)
            return reply

    def _beg(self, asker: Occupant) -> Reply:
        """Ask whoever drives, at whichever console, for the controls."""
        link = self._link()
        if link is None:
            return GONE
        reply = link.request(Request(what="ask", who=asker.name))
        if reply.ok:
            self._tickets[asker.page] = (asker, reply.lease)
        return reply

    def _withdraw(self, page: str) -> Reply:
        """Ask no more."""
        link, (_, ticket) = self._link(), self._tickets.pop(page, (None, ""))
        return link.request(Request(what="withdraw", lease=ticket)) if link and ticket else Reply(ok=True)

    def _decide(self, asker: Occupant, name: str, give: bool) -> Reply:
        """Give the controls to somebody who asks for them, or keep them."""
        link = self._link()
        if link is None or not self._seat.sits(asker.page):
            return _no("only who drives decides this")
        what = "grant" if give else "refuse"
        return link.request(Request(what=what, lease=self._lease, who=asker.name, name=name))

    def vacate(self, page: str) -> None:
        """A page is gone for good, and with it what it held and asked for. May wait for the robot process."""
        self._withdraw(page)
        if not self._seat.shared:
            self._release(page)

    def _run(self) -> None:
        ask_for_realtime(OTHERS_PRIORITY)
        while not self._done.is_set():
            self._wake.wait(PERIOD_S)
            self._wake.clear()
            try:
                self._tick()
            except Exception as error:  # one bad turn must not end the stream; it is counted and shown
                self.errors[f"driver: {error}"] += 1

    def _tick(self) -> None:
        for action in self._pilot.take_actions():
            if action == "stop":
                self.halt(self._seat.holder or self._seat.host, "B on the pad")
            else:
                what = self._locking() if action == "lock" else action
                threading.Thread(target=self._ask_for_button, args=(Request(what=what),), daemon=True).start()
        link = self._link()
        state = link.latest if link else None
        if link is None or state is None:
            return
        self._pilot.robot_phase(state.phase, state.motion.poses)
        with self._lock:
            self._forget_lost_lease(link)
            if not self._lease:
                self._regain(link, state)
                return
            self._sequence += 1
            lease, epoch, sequence = self._lease, self._epoch, self._sequence
        now = self._clock.now()
        self._lag.taken(state.accepted, link.arrived)
        self._lag.sent(sequence, now)
        wanted = self._pilot.command(now, self._lag.seconds)
        command = Command(
            lease=lease,
            epoch=epoch,
            sequence=sequence,
            echo=state.stamp,
            mode=wanted.selection.mode,
            held=wanted.held,
            intent=wanted.intent,
            input_stamp=wanted.input_stamp,
            ended=wanted.ended,
        )
        link.send(command)
        self._sent(wanted, command)

    def _send_stop(self, data: bytes) -> None:
        if link := self._link():
            link.send_stop(data)

    def _latest(self) -> RobotState | None:
        link = self._link()
        return link.latest if link else None

    def _locking(self) -> str:
        """One button locks and unlocks, whichever the robot is not doing."""
        link = self._link()
        status = link.latest.lock.status if link and link.latest else "none"
        return "unlock" if status in ("locking", "rigid") else "lock"

    def _ask_for_button(self, request: Request) -> None:
        reply = self.ask(request)
        if not reply.ok:
            self._warn(f"{request.what} was refused: {'; '.join(reply.reasons)}")

    def _regain(self, link: ConsoleLink, state: RobotState) -> None:
        """Take the controls that are ours anyway: this console's only person's, or those that were just given to us."""
        if state.lease.fresh or self._clock.now() < self._next_try:
            return
        given = [(asker, ticket) for asker, ticket in self._tickets.values() if asker.name == state.lease.kept_for]
        # After a STOP only clearing it takes the controls again.
        if given or (self._seat.shared and state.phase != "stopped"):
            self._next_try = self._clock.now() + ACQUIRE_PERIOD_S
            self._acquire(link, *(given[-1] if given else (None, "")))

    def _forget_lost_lease(self, link: ConsoleLink) -> None:
        """A stop or somebody else ended our lease, or the robot process that gave it is gone."""
        epoch = link.latest.epoch if link.latest else 0
        if self._lease and (link is not self._leased_on or epoch > self._epoch):
            self._lease = ""
            self._seat.leave()

    def _acquire(self, link: ConsoleLink, asker: Occupant | None, ticket: str = "") -> Reply | None:
        """Take the lease if it is free; returns the refusal, or None when we have it."""
        if asker is None and not self._seat.shared:
            return _no("nobody drives: take the controls on a page first")
        who = asker.name if asker and not self._seat.shared else self._seat.host
        reply = link.request(Request(what="acquire", who=who, lease=ticket))
        if not reply.ok:
            return reply
        if asker is not None:
            self._seat.take(asker)
            self._tickets.pop(asker.page, None)
        self._leased(link, reply)
        return None

    def _leased(self, link: ConsoleLink, reply: Reply) -> None:
        self._lease, self._epoch, self._sequence = reply.lease, reply.epoch, 0
        self._leased_on = link

    def _let_go(self, link: ConsoleLink) -> None:
        lease, self._lease = self._lease, ""
        link.request(Request(what="release", lease=lease, who=self._seat.holder))
        self._seat.leave()

    def _who_drives(self, asker: Occupant) -> str:
        if self._seat.holder == asker.name:
            return "you drive from another page: take the controls here first"
        return f"{self._seat.holder} drives: ask for the controls"


def _no(why: str) -> Reply:
    return Reply(ok=False, reasons=(why,))
