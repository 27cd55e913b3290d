"""Requests about the lease: take it when it is free, ask its holder for it, give it, let it go, take it over with a reason."""

from collections.abc import Callable

from cobra.control.authority import Authority
from cobra.messages import Event, Reply, Request

MAX_REASON = 200
"""Characters of a reason that are told."""


class LeaseRequests:
    """Answers what concerns the lease and tells everybody of every change. `acts` maps each request to who answers it."""

    def __init__(
        self, authority: Authority, lose_driver: Callable[[], None], announce: Callable[[Event], None]
    ) -> None:
        self._authority = authority
        self._lose_driver = lose_driver
        self._announce = announce
        self.acts: dict[str, Callable[[Request, float], Reply]] = {
            "acquire": self._acquire,
            "take": self._take,
            "retain": self._retain,
            "release": self._release,
            "ask": self._ask,
            "withdraw": self._withdraw,
            "grant": self._grant,
            "refuse": self._refuse,
        }

    def answer(self, request: Request, now_s: float) -> Reply:
        return self.acts[request.what](request, now_s)

    def _acquire(self, request: Request, now_s: float) -> Reply:
        lease = self._authority.acquire(request.who, now_s, request.lease)
        if lease is None:
            state = self._authority.lease(now_s)
            why = f"{state.holder} drives" if state.fresh else f"the controls are kept for {state.kept_for}"
            return self._no(why)
        return self._taken(lease, f"{request.who or 'somebody'} took the controls", now_s)

    def _take(self, request: Request, now_s: float) -> Reply:
        """Against the holder's will; whether the one who asks may do so, the console has decided."""
        reason = request.reason.strip()[:MAX_REASON]
        if not reason:
            return self._no("taking over needs a reason, which everybody is told")
        before = self._authority.lease(now_s).holder
        lease = self._authority.take(request.who, now_s)
        held = f" from {before}" if before else ""
        return self._taken(lease, f"{request.who or 'somebody'} took the controls{held}: {reason}", now_s, "warning")

    def _retain(self, request: Request, now_s: float) -> Reply:
        return self._yes() if self._authority.retain(request.lease, now_s) else self._no("this lease is over")

    def _release(self, request: Request, now_s: float) -> Reply:
        holder = self._authority.lease(now_s).holder
        if not self._authority.release(request.lease):
            return Reply(ok=False, epoch=self._authority.epoch)
        self._lose_driver()
        self._tell(f"{holder} let go of the controls", now_s)
        return self._yes()

    def _ask(self, request: Request, now_s: float) -> Reply:
        """The reply's `lease` is the ticket with which it is acquired once it is granted."""
        state = self._authority.lease(now_s)
        if not state.fresh:
            return self._no("nobody drives: take the controls")
        ticket = self._authority.ask(request.who, now_s)
        if ticket is None:
            return self._no("too many ask for the controls already")
        if request.who not in state.asking:
            self._tell(f"{request.who} asks {state.holder} for the controls", now_s)
        return Reply(ok=True, lease=ticket, epoch=self._authority.epoch)

    def _withdraw(self, request: Request, now_s: float) -> Reply:
        self._authority.withdraw(request.lease)
        return self._yes()

    def _grant(self, request: Request, now_s: float) -> Reply:
        holder = self._authority.lease(now_s).holder
        if not self._authority.holds(request.lease):
            return self._no("only who drives can give the controls to somebody")
        if not self._authority.grant(request.name, now_s):
            return self._no(f"{request.name} does not ask for the controls any more")
        self._lose_driver()
        self._tell(f"{holder} gave the controls to {request.name}", now_s)
        return self._yes()

    def _refuse(self, request: Request, now_s: float) -> Reply:
        if not self._authority.holds(request.lease):
            return self._no("only who drives can refuse the controls to somebody")
        if self._authority.refuse(request.name):
            self._tell(f"{self._authority.lease(now_s).holder} keeps the controls: not now, {request.name}", now_s)
        return self._yes()

    def _taken(self, lease: str, text: str, now_s: float, level: str = "info") -> Reply:
        self._lose_driver()
        self._announce(Event(stamp=now_s, level="warning" if level == "warning" else "info", text=text))
        return Reply(ok=True, lease=lease, epoch=self._authority.epoch)

    def _tell(self, text: str, now_s: float) -> None:
        self._announce(Event(stamp=now_s, level="info", text=text))

    def _yes(self) -> Reply:
        return Reply(ok=True, epoch=self._authority.epoch)

    def _no(self, why: str) -> Reply:
        return Reply(ok=False, reasons=(why,), epoch=self._authority.epoch)
