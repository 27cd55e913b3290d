"""Lets a new viewer join at once, however long the scene has been live.

viser numbers every message since its start, and a new client's sender walks through all the numbers, on the thread that
serves everybody: 4 s after 60 million updates, which a scene at 30 Hz has made after some days. Only the newest message
of each kind is kept, a few hundred; the sender here goes through those. (viser is pinned to one version.)
"""

import asyncio
from collections.abc import AsyncGenerator, Sequence

import viser
from viser.infra._async_message_buffer import AsyncMessageBuffer
from viser.infra._messages import Message

SPARSE = 4
"""From so many numbers per message that is kept on, the messages are gone through instead of the numbers."""


def join_at_once(server: viser.ViserServer) -> None:
    """Before the first client comes."""
    server._websock_server._broadcast_buffer.__class__ = PatientBuffer


class PatientBuffer(AsyncMessageBuffer):
    """viser's buffer of the messages for all clients."""

    async def _window_loop(
        self, client_id: int, backlog_last_id: int, backlog_done_message: Message | None
    ) -> AsyncGenerator[Sequence[Message], None]:
        """Windows of messages for one client: what there was when it came, the marker that ends that, and then all new ones."""
        cursor, marker = -1, backlog_done_message
        self.generator_cursors[client_id] = cursor
        try:
            while not self.done:
                window: list[Message] = []
                if self.atomic_counter == 0:
                    newest = self.message_counter - 1
                    window, cursor = self.after(cursor, newest if marker is None else min(newest, backlog_last_id))
                    window = [message for message in window if message.excluded_self_client != client_id]
                    self.generator_cursors[client_id] = cursor  # viser's collector keeps what somebody has not got yet
                    if marker is not None and cursor >= backlog_last_id:
                        window.append(marker)
                        marker = None
                if window:
                    yield window
                else:
                    await self.message_event.wait()
                    self.message_event.clear()
                if not window or cursor == self.message_counter - 1:
                    await self._rest()
        finally:
            self.generator_cursors.pop(client_id, None)

    def after(self, cursor: int, last: int) -> tuple[list[Message], int]:
        """The next messages with numbers beyond `cursor`, up to `last`, and the number up to which that is all."""
        kept = self.message_from_id
        with self.buffer_lock:
            if last - cursor > SPARSE * len(kept):
                numbers = [number for number in kept if cursor < number <= last]  # they stand in their order
            else:
                numbers = [number for number in range(cursor + 1, last + 1) if number in kept]
            window = [kept[number] for number in numbers[: self.max_window_size]]
        return window, last if len(numbers) <= self.max_window_size else numbers[self.max_window_size - 1]

    async def _rest(self) -> None:
        """Let more messages gather, but no longer than until somebody asks for them."""
        try:
            async with asyncio.timeout(self.window_duration_sec):
                await self.flush_event.wait()
        except TimeoutError:
            return
        self.flush_event.clear()
