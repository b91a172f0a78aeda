"""Objects whose trials need no physics: the outcome follows from the pose. What runs trials is what is tested.

Imports nothing heavy: processes that try them are there at once.
"""

from __future__ import annotations

import os
import signal
import time
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

WORDS = ("success", "collision", "missed", "dropped", "slipped", "rotated")
# No hand, no episode: only what tells them apart.
TYPES = ("NPG", "WPG")
TRIALS: Any = SimpleNamespace(
    hand=SimpleNamespace(digest="toy hand"),
    episode="toy episode",
    grasp_types=TYPES,
    samplers=dict.fromkeys(TYPES, "surface_pairs"),
)


@dataclass
class Toy:
    """A block; its mesh is only there where candidates are sampled.

    Attributes:
        hazards: checksum of a pose -> what happens in that trial: "crash", "hang", "raise", or "crash once FILE".
        unmade: what happens when it is made: "crash" or "raise".
        log: file that each trial adds a line to.
        seconds: that a trial takes.
    """

    name: str
    hazards: dict[int, str] = field(default_factory=dict)
    unmade: str = ""
    log: str = ""
    seconds: float = 0.0
    category: str = "boxes"
    com: tuple[float, ...] = (0.0, 0.0, 0.04)

    def __reduce__(self) -> tuple[Any, ...]:
        return Toy, (self.name, self.hazards, self.unmade, self.log, self.seconds)

    @property
    def digest(self) -> str:
        return f"toy {self.name}"

    @cached_property
    def mesh(self) -> Any:
        import trimesh

        return trimesh.creation.box((0.05, 0.06, 0.08))


def toss(obj: Toy, trials: Any, kind: str) -> Callable[[np.ndarray], str]:
    """An attempt that takes `obj.seconds`, says that it ran, and falls into what hazards there are."""
    _suffer(obj.unmade)

    def attempt(T: np.ndarray) -> str:
        mark = checksum(T)
        _suffer(obj.hazards.get(mark, ""))
        time.sleep(obj.seconds)
        if obj.log:
            line = f"{obj.name} {kind} {mark}\n".encode()
            handle = os.open(obj.log, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
            os.write(handle, line)
            os.close(handle)
        return WORDS[mark % len(WORDS)]

    return attempt


def checksum(T: np.ndarray) -> int:
    """Of one pose (4, 4) float32."""
    return zlib.crc32(np.ascontiguousarray(T).tobytes())


def _suffer(hazard: str) -> None:
    what, _, file = hazard.partition(" once ")
    if file and Path(file).exists():
        return
    if file:
        Path(file).touch()
    if what == "crash":
        os.kill(os.getpid(), signal.SIGKILL)
    if what == "hang":
        time.sleep(600)
    if what == "raise":
        raise ValueError("no such thing\nas this")
