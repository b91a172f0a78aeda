"""Around all routes: who may ask, one line a request on stderr, and the counters."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable, MutableMapping, Sequence
from typing import Any
from urllib.parse import urlsplit

from starlette.responses import JSONResponse
from starlette.routing import Match, Route

from spgf_torch.errors import one_line
from spgf_torch.progress import console
from spgf_torch.serving.config import ServeConfig
from spgf_torch.serving.metrics import Metrics

Scope = MutableMapping[str, Any]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]

LOOPBACK = ("127.0.0.1", "::1", "localhost")
# Counted and told where nobody was there any more to be answered.
UNANSWERED = 499
# Counted together: addresses that there are not.
OTHER = "other"


class Guarded:
    """An application whose requests are checked, counted and told.

    A server of this machine alone answers only what is asked of this machine: a page somewhere could else have the
    browser ask in its name, or call itself by our address (DNS rebinding).
    """

    def __init__(self, app: Any, config: ServeConfig, metrics: Metrics, routes: Sequence[Route]) -> None:
        self._app, self._config, self._metrics, self._routes = app, config, metrics, routes

    async def __call__(self, scope: Scope, receive: Any, send: Send) -> None:
        if scope["type"] != "http":
            return
        start, status = time.perf_counter(), UNANSWERED

        async def send_and_see(message: MutableMapping[str, Any]) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                message["headers"] = [*message.get("headers", ()), (b"x-content-type-options", b"nosniff")]
            await send(message)

        try:
            why = self._stranger(scope)
            app = self._app if why is None else JSONResponse({"error": one_line(why)}, 403)
            await app(scope, receive, send_and_see)
        except asyncio.CancelledError:  # the server stops, and what it gave requests in flight (stop_seconds) is over
            if status == UNANSWERED:
                stopping = {"error": "expected an answer, but the server is stopping"}
                await JSONResponse(stopping, 503)(scope, receive, send_and_see)
        finally:
            seconds = time.perf_counter() - start
            self._metrics.answered(self._path(scope), status, seconds)
            if not self._config.quiet:
                self._tell(scope, status, seconds)

    def _stranger(self, scope: Scope) -> str | None:
        """Why a request is not answered; None where it is."""
        headers = {name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]}
        host, origin = headers.get("host", ""), headers.get("origin")
        if self._config.host in LOOPBACK and _name(host) not in LOOPBACK:
            return f"Host: expected {' or '.join(LOOPBACK)}, got {host[:80]!r}"
        if origin is not None and urlsplit(origin).netloc != host:
            return f"Origin: expected this server's own pages, got {origin[:80]!r}"
        return None

    def _path(self, scope: Scope) -> str:
        """The route of a request, as it is counted."""
        return next((route.path for route in self._routes if route.matches(scope)[0] is not Match.NONE), OTHER)

    def _tell(self, scope: Scope, status: int, seconds: float) -> None:
        now = time.strftime("%Y-%m-%d %H:%M:%S")
        client = (scope.get("client") or ("-",))[0]
        more = f", {scope['told']}" if "told" in scope else ""
        path = one_line(scope["path"][:80])
        console.print(f"{now} {client} {scope['method']} {path} {status} in {seconds:.3f} s{more}")


def _name(host: str) -> str:
    """The name in a Host header; empty of one that is none."""
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""
