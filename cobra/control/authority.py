"""Who may drive: one lease, fenced by epoch and sequence, decided in the robot process alone."""

import math
import uuid
from collections import Counter

from cobra.messages import MAX_COMMAND_AGE_S, Command, Intent, Lease

LEASE_STALE_S = 1.0
"""Without a sign of life for this long the lease may be acquired by somebody else."""
ASK_S = 60.0
"""Who asked for the controls and got no answer for this long is forgotten; they may ask again."""
KEPT_S = 10.0
"""After a grant the lease is kept this long for who asked for it."""
MAX_ASKING = 8


class Authority:
    """Holds the lease and judges every command. Every refusal is counted by its reason in `drops`."""

    def __init__(self) -> None:
        self.epoch = 1
        self.drops: Counter[str] = Counter()
        self._lease = ""
        self._holder = ""
        self._since = 0.0
        self._retained = -math.inf
        self._sequence = 0
        self._asking: dict[str, tuple[str, float]] = {}
        """By ticket: who asks for the controls, and since when."""
        self._kept: tuple[str, str, float] = ("", "", -math.inf)
        """Granted to: ticket, who, until when."""

    @property
    def last_sequence(self) -> int:
        return self._sequence

    def lease(self, now_s: float) -> Lease:
        return Lease(
            holder=self._holder,
            since=self._since,
            fresh=self.fresh(now_s),
            asking=tuple(who for who, since in self._asking.values() if now_s - since <= ASK_S),
            kept_for=self._kept[1] if now_s <= self._kept[2] else "",
        )

    def fresh(self, now_s: float) -> bool:
        return bool(self._lease) and now_s - self._retained <= LEASE_STALE_S

    def silence(self, now_s: float) -> float:
        """Seconds since the holder was last heard of; inf when nobody ever drove."""
        return now_s - self._retained

    def holds(self, lease: str) -> bool:
        return bool(lease) and lease == self._lease

    def acquire(self, who: str, now_s: float, ticket: str = "") -> str | None:
        """Give the lease if it is free or stale, and not kept for somebody with another ticket.

        Returns the lease, or None while somebody else holds it or is to have it.
        """
        kept = now_s <= self._kept[2] and ticket != self._kept[0]
        return None if self.fresh(now_s) or kept else self.take(who, now_s)

    def take(self, who: str, now_s: float) -> str:
        """Give the lease whoever holds it. The new epoch fences off everything the former holder still sends."""
        self.epoch += 1
        self._lease = uuid.uuid4().hex
        self._holder = who or "somebody"
        self._since = self._retained = now_s
        self._sequence = 0
        self._kept = ("", "", -math.inf)
        self._forget(self._holder)
        return self._lease

    def ask(self, who: str, now_s: float) -> str | None:
        """Ask the holder for the lease. Returns the ticket to acquire it with once it is granted, or None if too many ask."""
        self._asking = {key: (name, since) for key, (name, since) in self._asking.items() if now_s - since <= ASK_S}
        self._forget(who)
        if len(self._asking) >= MAX_ASKING:
            return None
        ticket = uuid.uuid4().hex
        self._asking[ticket] = (who, now_s)
        return ticket

    def withdraw(self, ticket: str) -> None:
        self._asking.pop(ticket, None)

    def grant(self, who: str, now_s: float) -> bool:
        """End the present lease and keep it for somebody who asks. Returns whether they do."""
        tickets = [key for key, (name, since) in self._asking.items() if name == who and now_s - since <= ASK_S]
        if not tickets:
            return False
        self.revoke()
        self._kept = (tickets[-1], who, now_s + KEPT_S)
        return True

    def refuse(self, who: str) -> bool:
        """Whoever asks under this name asks no more. Returns whether they did."""
        return self._forget(who)

    def _forget(self, who: str) -> bool:
        before = len(self._asking)
        self._asking = {key: asked for key, asked in self._asking.items() if asked[0] != who}
        return len(self._asking) < before

    def retain(self, lease: str, now_s: float) -> bool:
        if not self.holds(lease):
            return False
        self._retained = now_s
        return True

    def release(self, lease: str) -> bool:
        if not self.holds(lease):
            return False
        self.revoke()
        return True

    def revoke(self) -> None:
        """Nobody holds the lease now, and no command on its way is valid any more."""
        self.epoch += 1
        self._lease = self._holder = ""
        self._retained = -math.inf

    def accept(self, command: Command, now_s: float) -> str | None:
        """Judge one command at its arrival. Returns why it is dropped (counted), or None when it is to be obeyed.

        Hosts share no clock: the age is our own time now minus the stamp of ours that the command echoes.
        """
        reason = self._judge(command, now_s)
        if reason:
            self.drops[reason] += 1
            return reason
        self._sequence = command.sequence
        self._retained = now_s
        return None

    def _judge(self, command: Command, now_s: float) -> str | None:
        if not self.holds(command.lease):
            return "wrong lease"
        if command.epoch != self.epoch:
            return "old epoch"
        if command.sequence <= self._sequence:
            return "repeated or older sequence"
        if not _finite(command):
            return "not finite or out of range"
        if command.echo > now_s:
            return "stamped in the future"
        if now_s - command.echo > MAX_COMMAND_AGE_S:
            return "too old"
        return None


def _finite(command: Command) -> bool:
    intent: Intent = command.intent
    rates = (*intent.primary, *intent.secondary, intent.feed, intent.twist)
    # NaN fails every comparison.
    return all(-1.0 <= rate <= 1.0 for rate in rates) and 0.0 <= intent.speed <= 1.0 and math.isfinite(command.echo)
