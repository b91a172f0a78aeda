"""Learn grasping affordances from local shape: Sliced Pineapple Grid Features and shape-grasp particles.

After Thomsen, Kraft, Krueger: A Semi-local Surface Feature for Learning Successful Grasping Affordances (2016).
"""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from spgf_torch.predictor import Predictor
    from spgf_torch.scene.scene import Scene

__all__ = ["Scene", "__version__", "load"]
__version__ = "0.1.0"

# OpenMP threads that spin while they wait make torch many times slower as soon as another process needs the
# core; these take effect only before torch is imported, and only where the user has not set them.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
os.environ.setdefault("GOMP_SPINCOUNT", "0")


def _alone() -> None:
    """In a forked process, which has no threads but one: torch would wait for OpenMP's, which are gone, for ever."""
    torch = sys.modules.get("torch")
    if torch is not None and hasattr(torch, "set_num_threads"):
        torch.set_num_threads(1)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_alone)


def load(folder: str | Path, device: str = "cpu", judge: str | Path | None = None) -> Predictor:
    """What `train` or `judge` left in `folder`, ready to propose grasps (`spgf_torch.predictor`).

    A judge in the folder proposes, and ranks by probability; so does one of the same hand in the folder `judge`. With
    `judge="none"` the votes do, as they do where there is no judge.
    """
    from spgf_torch.predictor import Predictor

    return Predictor.load(folder, device, judge=judge).ready()


def __getattr__(name: str) -> object:
    if name == "Scene":  # looked up when it is asked for: it needs torch
        from spgf_torch.scene.scene import Scene

        return Scene
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
