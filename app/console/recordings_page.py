"""The catalogue's page and what it asks for: list, search, download, mark, annotate, delete. Roles decide in the server."""

from collections.abc import Awaitable, Callable, Sequence
from pathlib import Path
from typing import Any

import msgspec
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import BaseRoute, Route

from app.console.doorkeeper import VISITOR
from app.console.front_door import page_route
from app.people.roles import Role, at_least
from app.people.sessions import Visitor
from app.recording import catalogue
from app.recording.catalogue import CatalogueError, Search

NEEDED: dict[str, Role] = {
    "list": "viewer",
    "download": "viewer",
    "mark": "driver",
    "note": "driver",
    "delete": "admin",
}
"""What each of them takes."""


class _Change(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What is to be changed of a session; what is not named stays."""

    marked: bool | None = None
    note: str | None = None


def recordings_routes(folder: Path) -> Sequence[BaseRoute]:
    """Routes of the recordings in a folder, for a front door."""

    def listed(request: Request) -> Response:
        wanted: dict[str, Any] = {name: value for name, value in request.query_params.items() if value}
        for flag in ("alarms_only", "marked_only"):
            wanted[flag] = wanted.get(flag) == "1"
        search = msgspec.convert(wanted, Search, strict=False)
        visitor: Visitor = request.scope[VISITOR]
        may = {what: at_least(visitor.role, needed) for what, needed in NEEDED.items()}
        return _json({"sessions": catalogue.sessions(folder, search), "may": may, "folder": str(folder)})

    def download(request: Request) -> Response:
        path = catalogue.find(folder, request.path_params["name"])
        return FileResponse(path, media_type="application/octet-stream", filename=path.name)

    def delete(request: Request) -> Response:
        catalogue.delete(catalogue.find(folder, request.path_params["name"]))
        return _json({"ok": True})

    async def change(request: Request) -> Response:
        wanted = msgspec.json.decode(await request.body(), type=_Change)

        def apply() -> Response:
            path = catalogue.find(folder, request.path_params["name"])
            if wanted.marked is not None:
                catalogue.mark(path, wanted.marked)
            if wanted.note is not None:
                catalogue.annotate(path, wanted.note)
            return _json(catalogue.session_of(path))

        return await run_in_threadpool(apply)

    return (
        page_route("/sessions", "sessions.html"),
        Route("/sessions/list", _guarded("list", listed)),
        Route("/sessions/file/{name}", _guarded("download", download)),
        Route("/sessions/change/{name}", _guarded("note", change), methods=["POST"]),
        Route("/sessions/delete/{name}", _guarded("delete", delete), methods=["POST"]),
    )


def _guarded(what: str, act: Callable[[Request], Any]) -> Callable[[Request], Awaitable[Response]]:
    """Only for those whose role allows it; what people can mend is answered in words."""

    async def answer(request: Request) -> Response:
        visitor: Visitor | None = request.scope[VISITOR]
        if visitor is None or not at_least(visitor.role, NEEDED[what]):
            return _refusal(f"this takes the role {NEEDED[what]}", 403)
        try:
            given = act(request)
            return await given if isinstance(given, Awaitable) else given
        except msgspec.MsgspecError as error:
            return _refusal(f"not understood: {error}", 400)
        except CatalogueError as error:
            return _refusal(str(error), 409)

    return answer


def _refusal(words: str, status: int) -> Response:
    return JSONResponse({"ok": False, "reasons": [words]}, status)


def _json(value: Any) -> Response:
    return Response(msgspec.json.encode(value), media_type="application/json")
