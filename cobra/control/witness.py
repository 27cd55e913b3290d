"""What the robot was told and what it made of it, for whoever records: every command with its verdict, every answer.

A lease is the key to the robot: it leaves the process only as a fingerprint.
"""

from collections.abc import Callable
from functools import lru_cache
from hashlib import sha256

import msgspec

from cobra.messages import Answered, Command, Heard, Judged, Reply, Request, decode

MOST = 16
"""Commands told of in one tick; a flood beyond that is only counted, so that it cannot cost the loop its time."""


class Witness:
    """Collects during a tick; `tell` publishes what there is, at most one message a tick."""

    def __init__(self, publish: Callable[[Heard], None] = lambda heard: None) -> None:
        self._publish = publish
        self._commands: list[Judged] = []
        self._answers: list[Answered] = []
        self._omitted = 0

    def command(self, command: Command, dropped: str | None, now_s: float) -> None:
        """A command that arrived, and why it is dropped; None when it is obeyed."""
        if len(self._commands) >= MOST:
            self._omitted += 1
            return
        shown = msgspec.structs.replace(command, lease=fingerprint(command.lease))
        self._commands.append(Judged(stamp=now_s, command=shown, dropped=dropped or ""))

    def request(self, data: bytes, reply: Reply, now_s: float) -> None:
        """A request as it arrived, and its answer. What could not be read has been counted already."""
        if len(self._answers) >= MOST:
            self._omitted += 1
            return
        try:
            request = decode(data, Request)
        except msgspec.MsgspecError:
            return
        asked = msgspec.structs.replace(request, lease=fingerprint(request.lease))
        reply = msgspec.structs.replace(reply, lease=fingerprint(reply.lease))
        self._answers.append(Answered(stamp=now_s, request=asked, reply=reply))

    def tell(self) -> None:
        """Publish what was collected since the last call."""
        if self._commands or self._answers:
            self._publish(
                Heard(commands=tuple(self._commands), answers=tuple(self._answers), omitted=self._omitted),
            )
            self._commands, self._answers, self._omitted = [], [], 0


@lru_cache(maxsize=64)
def fingerprint(lease: str) -> str:
    """Tells leases apart without being one: the first eight hexadecimal digits of the SHA-256; empty for none."""
    return sha256(lease.encode(errors="replace")).hexdigest()[:8] if lease else ""
