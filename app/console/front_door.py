"""The one port that browsers come to: the operator's page, its websocket, and viser behind a proxy."""

import re
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Unpack

import msgspec
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import BaseRoute, Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles

from app.console.doorkeeper import VISITOR
from app.console.page_socket import Asker, PageSession, PageSocket
from app.console.scrape import Scrape
from app.console.static_folder import static_folder
from app.console.viewer_proxy import ViewerProxy
from app.console.web_server import Door, WebServer
from app.metrics import Metrics
from cobra.control.realtime import PAGES_PRIORITY

POLICY = "; ".join(
    (
        "default-src 'self'",
        "img-src 'self' data:",
        "frame-src 'self' http://localhost:* http://127.0.0.1:* https://localhost:* https://127.0.0.1:*",
        "object-src 'none'",
        "base-uri 'none'",
        "form-action 'self'",
        "frame-ancestors 'none'",
    )
)
"""The operator's page runs and shows only what comes from here, and nobody can frame it under false buttons."""

PAGE_HEADERS = {
    "content-security-policy": POLICY,
    # With no-referrer browsers hide the Origin of a posted form, and the doorkeeper would refuse to sign anybody out.
    "referrer-policy": "same-origin",
    "cache-control": "no-cache",
}
_COUNTING = re.compile(r"[0-9]{1,9}")


def page_route(path: str, file: str) -> Route:
    """A page out of `static/`, with the policy that binds its scripts."""
    content = static_folder() / file

    async def page(request: Request) -> Response:
        return FileResponse(content, headers=PAGE_HEADERS)

    return Route(path, page)


def viewer_routes(proxy: ViewerProxy) -> tuple[BaseRoute, ...]:
    """viser's page and websocket, under /viewer/."""
    return (
        Route("/viewer", proxy.page),
        Route("/viewer/{path:path}", proxy.page),
        WebSocketRoute("/viewer", proxy.forward),
        WebSocketRoute("/viewer/{path:path}", proxy.forward),
    )


def metrics_route(metrics: Metrics | None, server: WebServer) -> Sequence[BaseRoute]:
    """`/metrics`, where there are any."""
    return (Route("/metrics", Scrape(metrics, server.sessions, server.refused).answer),) if metrics else ()


async def stop_by_post(request: Request, pages: PageSocket) -> Response:
    """STOP's second way: a page takes both at once, in case its websocket is dead without knowing it."""
    page, press = (request.query_params.get(name, "") for name in ("page", "press"))
    who = f"page {page}" if _COUNTING.fullmatch(page) else "a page"
    number = int(press) if _COUNTING.fullmatch(press) else None
    return JSONResponse(await pages.stop(Asker(who, request.scope[VISITOR]), number))


class FrontDoor(WebServer):
    """The console's web server.

    Args:
        host: address to listen on.
        port: port to listen on; 0 takes a free one.
        viewer_port: where viser listens on loopback.
        session: what answers the pages.
        viewer_secret: what viser wants to see of whoever connects to it.
        thin_viewer: gives port and secret of a second viser, for slow links; None: there is none.
        door: names, TLS and sessions, as `WebServer` takes them.
        more: further routes, such as those of the recordings.
        metrics: what Prometheus may scrape; None serves none.
    """

    realtime_priority = PAGES_PRIORITY

    def __init__(
        self,
        host: str,
        port: int,
        viewer_port: int,
        session: PageSession,
        more: Sequence[BaseRoute] = (),
        viewer_secret: str = "",
        thin_viewer: Callable[[], tuple[int, str]] | None = None,
        metrics: Metrics | None = None,
        **door: Unpack[Door],
    ) -> None:
        super().__init__(host, port, **door)
        self.signing.on_session = session.note_session
        self._session = session
        self._proxy = ViewerProxy(viewer_port, viewer_secret, thin_viewer)
        self._pages = PageSocket(session, behind=self._proxy.behind)
        self._more = more
        self._metrics = metrics

    @property
    def people(self) -> dict[str, int]:
        """Who is connected, by what they look at."""
        return {"pages": self._pages.pages, "views": self._proxy.viewers}

    @property
    def counts(self) -> Counter[str]:
        """What was refused or dropped since the start, by reason."""
        return self._pages.counts + self._proxy.counts + self.refused

    def routes(self) -> Sequence[BaseRoute]:
        return (
            page_route("/", "index.html"),
            Route("/healthz", self._health),
            Route("/audit", self._audit),
            Route("/stop", self._stop_by_post, methods=["POST"]),
            WebSocketRoute("/ws", self._pages.serve),
            *viewer_routes(self._proxy),
            *metrics_route(self._metrics, self),
            *self._more,
            Mount("/static", StaticFiles(directory=static_folder())),
        )

    async def _health(self, request: Request) -> Response:
        """To anybody that it is up; to who has a session, who is there."""
        if request.scope[VISITOR] is None:
            return JSONResponse({"ok": True})
        return JSONResponse(
            {"ok": True, "pages": self._pages.pages, "viewers": self._proxy.viewers, "counts": dict(self.counts)}
        )

    async def _audit(self, request: Request) -> Response:
        return JSONResponse(msgspec.to_builtins(await self._session.audit()))

    async def _stop_by_post(self, request: Request) -> Response:
        return await stop_by_post(request, self._pages)
