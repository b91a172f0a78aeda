"""Learn grasping affordances from local shape: Sliced Pineapple Grid Features and shape-grasp particles.

After Thomsen, Kraft, Krueger: A Semi-local Surface Feature for Learning Successful Grasping Affordances (2016).
"""

from __future__ import annotations

import gc
import importlib
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from spgf_torch.errors import InputError
    from spgf_torch.features.estimator import SPGF
    from spgf_torch.grasps.grasps import Grasps
    from spgf_torch.hands.description_file import load_hand_file
    from spgf_torch.hands.records import Grasp
    from spgf_torch.predictor import Predictor
    from spgf_torch.prototypes.estimator import Prototypes
    from spgf_torch.scene.scene import Scene
    from spgf_torch.sensing.texlets import Texlets
    from spgf_torch.training.api import train

__all__ = [
    "SPGF",
    "Grasp",
    "Grasps",
    "InputError",
    "Predictor",
    "Prototypes",
    "Scene",
    "Texlets",
    "__version__",
    "load",
    "load_hand_file",
    "train",
]
__version__ = "0.1.0"  # pyproject.toml reads it here

# Where each name is; it is imported when it is asked for, since most of them need torch.
_HOMES = {
    "SPGF": "spgf_torch.features.estimator",
    "Grasp": "spgf_torch.hands.records",
    "Grasps": "spgf_torch.grasps.grasps",
    "InputError": "spgf_torch.errors",
    "load_hand_file": "spgf_torch.hands.description_file",
    "Predictor": "spgf_torch.predictor",
    "Prototypes": "spgf_torch.prototypes.estimator",
    "Scene": "spgf_torch.scene.scene",
    "Texlets": "spgf_torch.sensing.texlets",
    "train": "spgf_torch.training.api",
}

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


@contextmanager
def _uncollected() -> Iterator[None]:
    """Without garbage collection, which looks at all of torch's objects again and again while modules are imported."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


def load(
    folder: str | Path, device: str = "cpu", judge: str | Path | None = None, proposing: str | None = None
) -> Predictor:
    """Load the model in `folder`, or of that name, and the hand that it was learned for.

    A judge in the folder proposes, and ranks by probability; so does one of the same hand in the folder `judge`. With
    `judge="none"` the votes do, as they do where there is no judge. The first prediction takes seconds more than the
    others; `load(folder).ready()` has that done now, such as before a robot's first cloud comes.

    Args:
        folder: a folder, the name of a model (`models/NAME`, or one that comes with the package, as `panda` does), or
            `latest`: what `train` did last.
        device: `cpu`, or an accelerator that torch knows, such as `cuda`.
        judge: name or folder of a judge, or `none`.
        proposing: `clutter`: what is planned for is a whole table of things, or stands among others (conf/proposing).

    Raises:
        InputError: there is no such model, it is damaged, or the judge is of another hand.

    A ball of 3 cm radius, seen from all around:

    >>> import spgf_torch, torch
    >>> model = spgf_torch.load("panda")
    >>> outwards = torch.nn.functional.normalize(torch.randn(20000, 3, generator=torch.Generator().manual_seed(0)))
    >>> scene = spgf_torch.Scene.from_points((0.03 * outwards).numpy(), normals=outwards.numpy())
    >>> grasps = model.predict(scene, top=3)
    >>> sorted({grasp.type for grasp in grasps}), grasps[0].T_input_tcp.shape
    (['NPG', 'WPG'], (4, 4))
    >>> bool(grasps[0].probability >= grasps[-1].probability > 0)
    True
    """
    with _uncollected():
        from spgf_torch.predictor import Predictor

        return Predictor.load(folder, device, proposing, judge=judge)


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
