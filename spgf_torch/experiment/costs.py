"""What a model costs: its bytes, and the time of a prediction on this machine, measured where nothing is cached."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from statistics import median

from spgf_torch.affordance.model import GraspModel
from spgf_torch.cache import Cache
from spgf_torch.experiment.describe import CachedSteps, Describer, GraspPoses, Seen
from spgf_torch.experiment.loaded_model import LoadedModel

# Objects that are predicted on: seconds in all, and the median is not one object's.
OBJECTS = 5


def prediction_ms(
    model: GraspModel, describer: Describer, objects: Sequence[Seen], tried: Sequence[GraspPoses]
) -> float:
    """Milliseconds from an object's texlets to the scores of all its tried grasps: the median over a few objects.

    Describing, pairing and voting are counted, nothing from a cache; sensing is not, nor what a model is made ready
    with once.
    """
    loaded = LoadedModel(model, replace(describer, cache=Cache(None)))
    _ = loaded.index
    chosen = range(0, len(objects), max(1, len(objects) // OBJECTS))
    return 1000 * median(_seconds(loaded, objects[i], tried[i]) for i in chosen)


def _seconds(loaded: LoadedModel, obj: Seen, tried: GraspPoses) -> float:
    steps = CachedSteps(loaded.describer, obj, tried)
    _ = steps.texlets
    start = time.perf_counter()
    loaded.scores(steps.described())
    return time.perf_counter() - start
