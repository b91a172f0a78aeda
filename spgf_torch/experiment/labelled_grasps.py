"""The grasps that were tried on the objects, and the open hand that would try them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from spgf_torch.affordance.sensed_collision import HandVolume, hand_volumes
from spgf_torch.cache import fingerprint
from spgf_torch.errors import InputError
from spgf_torch.experiment.describe import Grasps, TriedGrasps
from spgf_torch.experiment.named import Identity
from spgf_torch.files.reading import yaml_values
from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import load_hand
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.paths import find
from spgf_torch.simulation.config import SamplerConfig
from spgf_torch.simulation.execute import Trials, provenance_of
from spgf_torch.simulation.table import TrialTable, read_tables


def tables_of(objects: Sequence[GraspObject], place: str, trials: Trials, sampler: SamplerConfig) -> list[TrialTable]:
    """The trial tables of objects in the folder `place`, in their order.

    Raises InputError where a table is missing, damaged, of other grasp types than the hand's, or was made with another
    hand, object, sampler or episode than the settings'. How many candidates, which seed and which budget is up to the
    table, the same for all of its files.
    """
    folder = find(place)
    counts = _made_with(folder / "config.yaml")
    first = provenance_of(objects[0], trials, sampler, *counts)  # all but the object is the same for all
    expected = [replace(first, object_name=obj.name, object_digest=obj.digest) for obj in objects]
    return read_tables(folder, expected, trials.grasp_types)


def dataset_digest(objects: Sequence[Identity], tables: Sequence[TriedGrasps]) -> str:
    """Names the objects and their trials: runs on different ones cannot be compared."""
    parts = [
        (obj.name, obj.category, obj.digest, Grasps(table.T_object_tcp, table.grasp_type), table.success)
        for obj, table in zip(objects, tables, strict=True)
    ]
    return fingerprint(parts)


def open_hand(config: HandConfig) -> dict[str, HandVolume]:
    """Grasp type -> the volume of the hand in its preshape, in the TCP frame."""
    return hand_volumes(load_hand(config))


def _made_with(path: Path) -> tuple[int, int, int | None]:
    """How many candidates of each type, the seed and the budget of the trials that `simulate` left beside this file."""
    if not path.is_file():
        raise InputError(f"{path}: expected the settings of a trial table (python -m spgf_torch.simulate), got no file")
    settings = yaml_values(path, "the keys candidates and seed", sealed=True)
    try:
        candidates, seed = int(settings["candidates"]), int(settings["seed"])
        budget = settings.get("budget")  # older ones have no such key
        return candidates, seed, None if budget is None else int(budget)
    except (KeyError, TypeError, ValueError, OverflowError):
        raise InputError(f"{path}: expected the keys candidates and seed, got something else") from None
