"""Objects, trials, sensed collisions and training samples together, as the settings name them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from spgf_torch.affordance.config import AffordanceConfig
from spgf_torch.affordance.model import check_device
from spgf_torch.baselines.config import BaselineConfig
from spgf_torch.baselines.samples import Samples, load_samples, open_export, shards_of
from spgf_torch.cache import Cache, code_fingerprint, fingerprint
from spgf_torch.evaluation.folds import stratified_folds
from spgf_torch.experiment.describe import CachedSteps, Describer
from spgf_torch.experiment.described_object import sample_of_each_type
from spgf_torch.experiment.labelled_grasps import dataset_digest, open_hand, tables_of
from spgf_torch.features.config import FeatureConfig
from spgf_torch.hands.hand import load_hand
from spgf_torch.objects.folders import read_objects
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.progress import ProgressReporter
from spgf_torch.settings import plain, settings
from spgf_torch.simulation.execute import Trials
from spgf_torch.simulation.table import TrialTable

AUTO = "auto"  # device: the GPU, if there is one


@dataclass(frozen=True)
class Data:
    """All that is known of the objects, in their order.

    Attributes:
        fold: (objects,) int, where each is novel.
        collides: of each (G,) bool, a sensed point inside the open hand.
        taught: of each the rows (C,) int64 of `samples` that may teach.
        symmetric: (types,) bool, whether half a turn about the approach makes the same grasp.
        describer: how the objects are sensed, and the hand.
    """

    objects: Sequence[GraspObject]
    tables: Sequence[TrialTable]
    fold: np.ndarray
    collides: Sequence[Tensor]
    samples: Samples
    taught: Sequence[Tensor]
    symmetric: Tensor
    describer: Describer

    def of(self, i: int, rows: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Types, sensed collisions and outcomes of some rows of an object."""
        own, table = rows - self.samples.start[i], self.tables[i]
        return table.grasp_type[own], self.collides[i][own], table.success[own]

    @property
    def grasp_types(self) -> tuple[str, ...]:
        """Those of the hand, in the order of the tables' codes."""
        return self.tables[0].grasp_types

    @property
    def digest(self) -> str:
        """Names objects and trials, as in the results of `train`."""
        return dataset_digest(self.objects, self.tables)


def usable_device(name: str) -> str:
    """The device that the settings name. Raises InputError where torch has none of this name here."""
    known = ("cuda" if torch.cuda.is_available() else "cpu") if name == AUTO else name
    check_device(known)
    return known


def read_data(config: BaselineConfig, device: str, stages: ProgressReporter) -> Data:
    """Everything that the settings name; the samples are on `device`.

    Raises InputError in one line for objects, trials or an export that cannot be used, or do not belong together.
    """
    cache = Cache.open(config.cache, config.cache_gb)
    objects = read_objects(config, stages, cache).objects
    fold = stratified_folds([obj.category for obj in objects], config.folds, config.seed)
    folder, radius = open_export(config, objects, fold)
    shards = shards_of(folder, config.folds)
    hand = load_hand(config.hand)
    symmetric = torch.tensor([preshape.symmetry == 2 for _, preshape in sorted(hand.preshapes.items())])
    tables = tables_of(objects, config.trials, Trials(hand, config.episode), config.sampler)
    volumes = open_hand(config.hand)
    features, affordance = settings(FeatureConfig), settings(AffordanceConfig)  # not used: no feature is asked for
    describer = Describer(config.sensing, features, affordance, volumes, config.seed, "cpu", cache)
    collides = []
    with stages.stage("collisions", len(objects), "objects") as advance:
        for obj, table in zip(objects, tables, strict=True):
            collides.append(CachedSteps(describer, obj, table).collides)
            advance(1)
    with stages.stage("reading", len(shards), "shards") as advance:
        samples = load_samples(shards, radius, objects, tables, fold, advance).to(device)
    taught = taught_rows(tables, samples.start, config.trials_per_object, config.seed)
    return Data(objects, tables, fold, collides, samples, taught, symmetric, describer)


def provenance_of(data: Data, config: BaselineConfig) -> str:
    """Names all that the networks depend on."""
    learned = [plain(part) for part in (config.network, config.augment, config.learning)]
    device = data.samples.cloud.device.type
    made = code_fingerprint("spgf_torch.baselines.folds")
    return fingerprint(made, data.digest, data.samples.cloud, data.fold, *data.taught, *learned, config.seed, device)


def taught_rows(tables: Sequence[TrialTable], start: Sequence[int], count: int, seed: int) -> list[Tensor]:
    """Of each object the rows of at most `count` grasps of each type: those that `train` takes."""
    generator = torch.Generator().manual_seed(seed)
    rows = zip(tables, start, strict=False)
    return [first + sample_of_each_type(table.grasp_type, count, generator) for table, first in rows]
