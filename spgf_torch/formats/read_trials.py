"""Read a trial table with everything that is exported beside it, as a `TrialSet`."""

from __future__ import annotations

from dataclasses import replace

from spgf_torch.cache import Cache
from spgf_torch.errors import InputError
from spgf_torch.evaluation.folds import stratified_folds
from spgf_torch.formats.config import ExportConfig
from spgf_torch.formats.trial_sets import TrialSet
from spgf_torch.hands.config import grasp_types
from spgf_torch.hands.hand import load_hand
from spgf_torch.hands.records import grippers_of
from spgf_torch.objects.folders import read_objects
from spgf_torch.paths import find
from spgf_torch.progress import ProgressReporter
from spgf_torch.sensing.sense import sense
from spgf_torch.simulation.table import read_table, read_tables


def read_trial_set(config: ExportConfig, stages: ProgressReporter) -> TrialSet:
    """Objects, trials and clouds that the settings name.

    Raises InputError in one line for a table that is missing, damaged, made with another hand or with other objects,
    and for a table whose object, or an object whose table, is missing.
    """
    folder = find(config.trials)
    paths = sorted(folder.glob("*.parquet"))
    if not paths:
        got = "none in it" if folder.is_dir() else "no such folder"
        raise InputError(f"{folder}: expected the trial tables that simulate leaves, got {got}")
    found = read_objects(config, stages, Cache.open(config.cache, config.cache_gb))
    names = {obj.name for obj in found.objects}
    for path in paths:
        if path.stem not in names:
            raise InputError(f"{path}: expected its object {path.stem} in objects={config.objects}, got none")
    hand = load_hand(config.hand)
    first = read_table(paths[0]).provenance  # sampler, episode, number and seed are the table's to say
    if first.hand_digest != hand.digest:
        raise InputError(f"{paths[0]}: expected trials of hand={config.hand.name}, got those of another hand")
    expected = [replace(first, object_name=obj.name, object_digest=obj.digest) for obj in found.objects]
    tables = read_tables(folder, expected, grasp_types(config.hand))
    with stages.stage("sensing", len(found.objects), "objects") as advance:
        texlets = []
        for obj in found.objects:
            texlets.append(sense(obj, config.sensing, config.seed))
            advance(1)
    fold = stratified_folds([obj.category for obj in found.objects], config.folds, config.seed)
    return TrialSet(found.objects, tables, texlets, fold, hand, grippers_of(hand), found.notes)
