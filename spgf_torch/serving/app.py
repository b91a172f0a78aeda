"""The routes of the server. Whatever is wrong with a request is answered in JSON, {"error": one line}."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.routing import Route

from spgf_torch.errors import InputError, one_line
from spgf_torch.serving.bodies import job_of
from spgf_torch.serving.config import ServeConfig
from spgf_torch.serving.docs_page import docs_page
from spgf_torch.serving.metrics import CONTENT_TYPE, Metrics
from spgf_torch.serving.middleware import Guarded
from spgf_torch.serving.openapi import openapi
from spgf_torch.serving.predictions import RETRY, Predictions

# nginx's status of a request whose sender has left; nobody reads it but the log.
LEFT = 499


class App:
    """The application of one server.

    Args:
        reasons: key of conf/scene -> what it means, for the documentation. folder: for what requests send.
    """

    def __init__(
        self, config: ServeConfig, predictions: Predictions, metrics: Metrics, reasons: Mapping[str, str], folder: Path
    ) -> None:
        self.config, self.predictions, self.metrics, self.folder = config, predictions, metrics, folder
        self.reasons, self.last = reasons, ""
        routes = [
            Route("/", self.start, methods=["GET"]),
            Route("/grasps", self.grasps, methods=["POST"]),
            Route("/results/{name}/page", self.page, methods=["GET"]),
            Route("/health", self.health, methods=["GET"]),
            Route("/metrics", self.measured, methods=["GET"]),
            Route("/openapi.json", self.described, methods=["GET"]),
            Route("/docs", self.docs, methods=["GET"]),
        ]
        handlers: dict[Any, Any] = {
            InputError: _refused,
            HTTPException: _told,
            ClientDisconnect: _left,
            Exception: _broken,
        }
        self.asgi = Guarded(Starlette(routes=routes, exception_handlers=handlers), config, metrics, routes)

    async def grasps(self, request: Request) -> Response:
        """Grasps on what the body shows."""
        async with self.predictions.place():
            with tempfile.TemporaryDirectory(dir=self.folder) as folder:
                job = await job_of(request, Path(folder), self.config)
                answer = await self.predictions.predict(job, lambda: _still_there(request))
        self.last = answer.name
        request.scope["told"] = f"{answer.count} grasps"
        return Response(answer.body, media_type="application/json")

    async def page(self, request: Request) -> Response:
        """The page of a result."""
        found = await self.predictions.page(request.path_params["name"], lambda: _still_there(request))
        if found is None:
            raise HTTPException(
                404, f"expected one of the latest {self.config.kept} results (kept), got none of this name"
            )
        return HTMLResponse(found)

    async def start(self, request: Request) -> Response:
        """A form for a file, and the page of the last result."""
        return HTMLResponse(files("spgf_torch.serving").joinpath("start.html").read_bytes())

    async def health(self, request: Request) -> Response:
        """Whether it would answer, and who."""
        about = self.predictions.about
        if about is None:
            return JSONResponse({"ready": False}, 503, {"Retry-After": str(RETRY)})
        state = {"in_flight": self.predictions.inside, "last": self.last or None}
        return JSONResponse({"ready": True, "model": about, **state})

    async def measured(self, request: Request) -> Response:
        """Counters, as Prometheus reads them."""
        return Response(self.metrics.text(), headers={"Content-Type": CONTENT_TYPE})

    async def described(self, request: Request) -> Response:
        """The OpenAPI description."""
        return JSONResponse(openapi(self.config, self.reasons))

    async def docs(self, request: Request) -> Response:
        """The same, to be read."""
        return HTMLResponse(docs_page(openapi(self.config, self.reasons)))


async def _still_there(request: Request) -> None:
    """Raises ClientDisconnect where nobody waits for the answer."""
    if await request.is_disconnected():
        raise ClientDisconnect


def _error(request: Request, status: int, line: str, headers: Mapping[str, str] | None = None) -> Response:
    request.scope["told"] = one_line(line)
    return JSONResponse({"error": one_line(line)}, status, headers)


async def _refused(request: Request, error: Exception) -> Response:
    return _error(request, 400, str(error))


async def _told(request: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)
    line = error.detail
    if error.status_code == 405 or (error.status_code == 404 and "endpoint" not in request.scope):
        line = f"expected an address and a method that /docs lists, got {request.method} {request.url.path:.80}"
    return _error(request, error.status_code, line, error.headers)


async def _left(request: Request, error: Exception) -> Response:
    return _error(request, LEFT, "the connection was cut")


async def _broken(request: Request, error: Exception) -> Response:
    return _error(request, 500, "the server has a defect, which its log tells")
