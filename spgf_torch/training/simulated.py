"""Objects and the trials that simulation made on them, earlier or here."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from spgf_torch.cache import Cache
from spgf_torch.errors import InputError
from spgf_torch.experiment.config import TrainConfig
from spgf_torch.progress import ProgressReporter
from spgf_torch.training.checks import default_trials
from spgf_torch.training.taught import Tell

if TYPE_CHECKING:
    from spgf_torch.judging.judge_training import Course
    from spgf_torch.objects.grasp_object import GraspObject
    from spgf_torch.simulation.table import TrialTable


@dataclass(frozen=True)
class Simulation:
    """What trials of simulation are read or made with; `tell` hears what a person should know."""

    config: TrainConfig
    cache: Cache
    stages: ProgressReporter
    tell: Tell

    def objects(self) -> list[GraspObject]:
        """Those of the folder in the settings."""
        from spgf_torch.objects.folders import read_objects

        found = read_objects(self.config, self.stages, self.cache)
        for note in found.notes:
            self.tell(note)
        return found.objects

    def course(self, objects: Sequence[GraspObject]) -> Course | None:
        """How a judge is learned, if one is asked for; InputError where the settings do not go together."""
        if self.config.judge == "none":
            return None
        from spgf_torch.judging.judge_training import Course
        from spgf_torch.judging.settings import VOTES, judge_settings
        from spgf_torch.judging.settings import stages as plan

        settings = judge_settings(self.config)
        random, *others = plan(settings, tried=False)
        self.stages.plan = [random, *VOTES, *others]
        course = Course.of(objects, settings, self.cache, self.stages)
        if (folds := course.shop.config.folds) != settings.folds:
            self.tell(
                f"judge: {folds} folds in the place of {settings.folds}, one for each object: its rates are of few"
            )
        return course

    def tables(self, objects: Sequence[GraspObject], course: Course | None) -> tuple[list[TrialTable], bool]:
        """The random trials on each object, and whether they were made here.

        They are where `trials` is not given, and what it stands for is of another hand or other objects.
        """
        from spgf_torch.experiment.labelled_grasps import tables_of
        from spgf_torch.hands.hand import load_hand
        from spgf_torch.simulation.worker import Trials

        config = self.config
        trials = Trials(load_hand(config.hand), config.episode)
        try:
            return tables_of(objects, config.trials, trials, config.sampler), False
        except InputError:
            if config.trials != (shipped := default_trials()):
                raise
            count = config.random_trials if course is None else course.shop.config.candidates
            self.tell(
                f"random trials: {count} of each type on each object are made here; those in {shipped} are of another "
                "hand, episode or other objects"
            )
        if course is not None:
            return course.made_tables(), True
        from spgf_torch.judging.making_trials import random_trials

        return random_trials(objects, config, self.cache, self.stages), True
