"""Requests are asked once and answered: who may ask is decided here, what is done by whoever registered the act."""

from collections import Counter
from collections.abc import Callable

import msgspec

from cobra.control.authority import Authority
from cobra.control.lease_requests import LeaseRequests
from cobra.control.supervisor import Health
from cobra.messages import Event, Reply, Request, decode

Act = Callable[[Request, float, Health], Reply]
"""Carries out a request of the driver: (request, now [s], health) → reply. The reply's epoch is filled in here."""

MARKER_LENGTH = 200
"""Characters of a marker's text that are kept."""


class Requests:
    """Answers requests. `acts` maps what may be asked of the driver's hand to who does it; parts of the loop add theirs."""

    def __init__(
        self, authority: Authority, lose_driver: Callable[[], None], announce: Callable[[Event], None]
    ) -> None:
        self.acts: dict[str, Act] = {}
        self.malformed: Counter[str] = Counter()
        self._authority = authority
        self._leases = LeaseRequests(authority, lose_driver, announce)
        self._announce = announce

    def answer(self, data: bytes, now_s: float, health: Health) -> Reply:
        """The answer to the bytes of a request; what cannot be read is counted and refused."""
        try:
            request = decode(data, Request)
        except msgspec.MsgspecError:
            self.malformed["malformed request"] += 1
            return Reply(ok=False, reasons=("the request could not be read",))
        if request.what in self._leases.acts:
            return self._leases.answer(request, now_s)
        if request.what == "mark":
            return self._mark(request, now_s)
        act = self.acts.get(request.what)
        if act is None:
            known = ", ".join(sorted(self.acts))
            return Reply(ok=False, reasons=(f"there is no request {request.what!r} here; there are {known}",))
        if not self._authority.holds(request.lease):
            return Reply(ok=False, reasons=("only the driver may do this: take the controls first",))
        return msgspec.structs.replace(act(request, now_s, health), epoch=self._authority.epoch)

    def _mark(self, request: Request, now_s: float) -> Reply:
        """Anybody may leave a marker: it moves nothing, and everybody sees it on the same clock."""
        by = f" ({request.who})" if request.who else ""
        self._announce(Event(stamp=now_s, level="marker", text=f"{request.reason[:MARKER_LENGTH] or 'Marker'}{by}"))
        return Reply(ok=True, epoch=self._authority.epoch)
