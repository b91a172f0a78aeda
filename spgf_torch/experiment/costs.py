"""What a model costs: its bytes, and the time of a prediction on this machine, measured where nothing is cached."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from statistics import median

from spgf_torch.affordance.model import GraspModel
from spgf_torch.cache import Cache
from spgf_torch.experiment.describe import Description, Steps
from spgf_torch.experiment.labelled_grasps import Tried
from spgf_torch.experiment.loaded_model import Restored
from spgf_torch.objects.grasp_object import GraspObject

# Objects that are predicted on: seconds in all, and the median is not one object's.
OBJECTS = 5


def prediction_ms(
    model: GraspModel, describe: Description, objects: Sequence[GraspObject], tried: Sequence[Tried]
) -> float:
    """Milliseconds from an object's texlets to the scores of all its tried grasps: the median over a few objects.

    Describing, pairing and voting are counted, nothing from a cache; sensing is not, nor what a model is made ready
    with once.
    """
    restored = Restored(model, replace(describe, cache=Cache(None)))
    _ = restored.index
    chosen = range(0, len(objects), max(1, len(objects) // OBJECTS))
    return 1000 * median(_seconds(restored, objects[i], tried[i]) for i in chosen)


def _seconds(restored: Restored, obj: GraspObject, tried: Tried) -> float:
    steps = Steps(restored.description, obj, tried.grasps)
    _ = steps.texlets
    start = time.perf_counter()
    restored.scores(steps.described())
    return time.perf_counter() - start
