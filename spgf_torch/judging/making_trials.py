"""Random trials that are made where none are given, and what makes trials of any kind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from omegaconf import OmegaConf

from spgf_torch.cache import Cache
from spgf_torch.experiment.config import TrainConfig
from spgf_torch.experiment.labelled_grasps import open_hand
from spgf_torch.files.digests import sealed_yaml
from spgf_torch.files.writing import write_bytes
from spgf_torch.hands.hand import load_hand
from spgf_torch.judging.config import JudgeConfig
from spgf_torch.judging.rounds import Workshop, random_tables
from spgf_torch.judging.settings import judge_settings
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.progress import ProgressReporter
from spgf_torch.proposing.clearance import Clearance
from spgf_torch.proposing.hypotheses import Search
from spgf_torch.simulation.executors import executor_of
from spgf_torch.simulation.table import TrialTable, table_path, write_table
from spgf_torch.simulation.worker import Trials

# Folder in a run's: random trials, where they were made.
TRIALS = "trials"


def workshop_of(config: JudgeConfig, cache: Cache, stages: ProgressReporter) -> Workshop:
    """What makes the trials that the settings describe."""
    proposing = config.proposing
    clearances = (proposing.plane_clearance, proposing.between, proposing.obstacle_clearance)
    search = Search.of(Clearance(open_hand(config.hand), *clearances), config.hypotheses)
    trials = Trials(load_hand(config.hand), config.episode)
    executor = partial(executor_of, config.workers, config.time_limit, config.address)
    return Workshop(trials, search, config, cache, stages, executor)


def random_trials(
    objects: Sequence[GraspObject], config: TrainConfig, cache: Cache, stages: ProgressReporter
) -> list[TrialTable]:
    """`config.random_trials` random trials of each type on each object, for votes alone."""
    settings = replace(judge_settings(config), candidates=config.random_trials)
    return random_tables(objects, workshop_of(settings, cache, stages))


def write_tables(tables: Sequence[TrialTable], folder: Path) -> None:
    """Random trials that were made, as `simulate` would leave them in `folder`."""
    folder.mkdir()
    made = {key: getattr(tables[0].provenance, key) for key in ("candidates", "seed", "sampler", "episode")}
    write_bytes(folder / "config.yaml", sealed_yaml(OmegaConf.to_yaml(OmegaConf.create(made))))
    for table in tables:
        write_table(table_path(folder, table.object_name), table)
