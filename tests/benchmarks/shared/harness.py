"""Ratios to named peers: all take turns in one run, so that whatever else the machine does slows all of them alike.

A benchmark makes a `Report`, adds figures and rows of measurements to it, and writes it to tests/benchmarks/results.
"""

from __future__ import annotations

import importlib
import json
import os
import platform
import statistics
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from multiprocessing import get_context
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

import torch
from threadpoolctl import threadpool_limits

R = TypeVar("R")
RESULTS = Path(__file__).parents[1] / "results"
PACKAGES = (
    *("torch", "numpy", "scipy", "sapien", "trimesh", "embreex"),
    *("open3d-cpu", "open3d", "scikit-learn", "faiss-cpu", "mujoco"),
)


@dataclass
class Report:
    """What one benchmark found.

    Attributes:
        name: of the file of results.
        about: what was measured on what, in a sentence or two.
        figures: what docs/benchmarks.md shows: figure, asked, measured in words.
        rows: every measurement, as plain values.
        skipped: what was not measured, and why.
    """

    name: str
    about: str
    figures: list[dict[str, str]] = field(default_factory=list)
    rows: list[dict[str, Any]] = field(default_factory=list)
    skipped: list[str] = field(default_factory=list)

    def figure(self, figure: str, asked: str, measured: str) -> None:
        self.figures.append({"figure": figure, "asked": asked, "measured": measured})
        print(f"{self.name}: {figure}: {measured}" + (f" (asked: {asked})" if asked else ""), flush=True)

    def row(self, **values: Any) -> None:
        self.rows.append({key: _rounded(value) for key, value in values.items()})
        print("  " + "  ".join(f"{key} {value}" for key, value in self.rows[-1].items()), flush=True)

    def skip(self, what: str) -> None:
        self.skipped.append(what)
        print(f"{self.name}: skipped: {what}", flush=True)

    def peer(self, module: str, package: str | None = None) -> ModuleType | None:
        """The peer's module, or None and a line where it is not installed."""
        try:
            return importlib.import_module(module)
        except ImportError:
            self.skip(f"{package or module} is not installed (pip install 'spgf-torch[peers]')")
            return None

    def devices(self) -> list[str]:
        """cpu, and cuda where there is one."""
        if torch.cuda.is_available():
            return ["cpu", "cuda"]
        self.skip("device=cuda: no accelerator here")
        return ["cpu"]

    def write(self) -> None:
        content = {"about": self.about, "command": f"python tests/benchmarks/{self.name}.py", "machine": machine()}
        content |= {"figures": self.figures, "rows": self.rows, "skipped": self.skipped}
        RESULTS.mkdir(exist_ok=True)
        (RESULTS / f"{self.name}.json").write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n")


def take_turns(methods: dict[str, Callable[[], Any]], rounds: int, warm: bool = True) -> dict[str, float]:
    """The median seconds of each method, all in turn in every round; first once without a clock if `warm`."""
    seconds: dict[str, list[float]] = {name: [] for name in methods}
    if warm:
        for call in methods.values():
            call()
    for _ in range(rounds):
        for name, call in methods.items():
            start = time.perf_counter()
            call()
            synchronise()
            seconds[name].append(time.perf_counter() - start)
    return {name: statistics.median(values) for name, values in seconds.items()}


def processor(call: Callable[[], Any]) -> float:
    """Seconds of processor, of all threads together, that a call takes: what a busy machine changes least."""
    start = time.process_time()
    call()
    return time.process_time() - start


@contextmanager
def threads(count: int) -> Iterator[None]:
    """Everybody may use `count` threads: torch, and the OpenMP and BLAS of the peers."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    with threadpool_limits(count):
        yield
    torch.set_num_threads(before)


def in_process(count: int, work: Callable[..., R], *arguments: Any) -> R:
    """work(*arguments) in a process of its own in which OMP_NUM_THREADS is `count`.

    For peers with an OpenMP inside them that `threads` cannot reach, such as Open3D's: it reads that once.
    """
    before = os.environ.get("OMP_NUM_THREADS")
    os.environ["OMP_NUM_THREADS"] = str(count)
    try:
        with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
            return pool.submit(work, *arguments).result()
    finally:
        if before is None:
            del os.environ["OMP_NUM_THREADS"]
        else:
            os.environ["OMP_NUM_THREADS"] = before


def synchronise() -> None:
    """Wait until an accelerator is done."""
    if torch.cuda.is_available():
        torch.cuda.synchronize()


def machine() -> dict[str, Any]:
    """The machine and the software in words; no name and no path."""
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "memory_gb": round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9),
        "load": round(os.getloadavg()[0], 1),
        "accelerator": torch.cuda.get_device_name() if torch.cuda.is_available() else "none",
        "python": platform.python_version(),
        "packages": {name: found for name in PACKAGES if (found := _version(name))},
    }


def _processor() -> str:
    words = Path("/proc/cpuinfo").read_text().splitlines() if sys.platform == "linux" else []
    return next((line.split(":", 1)[1].strip() for line in words if line.startswith("model name")), platform.machine())


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _rounded(value: Any) -> Any:
    return float(f"{value:.4g}") if isinstance(value, float) else value
