"""A slow line between a browser and the front door: a TCP relay that passes so many bytes a second, for all that use it together."""

import asyncio
import contextlib
import socket
import threading
import time
from typing import Self

CHUNK = 2048
CREDIT_S = 0.1
"""What a sleep that lasted too long is made up for: a busy machine is no slower line."""
BUFFER_BYTES = 16 * 1024
"""What waits inside the line, in each connection and direction: as much as a router keeps."""


class SlowLink:
    """Listens on a port of loopback; what comes from `port` is passed on at `rate` bytes a second, requests at once."""

    def __init__(self, port: int, rate: float) -> None:
        self.passed = 0
        """Bytes that came down."""
        self.rate = rate
        self._to = port
        self._free_at = 0.0
        self._loop = asyncio.new_event_loop()
        self._ready = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        self._ready.wait()
        return self

    def __exit__(self, *_: object) -> None:
        self._loop.call_soon_threadsafe(self._done.set)
        self._thread.join()

    def _run(self) -> None:
        self._loop.run_until_complete(self._serve())

    async def _serve(self) -> None:
        self._done = asyncio.Event()
        listener = socket.create_server(("127.0.0.1", 0))
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER_BYTES)
        self.port = listener.getsockname()[1]
        server = await asyncio.start_server(self._join, sock=listener, limit=BUFFER_BYTES)
        self._ready.set()
        await self._done.wait()
        server.close()
        for task in asyncio.all_tasks() - {asyncio.current_task()}:
            task.cancel()

    async def _join(self, down: asyncio.StreamReader, up: asyncio.StreamWriter) -> None:
        channel = socket.socket()
        channel.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
        channel.setblocking(False)
        with contextlib.suppress(OSError, asyncio.CancelledError):
            await self._loop.sock_connect(channel, ("127.0.0.1", self._to))
            reader, writer = await asyncio.open_connection(sock=channel, limit=BUFFER_BYTES)
            up.transport.set_write_buffer_limits(0)
            await asyncio.gather(self._pass(down, writer, slowly=False), self._pass(reader, up, slowly=True))

    async def _pass(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, slowly: bool) -> None:
        try:
            while data := await reader.read(CHUNK):
                if slowly:
                    now = time.monotonic()
                    self._free_at = max(self._free_at, now - CREDIT_S) + len(data) / self.rate
                    await asyncio.sleep(max(0.0, self._free_at - now))
                    self.passed += len(data)
                writer.write(data)
                await writer.drain()
        finally:
            writer.close()
