"""Who may drive: one lease, fenced by epoch and sequence, decided in the robot process alone."""

import math
import uuid
from collections import Counter

from cobra.messages import MAX_COMMAND_AGE_S, Command, Intent, Lease

LEASE_STALE_S = 1.0
"""Without a sign of life for this long the lease may be acquired by somebody else."""


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

    @property
    def last_sequence(self) -> int:
        return self._sequence

    def lease(self, now_s: float) -> Lease:
        return Lease(holder=self._holder, since=self._since, fresh=self.fresh(now_s))

    def fresh(self, now_s: float) -> bool:
        return bool(self._lease) and now_s - self._retained <= LEASE_STALE_S

    def silence(self, now_s: float) -> float:
        """Seconds since the holder was last heard of; inf when nobody ever drove."""
        return now_s - self._retained

    def holds(self, lease: str) -> bool:
        return bool(lease) and lease == self._lease

    def acquire(self, who: str, now_s: float) -> str | None:
        """Give the lease if it is free or stale. Returns the lease, or None while somebody else holds it."""
        return None if self.fresh(now_s) else self.take(who, now_s)

    def take(self, who: str, now_s: float) -> str:
        """Give the lease whoever holds it. The new epoch fences off everything the former holder still sends."""
        self.epoch += 1
        self._lease = uuid.uuid4().hex
        self._holder = who or "somebody"
        self._since = self._retained = now_s
        self._sequence = 0
        return self._lease

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
