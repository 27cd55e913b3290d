"""The catalogue's page and what it asks for: list, search, download, mark, annotate, delete. Roles decide in the server."""

from collections.abc import Awaitable, Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import msgspec
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import JSONResponse, Response, StreamingResponse
from starlette.routing import BaseRoute, Route

from app.console.doorkeeper import VISITOR
from app.console.front_door import page_route
from app.people.roles import Role, at_least
from app.people.sessions import Visitor
from app.recording import catalogue
from app.recording.catalogue import CatalogueError, Search

PIECE_BYTES: Final = 1 << 20
MOST_BYTES: Final = 100_000
"""Of what a page may send."""
NEEDED: Final[dict[str, Role]] = {
    "list": "viewer",
    "download": "viewer",
    "change": "driver",
    "delete": "admin",
}
"""What each of them takes."""


class _Change(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What is to be changed of a session; what is not named stays."""

    marked: bool | None = None
    note: str | None = None


def recordings_routes(folder: Path) -> Sequence[BaseRoute]:
    """Routes of the recordings in a folder, for a front door."""

    def listed(request: Request, body: bytes) -> Response:
        wanted: dict[str, Any] = {name: value for name, value in request.query_params.items() if value}
        for flag in ("alarms_only", "marked_only"):
            wanted[flag] = wanted.get(flag) == "1"
        search = msgspec.convert(wanted, Search, strict=False)
        visitor: Visitor = request.scope[VISITOR]
        may = {what: at_least(visitor.role, needed) for what, needed in NEEDED.items()}
        return _json({"sessions": catalogue.sessions(folder, search), "may": may, "folder": str(folder)})

    def download(request: Request, body: bytes) -> Response:
        return _file(catalogue.find(folder, request.path_params["name"]))

    def frames(request: Request, body: bytes) -> Response:
        return _file(catalogue.find_frames(folder, request.path_params["name"], request.path_params["file"]))

    def delete(request: Request, body: bytes) -> Response:
        catalogue.delete(catalogue.find(folder, request.path_params["name"]))
        return _json({"ok": True})

    def change(request: Request, body: bytes) -> Response:
        wanted = msgspec.json.decode(body, type=_Change)
        path = catalogue.find(folder, request.path_params["name"])
        if wanted.marked is not None:
            catalogue.mark(path, wanted.marked)
        if wanted.note is not None:
            catalogue.annotate(path, wanted.note)
        return _json(catalogue.session_of(path))

    return (
        page_route("/sessions", "sessions.html"),
        Route("/sessions/list", _guarded("list", listed)),
        Route("/sessions/file/{name}", _guarded("download", download)),
        Route("/sessions/frames/{name}/{file}", _guarded("download", frames)),
        Route("/sessions/change/{name}", _guarded("change", change), methods=["POST"]),
        Route("/sessions/delete/{name}", _guarded("delete", delete), methods=["POST"]),
    )


def _guarded(what: str, act: Callable[[Request, bytes], Response]) -> Callable[[Request], Awaitable[Response]]:
    """Only for those whose role allows it, and never on the thread that carries the driver's stream.

    What people can mend is answered in words.
    """

    async def answer(request: Request) -> Response:
        visitor: Visitor | None = request.scope[VISITOR]
        if visitor is None or not at_least(visitor.role, NEEDED[what]):
            return _refusal(f"this takes the role {NEEDED[what]}", 403)
        body = b""
        async for piece in request.stream():
            body += piece
            if len(body) > MOST_BYTES:
                return _refusal("too much was sent", 413)
        try:
            return await run_in_threadpool(act, request, body)
        except msgspec.MsgspecError as error:
            return _refusal(f"not understood: {error}", 400)
        except CatalogueError as error:
            return _refusal(str(error), 409)

    return answer


def _file(path: Path) -> Response:
    """As long as it is now: a file that grows while it is sent would not keep to the length that was announced."""
    size = path.stat().st_size
    headers = {"content-disposition": f'attachment; filename="{path.name}"', "content-length": str(size)}

    def pieces() -> Iterator[bytes]:
        left = size
        with path.open("rb") as file:
            while left and (piece := file.read(min(left, PIECE_BYTES))):
                left -= len(piece)
                yield piece

    return StreamingResponse(pieces(), media_type="application/octet-stream", headers=headers)


def _refusal(words: str, status: int) -> Response:
    return JSONResponse({"ok": False, "reasons": [words]}, status)


def _json(value: Any) -> Response:
    return Response(msgspec.json.encode(value), media_type="application/json")
