"""The driver's stream: what the pilot wants, as commands under the lease, at a steady rate and at once on every change."""

import threading
from collections import Counter
from collections.abc import Callable

from app.console.pilot import Pilot, Wanted
from app.link import ConsoleLink
from cobra.clock import Clock
from cobra.control.realtime import OTHERS_PRIORITY, ask_for_realtime
from cobra.messages import Command, Reply, Request, Stop

PERIOD_S = 0.02
"""Repetition of unchanged commands: a tenth of their validity."""
ACQUIRE_PERIOD_S = 0.3


class Driver:
    """A thread that keeps the lease and sends commands; requests are made from whatever thread asks.

    `link` gives the present link, or None while there is no robot process.
    """

    def __init__(
        self,
        who: str,
        pilot: Pilot,
        link: Callable[[], ConsoleLink | None],
        clock: Clock,
        warn: Callable[[str], None] = lambda text: None,
        sent: Callable[[Wanted, Command], None] = lambda wanted, command: None,
    ) -> None:
        """`warn` tells the operator, in words, of a button that could not do what it asks; `sent` hears every command."""
        self._warn = warn
        self._sent = sent
        self._who = who
        self._pilot = pilot
        self._link = link
        self._clock = clock
        self._wake = threading.Event()
        self._done = threading.Event()
        self._lock = threading.Lock()
        self._lease = ""
        self._leased_on: ConsoleLink | None = None
        self._epoch = 0
        self._sequence = 0
        self._next_try = 0.0
        self.errors: Counter[str] = Counter()
        self._thread = threading.Thread(target=self._run, name="driver", daemon=True)

    def start(self) -> None:
        self._thread.start()

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

    def halt(self, who: str, reason: str = "") -> None:
        """STOP, past every queue. Safe from any thread."""
        if link := self._link():
            link.send_stop(Stop(who=who, reason=reason))

    def ask(self, request: Request) -> Reply:
        """Make a request under our lease, taking the lease first where the request needs one and it is free."""
        link = self._link()
        if link is None:
            return Reply(ok=False, reasons=("the robot process is gone: restart it",))
        with self._lock:
            self._forget_lost_lease(link)
            refused = None if self._lease else self._acquire(link)
            lease = self._lease
        if refused is not None:
            return refused
        return link.request(
            Request(what=request.what, lease=lease, who=request.who or self._who, reason=request.reason)
        )

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
                self.halt(self._who, "B on the pad")
            else:
                what = self._locking() if action == "lock" else action
                threading.Thread(target=self._ask_for_button, args=(Request(what=what),), daemon=True).start()
        link = self._link()
        state = link.latest if link else None
        if link is None or state is None:
            return
        self._pilot.robot_phase(state.phase)
        with self._lock:
            self._forget_lost_lease(link)
            if not self._lease:
                # After a STOP only clearing it takes the controls again.
                if state.phase != "stopped" and not state.lease.fresh and self._clock.now() >= self._next_try:
                    self._next_try = self._clock.now() + ACQUIRE_PERIOD_S
                    self._acquire(link)
                return
            self._sequence += 1
            lease, epoch, sequence = self._lease, self._epoch, self._sequence
        wanted = self._pilot.command(self._clock.now())
        command = Command(
            lease=lease,
            epoch=epoch,
            sequence=sequence,
            echo=state.stamp,
            held=wanted.held,
            intent=wanted.intent,
            input_stamp=wanted.input_stamp,
        )
        link.send(command)
        self._sent(wanted, command)

    def _locking(self) -> str:
        """One button locks and unlocks, whichever the robot is not doing."""
        link = self._link()
        status = link.latest.lock.status if link and link.latest else "none"
        return "unlock" if status in ("locking", "rigid") else "lock"

    def _ask_for_button(self, request: Request) -> None:
        reply = self.ask(request)
        if not reply.ok:
            self._warn(f"{request.what} was refused: {'; '.join(reply.reasons)}")

    def _forget_lost_lease(self, link: ConsoleLink) -> None:
        """A stop or somebody else ended our lease, or the robot process that gave it is gone."""
        epoch = link.latest.epoch if link.latest else 0
        if link is not self._leased_on or epoch > self._epoch:
            self._lease = ""

    def _acquire(self, link: ConsoleLink) -> Reply | None:
        """Take the lease if it is free; returns the refusal, or None when we have it."""
        reply = link.request(Request(what="acquire", who=self._who))
        if not reply.ok:
            return reply
        self._lease, self._epoch, self._sequence = reply.lease, reply.epoch, 0
        self._leased_on = link
        return None
