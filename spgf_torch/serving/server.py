"""A server at an address: bound before anything is loaded, bounded in connections and time, stopped in order."""

from __future__ import annotations

import asyncio
import socket
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from spgf_torch.errors import InputError
from spgf_torch.serving.app import App
from spgf_torch.serving.config import ServeConfig
from spgf_torch.serving.metrics import Metrics
from spgf_torch.serving.middleware import LOOPBACK
from spgf_torch.serving.predictions import Predictions

# Bytes of a request's head at most: settings are short.
HEAD = 1 << 16


def bound(host: str, port: int) -> socket.socket:
    """A socket at an address, not yet listening. Raises InputError where it cannot be had."""
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    except OSError as error:
        raise InputError(f"host: expected an address of this machine, got {host!r:.80} ({error.strerror})") from None
    own = socket.socket(family, kind, protocol)
    try:
        own.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # a port whose server has just stopped
        own.bind(address)
        own.listen(1)  # of two that bound, the second hears now that the port is taken
        return own
    except OSError as error:
        own.close()
        raise InputError(
            f"port: expected a free one of {host}, got {port} ({error.strerror}); port=0 takes any"
        ) from None


def url(own: socket.socket) -> str:
    """Where a bound socket is asked."""
    host, port = own.getsockname()[:2]
    return f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"


def serve(config: ServeConfig, own: socket.socket, reasons: Mapping[str, str], ready: Callable[[], None]) -> None:
    """Load the model, then serve until a signal comes, which is raised again once all is in order.

    Args:
        reasons: see `App`. ready: called when the model is loaded and requests are answered.

    Raises InputError for a model that cannot be loaded.
    """
    metrics = Metrics()
    predictions = Predictions(config, metrics)
    try:
        predictions.start()
        with tempfile.TemporaryDirectory(prefix="spgf_serve_") as folder:
            app = App(config, predictions, metrics, reasons, Path(folder))
            server = uvicorn.Server(settings_of(config, app))
            ready()
            server.run([own])
    finally:
        predictions.close()
        own.close()


def settings_of(config: ServeConfig, app: App) -> uvicorn.Config:
    """uvicorn's settings: a request a connection, no logs of its own but of defects."""
    return uvicorn.Config(
        app.asgi,
        http=_protocol(config),
        ws="none",
        lifespan="off",
        log_config=None,
        log_level="error",
        access_log=False,
        server_header=False,
        headers=[("Connection", "close")],
        h11_max_incomplete_event_size=HEAD,
        timeout_graceful_shutdown=round(config.stop_seconds + 0.5),
    )


def _protocol(config: ServeConfig) -> type[asyncio.Protocol]:
    """HTTP as uvicorn speaks it, without the connections that are too many, too slow to ask or too slow to listen."""
    longest = config.head_seconds + config.body_seconds + config.wait_seconds + 2 * config.seconds + config.stop_seconds

    class Bounded(H11Protocol):
        def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
            super().connection_made(transport)
            if len(self.connections) > config.connections:
                transport.abort()
                return
            self._ends = [
                self.loop.call_later(config.head_seconds, self._end_unless_asked),
                self.loop.call_later(longest, transport.abort),
            ]

        def connection_lost(self, exc: Exception | None) -> None:
            super().connection_lost(exc)
            for timer in getattr(self, "_ends", ()):
                timer.cancel()

        def _end_unless_asked(self) -> None:
            if self.cycle is None:
                self.transport.abort()

    return Bounded


def is_own(host: str) -> bool:
    """Whether nobody but this machine can ask at an address."""
    return host in LOOPBACK
