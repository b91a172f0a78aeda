"""What a server counts, as Prometheus reads it."""

from __future__ import annotations

from prometheus_client import (
    CollectorRegistry,
    Counter,
    Gauge,
    Histogram,
    disable_created_metrics,
    generate_latest,
)
from prometheus_client.exposition import CONTENT_TYPE_LATEST

CONTENT_TYPE = CONTENT_TYPE_LATEST
disable_created_metrics()  # a line beside each counter that says when it began
# s; a warm prediction of 12,000 points takes 0.2.
SECONDS = (0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0)


class Metrics:
    """The counters of one server: requests by path and status, seconds that a request took, requests in flight."""

    def __init__(self) -> None:
        self._registry = CollectorRegistry()
        self._requests = Counter(
            "spgf_requests", "Requests that were answered", ("path", "status"), registry=self._registry
        )
        self._errors = Counter("spgf_errors", "Answers of 400 and above", ("path",), registry=self._registry)
        self._seconds = Histogram(
            "spgf_request_seconds",
            "Seconds from a request's head to the end of the answer",
            ("path",),
            buckets=SECONDS,
            registry=self._registry,
        )
        self.in_flight = Gauge(
            "spgf_in_flight", "Requests for grasps that are read, wait or are predicted", registry=self._registry
        )
        self.ready = Gauge("spgf_ready", "1: the model is loaded", registry=self._registry)
        self.restarts = Counter(
            "spgf_restarts", "Times that the predicting process was started anew", registry=self._registry
        )

    def answered(self, path: str, status: int, seconds: float) -> None:
        """Count a request; `path` is a route, of which there are few, not what was asked for."""
        self._requests.labels(path, str(status)).inc()
        self._seconds.labels(path).observe(seconds)
        if status >= 400:
            self._errors.labels(path).inc()

    def text(self) -> bytes:
        """All of them, in Prometheus' text format."""
        return generate_latest(self._registry)
