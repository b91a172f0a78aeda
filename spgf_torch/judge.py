"""`python -m spgf_torch.judge hand=panda`: a hand's judge of grasp hypotheses, from trials of its own choosing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from spgf_torch.cli import door
from spgf_torch.config import InputError, JudgeConfig
from spgf_torch.given import check_folder
from spgf_torch.progress import Stages, show

if TYPE_CHECKING:
    import numpy as np

    from spgf_torch.judging.rounds import Workshop
    from spgf_torch.judging.rows import Bench, Rows
    from spgf_torch.objects.grasp_object import GraspObject
    from spgf_torch.proposing.judge import Judge


def run(config: JudgeConfig, folder: Path) -> None:
    """Sense the objects, try random and then chosen grasps, learn, measure; write the judge into `folder`."""
    check_folder("objects", config.objects, "a folder of meshes or descriptions")
    if config.trials is not None:
        check_folder("trials", config.trials, "the trial tables that simulate leaves")

    from spgf_torch.cache import Cache
    from spgf_torch.experiment.tried import open_hand
    from spgf_torch.judging.card import judge_card
    from spgf_torch.judging.rounds import Workshop
    from spgf_torch.judging.validation import executed_table
    from spgf_torch.objects.folders import read_objects
    from spgf_torch.proposing.clearance import Clearance
    from spgf_torch.proposing.hypotheses import Search
    from spgf_torch.proposing.judge import save_judge
    from spgf_torch.trials.attempts import Trials
    from spgf_torch.trials.hand import load_hand
    from spgf_torch.writing import write_text

    stages, cache, proposing = Stages(), Cache.open(config.cache, config.cache_gb), config.proposing
    found = read_objects(config, stages, cache)
    for note in found.notes:
        show(note)
    fold = _folds(found.objects, config)
    clearances = (proposing.plane_clearance, proposing.between, proposing.obstacle_clearance)
    search = Search.of(Clearance(open_hand(config.hand), *clearances), config.hypotheses)
    shop = Workshop(Trials(load_hand(config.hand), config.episode), search, config, cache, stages)
    benches = _benches(found.objects, shop)
    rows = _trials(benches, fold, shop)
    judge = _learned(rows, benches, fold, shop)
    size = save_judge(judge, folder)
    write_text(folder / "README.md", judge_card(judge, config, size))
    show(executed_table(dict(judge.results["executed"]), config.best))
    show(f"judge of {size / 1e6:.2f} MB and settings in {folder}; predict judge=FOLDER, evaluate judge=FOLDER use it")


def _folds(objects: Sequence[GraspObject], config: JudgeConfig) -> np.ndarray:
    """The fold (objects,) of each; InputError where there are fewer objects than folds."""
    from spgf_torch.evaluation.folds import stratified_folds

    if len(objects) < config.folds:
        raise InputError(
            f"objects: expected one at least for each of the folds ({config.folds}), got {len(objects)} in "
            f"{config.objects}; more objects, or folds={max(2, len(objects))}"
        )
    return stratified_folds([obj.category for obj in objects], config.folds, config.seed)


def _benches(objects: Sequence[GraspObject], shop: Workshop) -> list[Bench]:
    """Each object with its clouds and hypotheses."""
    from spgf_torch.judging.clouds import training_clouds
    from spgf_torch.judging.rows import Bench
    from spgf_torch.threads import in_parts

    def bench(index: int) -> Bench:
        return Bench.of(index, objects[index], training_clouds(objects[index], shop.config), shop.search)

    with shop.stages.stage("hypotheses", len(objects), "objects") as advance:
        return [(advance(1), done)[1] for done in in_parts(bench, range(len(objects)))]


def _surveyed(benches: Sequence[Bench], shop: Workshop) -> Rows:
    """Rows of hypotheses whose freedom the meshes tell."""
    from spgf_torch.judging.rows import Rows
    from spgf_torch.judging.survey import survey
    from spgf_torch.threads import in_parts

    with shop.stages.stage("survey", len(benches), "objects") as advance:
        work = in_parts(lambda bench: survey(bench, shop.trials.hand, shop.search, shop.config), benches)
        return Rows.together([(advance(1), rows)[1] for rows in work])


def _trials(benches: Sequence[Bench], fold: np.ndarray, shop: Workshop) -> Rows:
    """Rows of random trials, then of each round: who chooses has learned from the objects of the other folds."""
    import torch

    from spgf_torch.judging.learning import judge_of, learn_judge
    from spgf_torch.judging.rounds import own_trials, random_trials
    from spgf_torch.judging.rows import Rows

    config = shop.config
    rows = Rows.together([_surveyed(benches, shop), random_trials(benches, shop)])
    _check(rows)
    for number in range(1, config.rounds + 2):  # the last is that of validation
        folds = torch.from_numpy(fold)[rows.obj]
        with shop.stages.stage("learning", config.folds, "judges") as advance:
            judges = {}
            for held_out in range(config.folds):
                judges[held_out] = judge_of(learn_judge(rows.at(folds != held_out), config, ["images"]), [], config)
                advance(1)
        rows = Rows.together([rows, own_trials(benches, judges, fold, number, shop)])
    return rows


def _learned(rows: Rows, benches: Sequence[Bench], fold: np.ndarray, shop: Workshop) -> Judge:
    """The judge that all rows teach, with how others did on objects that they had not seen."""
    from spgf_torch.judging.fitting import fits
    from spgf_torch.judging.learning import calibration_of, judge_of, learn_judge
    from spgf_torch.judging.validation import cross_validated, executed, validation_rows
    from spgf_torch.threads import in_parts

    config, stages = shop.config, shop.stages
    with stages.stage("fit", len(benches), "objects") as advance:
        work = in_parts(lambda bench: fits(bench.obj, shop.trials.hand, shop.search, config), benches)
        fit = {bench.index: (advance(1), its)[1] for bench, its in zip(benches, work, strict=True)}
    with stages.stage("learning", config.folds + 1, "judges") as advance:
        results: dict[str, Any] = {
            "executed": executed(rows, benches, fold, fit, config),
            "unfit": {
                name: [bench.obj.name for bench in benches if not fit[bench.index][on_table]]
                for name, on_table in (("alone", False), ("on a table", True))
            },
            "cross_validated": cross_validated(rows, benches, fold, config),
            "rows": len(rows),
            "trials": _counted(rows),
        }
        advance(config.folds)
        judge = judge_of(learn_judge(rows, config), [bench.obj for bench in benches], config)
        advance(1)
    results["seconds"] = {name: round(seconds, 1) for name, seconds in stages.seconds.items()}
    return replace(judge, results=results, calibration=calibration_of(validation_rows(rows, config)))


def _check(rows: Rows) -> None:
    """InputError where random trials teach nothing: nothing to learn from would make a judge of nothing."""
    if not len(rows) or not rows.success.any():
        raise InputError(
            f"candidates: expected random trials that hold, got none of {int(rows.tried.sum())} that sensed points "
            "leave free; give more candidates, or objects that fit the hand"
        )


def _counted(rows: Rows) -> dict[str, Any]:
    """How many trials taught, of random ones by rows, and of the rounds at home."""
    return {
        "surveyed_rows": int((~rows.tried).sum()),
        "random_rows": int((rows.tried & (rows.round == 0)).sum()),
        "own": int(rows.home.sum()),
        "own_held": int((rows.home & rows.success).sum()),
    }


if __name__ == "__main__":
    door("judge", JudgeConfig, run)
