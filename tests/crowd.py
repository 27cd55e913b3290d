"""Many viewers in a process of their own: raw websocket clients that speak viser's protocol through the front door.

    python -m tests.crowd URL COOKIE COUNT [PATH]

Says `ready` when all have joined. Each line on stdin is answered with what every viewer got since the last: bytes, frames,
and the age of the oldest frame [s] (viser stamps them with the clock that all processes of a machine share). Only frame
headers are read, so that the crowd costs little beside what it watches.
"""

import asyncio
import base64
import json
import os
import subprocess
import sys
import time
from typing import Any, Self
from urllib.parse import urlsplit

import msgspec
import viser

CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (1.0, 1.0, 1.0),
    "fov": 0.7,
    "near": 0.01,
    "far": 6.0,
    "image_height": 720,
    "image_width": 1280,
    "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, -1.0, 0.0),
}


class RawViewer:
    """One websocket, its handshake and frames by hand."""

    def __init__(self) -> None:
        self.bytes = self.frames = 0

    async def join(self, url: str, cookie: str, path: str) -> None:
        """Shake hands and look: from the camera message on viser counts it as a viewer."""
        place = urlsplit(url)
        self._reader, self._writer = await asyncio.open_connection(place.hostname, place.port, limit=1 << 18)
        key = base64.b64encode(os.urandom(16)).decode()
        lines = [
            f"GET {path} HTTP/1.1",
            f"Host: {place.netloc}",
            f"Origin: {url.rstrip('/')}",
            f"Cookie: {cookie}",
            "Connection: Upgrade",
            "Upgrade: websocket",
            "Sec-WebSocket-Version: 13",
            f"Sec-WebSocket-Key: {key}",
            f"Sec-WebSocket-Protocol: viser-v{viser.__version__}",
        ]
        self._writer.write(("\r\n".join(lines) + "\r\n\r\n").encode())
        head = await self._reader.readuntil(b"\r\n\r\n")
        assert b" 101 " in head.splitlines()[0], head
        self.send(msgspec.msgpack.encode(CAMERA))

    def send(self, data: bytes, kind: int = 2) -> None:
        length = len(data)
        size = bytes([0x80 | length]) if length < 126 else bytes([0x80 | 126]) + length.to_bytes(2, "big")
        self._writer.write(bytes([0x80 | kind]) + size + bytes(4) + data)  # masked with zeros

    async def read(self) -> None:
        """Read on until the other side ends it; a ping is answered."""
        reader = self._reader
        while True:
            head = await reader.readexactly(2)
            length = head[1] & 127
            if length > 125:
                length = int.from_bytes(await reader.readexactly(2 if length == 126 else 8), "big")
            kind, left = head[0] & 15, length
            if kind == 9:
                self.send(await reader.readexactly(length), 10)
                continue
            if kind == 8:
                raise ConnectionError("closed by the door")
            while left:
                left -= len(await reader.read(min(left, 1 << 17)))
            self.bytes += length
            self.frames += 1


async def _watch(url: str, cookie: str, count: int, path: str) -> None:
    viewers = [RawViewer() for _ in range(count)]
    for viewer in viewers:
        await viewer.join(url, cookie, path)
    reading = [asyncio.create_task(viewer.read()) for viewer in viewers]
    print("ready", flush=True)
    lines = asyncio.StreamReader()
    await asyncio.get_running_loop().connect_read_pipe(lambda: asyncio.StreamReaderProtocol(lines), sys.stdin)
    since = time.monotonic()
    while await lines.readline():
        now = time.monotonic()
        report = [[viewer.bytes, viewer.frames] for viewer in viewers]
        gone = sum(task.done() for task in reading)
        print(json.dumps({"seconds": now - since, "each": report, "gone": gone}), flush=True)
        since = now
        for viewer in viewers:
            viewer.bytes = viewer.frames = 0


class Crowd:
    """The process, from outside."""

    def __init__(self, url: str, cookie: str, count: int, path: str = "/viewer/") -> None:
        command = ["nice", "-n", "10", sys.executable, "-m", "tests.crowd", url, cookie, str(count), path]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        assert self._line() == "ready"

    def report(self) -> dict[str, Any]:
        """What came since the last report."""
        assert self._process.stdin is not None
        self._process.stdin.write("\n")
        self._process.stdin.flush()
        report: dict[str, Any] = json.loads(self._line())
        return report

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.terminate()
        self._process.wait(10)

    def _line(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline().strip()


if __name__ == "__main__":
    asyncio.run(_watch(sys.argv[1], sys.argv[2], int(sys.argv[3]), (*sys.argv[4:], "/viewer/")[0]))
