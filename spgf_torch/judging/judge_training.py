"""From a hand and objects to its judge: random trials, clouds, rounds of trials of its own choosing, learning."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from spgf_torch.cache import Cache
from spgf_torch.errors import InputError
from spgf_torch.evaluation.folds import stratified_folds
from spgf_torch.experiment.held_out import load_fold_judges, save_fold_judges
from spgf_torch.experiment.labelled_grasps import tables_of
from spgf_torch.files.writing import write_text
from spgf_torch.hands.carried_hand import carry
from spgf_torch.judging.card import judge_card
from spgf_torch.judging.clouds import training_clouds
from spgf_torch.judging.collision_survey import survey
from spgf_torch.judging.config import JudgeConfig
from spgf_torch.judging.learning import calibration_of, judge_of, learn_judge
from spgf_torch.judging.making_trials import workshop_of
from spgf_torch.judging.objects_that_fit import fits
from spgf_torch.judging.own_trials import OwnProvenance, OwnTrials, read_own, write_own
from spgf_torch.judging.rounds import Workshop, own_round, own_rows, random_rows, random_tables
from spgf_torch.judging.scene_learning import scene_lessons
from spgf_torch.judging.scene_rounds import SceneShop
from spgf_torch.judging.scene_trials import SceneTrials, origin_of, read_scene_trials, write_scene_trials
from spgf_torch.judging.settings import with_folds_for
from spgf_torch.judging.training_rows import Bench, Rows
from spgf_torch.judging.validation import cross_validated, executed, validation_rows
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.paths import find
from spgf_torch.progress import ProgressReporter
from spgf_torch.proposing.judge import Judge, load_judge, save_judge
from spgf_torch.settings import plain
from spgf_torch.simulation.executors import check_address
from spgf_torch.simulation.table import TrialTable
from spgf_torch.threads import in_parts

# Folder in a run's: the trials of the rounds.
OWN_TRIALS = "own_trials"


@dataclass(frozen=True)
class Lessons:
    """What a course ends with.

    Attributes:
        judge: of all objects. of_fold: fold -> a judge that has not seen its objects. own: the trials of the rounds.
        scenes: those in scenes; None: it learned from single objects alone.
    """

    judge: Judge
    of_fold: Mapping[int, Judge]
    own: Sequence[OwnTrials]
    scenes: SceneTrials | None = None


@dataclass(frozen=True)
class Course:
    """A hand's course on these objects.

    Attributes:
        fold: (objects,) of each: who chooses trials on it, and who is measured, has not seen it.
        given: the trials of the rounds, where the settings name tables of them.
    """

    objects: Sequence[GraspObject]
    fold: np.ndarray
    shop: Workshop
    given: list[OwnTrials] | None

    @staticmethod
    def of(objects: Sequence[GraspObject], config: JudgeConfig, cache: Cache, stages: ProgressReporter) -> Course:
        """InputError where the settings, the objects and the tables do not go together."""
        check_address(config.runner, config.address)
        config = with_folds_for(config, len(objects))
        shop, given = workshop_of(config, cache, stages), None
        fold = _folds(objects, config)
        if config.own_trials is not None:
            expected = [OwnProvenance.of(obj, shop.trials, config) for obj in objects]
            given = read_own(find(config.own_trials), expected, shop.trials.grasp_types)
        return Course(objects, fold, shop, given)

    def tables(self) -> list[TrialTable]:
        """The random trials on each object: of the tables that the settings name, or made here."""
        config = self.shop.config
        if config.trials is None:
            return self.made_tables()
        return tables_of(self.objects, config.trials, self.shop.trials, config.sampler)

    def made_tables(self) -> list[TrialTable]:
        """The random trials on each object, tried here."""
        return random_tables(self.objects, self.shop)

    def judge(self, tables: Sequence[TrialTable]) -> Lessons:
        """What random trials and those of the rounds teach."""
        benches = self._benches()
        rows = Rows.together([self._surveyed(benches), random_rows(benches, tables, self.shop)])
        if not len(rows) or not rows.success.any():
            raise InputError(
                f"candidates: expected random trials that hold, got none of {int(rows.tried.sum())} that sensed points "
                "leave free; give more candidates, or objects that fit the hand"
            )
        own: list[OwnTrials] = []
        for number in range(1, self.shop.config.rounds + 2):  # the last is that of validation
            its = self.given or own_round(benches, self._judges(rows), self.fold, number, self.shop)
            rows = Rows.together([rows, own_rows(benches, its, number, self.shop)])
            own = [OwnTrials.together(parts) for parts in zip(own, its, strict=True)] if own else its
        with self.shop.stages.stage("learning", self.shop.config.folds, "judges") as advance:
            of_fold = self._of_fold(rows, advance)
        lessons = Lessons(self._learned(rows, benches, of_fold), of_fold, self.given or own)
        return lessons if self.shop.config.context is None else self.in_scenes(lessons)

    def known(self, folder: Path) -> Lessons:
        """The judges that an earlier call left. Raises InputError for those of another hand or other folds."""
        judge, folds = load_judge(folder), load_fold_judges(folder)
        judge.check_hand(plain(self.shop.config.hand), "this hand")
        its = [folds.fold_of(obj) for obj in self.objects]
        if its != self.fold.tolist():
            raise InputError(f"known: expected the folds of seed={self.shop.config.seed}, got others in {folder}")
        return Lessons(judge, folds.models, [])

    def in_scenes(self, lessons: Lessons) -> Lessons:
        """The same judges, which learned in scenes, too."""
        config, given = self.shop.config, None
        if config.scene_trials is not None:
            given = read_scene_trials(find(config.scene_trials), self._origin(), self.shop.trials.grasp_types)
        pools = [
            [obj for obj, its in zip(self.objects, self.fold.tolist(), strict=True) if its == fold]
            for fold in range(config.folds)
        ]
        found = scene_lessons(SceneShop(self.shop, pools, lessons.of_fold), given)
        of_fold = {fold: found.taught(judge, fold) for fold, judge in lessons.of_fold.items()}
        judge = found.taught(lessons.judge, None)
        judge = replace(judge, results={**judge.results, "in_scenes": found.results})
        return Lessons(judge, of_fold, lessons.own, found.trials)

    def _origin(self) -> dict[str, Any]:
        return origin_of(self.objects, self.shop.trials, self.shop.config)

    def _benches(self) -> list[Bench]:
        """Each object with its clouds and, unless what was chosen of them is known, hypotheses."""
        config, search = self.shop.config, self.shop.search
        known = self.given is not None and not config.surveyed

        def bench(index: int) -> Bench:
            clouds = training_clouds(self.objects[index], config)
            if known:
                return Bench(index, self.objects[index], clouds, [], [])
            return Bench.of(index, self.objects[index], clouds, search)

        name = "clouds" if known else "hypotheses"
        with self.shop.stages.stage(name, len(self.objects), "objects") as advance:
            return [(advance(1), done)[1] for done in in_parts(bench, range(len(self.objects)))]

    def _surveyed(self, benches: Sequence[Bench]) -> Rows:
        """Rows of hypotheses whose freedom the meshes tell."""
        shop = self.shop
        with shop.stages.stage("survey", len(benches), "objects") as advance:
            work = in_parts(lambda bench: survey(bench, shop.trials.hand, shop.search, shop.config), benches)
            return Rows.together([(advance(1), rows)[1] for rows in work])

    def _judges(self, rows: Rows) -> dict[int, Judge]:
        """Of each fold one that has learned from the objects of the others."""
        config, folds = self.shop.config, torch.from_numpy(self.fold)[rows.obj]
        judges = {}
        with self.shop.stages.stage("learning", config.folds, "judges") as advance:
            for held_out in range(config.folds):
                judges[held_out] = judge_of(learn_judge(rows.at(folds != held_out), config, ["images"]), [], config)
                advance(1)
        return judges

    def _of_fold(self, rows: Rows, advance: Callable[[int], None]) -> dict[int, Judge]:
        """Of each fold a judge that the rows of the others' objects teach, calibrated with what was executed on these.

        The executed grasps were ranked by judges of which each had not seen its own fold, but this one's.
        """
        config, fold = self.shop.config, torch.from_numpy(self.fold)
        best = validation_rows(rows, config)
        judges = {}
        for held_out in range(config.folds):
            taught = [obj for obj, its in zip(self.objects, self.fold.tolist(), strict=True) if its != held_out]
            judge = judge_of(learn_judge(rows.at(fold[rows.obj] != held_out), config), taught, config)
            calibration = calibration_of(best.at(fold[best.obj] != held_out))
            judges[held_out] = replace(judge, settings=self._settings(judge), calibration=calibration)
            advance(1)
        return judges

    def _settings(self, judge: Judge) -> dict[str, Any]:
        """A judge's, with how clouds were sensed, too: a judge alone tells predict the spacing of texlets."""
        return {**judge.settings, "sensing": plain(self.shop.config.sensing)}

    def _learned(self, rows: Rows, benches: Sequence[Bench], of_fold: Mapping[int, Judge]) -> Judge:
        """The judge that all rows teach, with how others did on objects that they had not seen."""
        config, shop = self.shop.config, self.shop
        with shop.stages.stage("fit", len(benches), "objects") as advance:
            work = in_parts(lambda bench: fits(bench.obj, shop.trials.hand, shop.search, config), benches)
            fit = {bench.index: (advance(1), its)[1] for bench, its in zip(benches, work, strict=True)}
        with shop.stages.stage("learning", 1, "judges") as advance:
            results: dict[str, Any] = {
                "executed": executed(rows, benches, self.fold, fit, config),
                "unfit": {
                    name: [bench.obj.name for bench in benches if not fit[bench.index][on_table]]
                    for name, on_table in (("alone", False), ("on a table", True))
                },
                "cross_validated": cross_validated(rows, benches, self.fold, of_fold),
                "rows": len(rows),
                "trials": _counted(rows),
            }
            judge = judge_of(learn_judge(rows, config), self.objects, config)
            advance(1)
        calibration = calibration_of(validation_rows(rows, config))
        return replace(judge, results=results, settings=self._settings(judge), calibration=calibration)

    def save(self, lessons: Lessons, folder: Path, card: str) -> int:
        """Write the judge, its card by the name `card`, and the trials of the rounds; bytes of the judge's arrays.

        With `fold_judges` those of the folds, too.
        """
        size = save_judge(lessons.judge, folder)
        carry(self.shop.trials.hand, folder)
        write_text(folder / card, judge_card(lessons.judge, self.shop.config, size))
        if self.given is None and lessons.own:
            (folder / OWN_TRIALS).mkdir()
            for its in lessons.own:
                write_own(folder / OWN_TRIALS, its)
        if lessons.scenes is not None:
            write_scene_trials(folder, lessons.scenes, self._origin(), self.shop.trials.grasp_types)
        if self.shop.config.fold_judges:
            save_fold_judges(lessons.of_fold, self.objects, self.fold.tolist(), folder)
        return size


def _folds(objects: Sequence[GraspObject], config: JudgeConfig) -> np.ndarray:
    """The fold (objects,) of each; InputError where there are fewer objects than folds."""
    if len(objects) < config.folds:
        raise InputError(
            f"objects: expected one at least for each of the folds ({config.folds}), got {len(objects)} in "
            f"{config.objects}; more objects, or folds={max(2, len(objects))}"
        )
    return stratified_folds([obj.category for obj in objects], config.folds, config.seed)


def _counted(rows: Rows) -> dict[str, Any]:
    """How many trials taught, of random ones by rows, and of the rounds at home."""
    return {
        "surveyed_rows": int((~rows.tried).sum()),
        "random_rows": int((rows.tried & (rows.round == 0)).sum()),
        "own": int(rows.home.sum()),
        "own_held": int((rows.home & rows.success).sum()),
    }
