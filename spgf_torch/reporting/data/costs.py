"""What runs cost, as they tell it: seconds of training, milliseconds of a prediction, bytes of the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from spgf_torch.errors import InputError
from spgf_torch.evaluation.results import read_results
from spgf_torch.reporting.data.runs import Run

# ProgressReporter of `train` that runs with the same features share through the cache, and what of them is kept there.
SHARED = {"features": "features", "particles": "pairs", "prototypes": "prototypes"}
OWN = "voting"


@dataclass(frozen=True)
class Costs:
    """What a run cost; None where it does not say.

    Attributes:
        training_s: features, particles, prototypes and voting of all folds; sensing and the look for sensed
            collisions, which all rows share, are left out.
        at_least: a part of that was read from the cache by every run that could have told its time.
        prediction_ms: an object, from its texlets to the scores of its candidates. model_bytes: the saved model.
    """

    training_s: float | None
    at_least: bool
    prediction_ms: float | None
    model_bytes: int | None


def costs_of(runs: Sequence[Run]) -> dict[str, Costs]:
    """Stamp of each run -> its costs. Raises InputError where results cannot be read.

    What a run read from the cache is taken from one of the others that made the same.
    """
    told = [(run, read_results(run.folder / "results.json")) for run in runs]
    try:
        return {run.stamp: _costs(run, results, told) for run, results in told}
    except InputError:
        raise
    except (AttributeError, TypeError, ValueError) as error:
        names = ", ".join(run.folder.name for run in runs)
        raise InputError(f"{names}: expected seconds and costs in results.json as numbers, got {error}") from None


def _costs(run: Run, results: dict[str, Any], told: Sequence[tuple[Run, dict[str, Any]]]) -> Costs:
    own: dict[str, Any] = results.get("costs", {})
    seconds, at_least = own.get("training_s"), False
    stages = results.get("seconds", {})
    if seconds is None and OWN in stages:
        seconds = stages[OWN]
        for stage, kind in SHARED.items():
            alike = [r for other, r in [(run, results), *told] if _shares(run, other, stage)]
            timed = [r for r in alike if stage in r.get("seconds", {})]
            made = [r["seconds"][stage] for r in timed if not r.get("from_cache", {}).get(kind)]
            seconds, at_least = seconds + (made or [stages.get(stage, 0.0)])[0], at_least or not made
    return Costs(seconds, at_least, own.get("prediction_ms"), own.get("model_bytes"))


def _shares(run: Run, other: Run, stage: str) -> bool:
    """Whether both need the same of a stage: features alone decide, and K of prototypes."""
    same = other.settings.get("features") == run.settings.get("features")
    return same and (stage != "prototypes" or other.K == run.K)
