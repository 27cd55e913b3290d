"""Sending to a browser that may not read: it is waited for so long, then cut off, so that nothing piles up for it."""

import asyncio
from collections import Counter
from collections.abc import Awaitable

from starlette.websockets import WebSocket, WebSocketDisconnect

from app.console.doorkeeper import TRANSPORT

STUCK_S = 10.0
"""A browser that takes nothing for this long is cut off; one that lives connects again by itself."""


async def taken(
    sending: Awaitable[None], websocket: WebSocket, who: str, counts: Counter[str], more_s: float = 0.0
) -> None:
    """Wait until the websocket took what it is sent. `who` it is, is for the count; `more_s` is for what is large.

    Raises:
        WebSocketDisconnect: it did not take it in time, and was cut off.
    """
    try:
        async with asyncio.timeout(STUCK_S + more_s):
            await sending
    except TimeoutError:
        raise cut_off(websocket, who, counts) from None


def cut_off(websocket: WebSocket, who: str, counts: Counter[str]) -> WebSocketDisconnect:
    """End the connection without a farewell, which nobody would read; gives what ends its tasks here."""
    counts[f"{who} does not read: cut off"] += 1
    if connection := websocket.scope[TRANSPORT]():
        connection.abort()
    return WebSocketDisconnect(1008)
