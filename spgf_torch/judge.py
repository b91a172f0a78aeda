"""`python -m spgf_torch.judge hand=panda`: a hand's judge of grasp hypotheses, from trials of its own choosing."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from spgf_torch.cli import door
from spgf_torch.config import InputError, JudgeConfig
from spgf_torch.given import check_folder
from spgf_torch.progress import Stages, show

if TYPE_CHECKING:
    import numpy as np

    from spgf_torch.cache import Cache
    from spgf_torch.judging.rows import Bench, Rows
    from spgf_torch.objects.grasp_object import GraspObject
    from spgf_torch.proposing.hypotheses import Search
    from spgf_torch.trials.attempts import Trials


def run(config: JudgeConfig, folder: Path) -> None:
    """Sense the objects, try random and then chosen grasps, learn, measure; write the judge into `folder`."""
    check_folder("objects", config.objects, "a folder of meshes or descriptions")
    if config.trials is not None:
        check_folder("trials", config.trials, "the trial tables that simulate leaves")

    from spgf_torch.cache import Cache
    from spgf_torch.experiment.tried import open_hand
    from spgf_torch.judging.card import judge_card
    from spgf_torch.judging.learning import judge_of, learn_judge
    from spgf_torch.judging.validation import cross_validated, executed, executed_table
    from spgf_torch.objects.folders import read_objects
    from spgf_torch.proposing.clearance import Clearance
    from spgf_torch.proposing.hypotheses import Search
    from spgf_torch.proposing.judge import Judge, save_judge
    from spgf_torch.trials.attempts import Trials
    from spgf_torch.trials.hand import load_hand
    from spgf_torch.writing import write_text

    stages, cache = Stages(), Cache.open(config.cache, config.cache_gb)
    found = read_objects(config, stages, cache)
    for note in found.notes:
        show(note)
    objects = found.objects
    fold = _folds(objects, config)
    proposing = config.proposing
    clearance = Clearance(
        open_hand(config.hand), proposing.plane_clearance, proposing.between, proposing.obstacle_clearance
    )
    search = Search.of(clearance, config.hypotheses)
    benches = _benches(objects, search, config, stages)
    rows = _trials(benches, fold, Trials(load_hand(config.hand), config.episode), search, config, cache, stages)
    with stages.stage("learning", config.folds + 1, "judges") as advance:
        results: dict[str, Any] = {
            "executed": executed(rows, benches, config),
            "cross_validated": cross_validated(rows, benches, fold, config),
            "rows": len(rows),
            "trials": _counted(rows),
        }
        advance(config.folds)
        judge = judge_of(learn_judge(rows, config), objects, config)
        advance(1)
    results["seconds"] = {name: round(seconds, 1) for name, seconds in stages.seconds.items()}
    judge = Judge(judge.factors, judge.settings, judge.sure, judge.taught, results)
    size = save_judge(judge, folder)
    write_text(folder / "README.md", judge_card(judge, config, size))
    show(executed_table(results["executed"], config.best))
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


def _benches(objects: Sequence[GraspObject], search: Search, config: JudgeConfig, stages: Stages) -> list[Bench]:
    """Each object with its clouds and hypotheses."""
    from spgf_torch.judging.clouds import training_clouds
    from spgf_torch.judging.rows import Bench
    from spgf_torch.threads import in_parts

    def bench(index: int) -> Bench:
        return Bench.of(index, objects[index], training_clouds(objects[index], config), search)

    with stages.stage("hypotheses", len(objects), "objects") as advance:
        return [(advance(1), done)[1] for done in in_parts(bench, range(len(objects)))]


def _trials(
    benches: Sequence[Bench],
    fold: np.ndarray,
    trials: Trials,
    search: Search,
    config: JudgeConfig,
    cache: Cache,
    stages: Stages,
) -> Rows:
    """Rows of random trials, then of each round: who chooses has learned from the objects of the other folds."""
    import torch

    from spgf_torch.judging.learning import judge_of, learn_judge
    from spgf_torch.judging.rounds import own_trials, random_trials
    from spgf_torch.judging.rows import Rows

    rows = random_trials(benches, trials, search, config, cache, stages)
    _check(rows)
    for number in range(1, config.rounds + 1):
        folds = torch.from_numpy(fold)[rows.obj]
        with stages.stage("learning", config.folds, "judges") as advance:
            judges = {}
            for held_out in range(config.folds):
                judges[held_out] = judge_of(learn_judge(rows.at(folds != held_out), config, ["images"]), [], config)
                advance(1)
        own = own_trials(benches, judges, fold, number, trials, search, config, cache, stages)
        rows = Rows.together([rows, own])
    return rows


def _check(rows: Rows) -> None:
    """InputError where random trials teach nothing: nothing to learn from would make a judge of nothing."""
    if not len(rows) or not rows.success.any():
        raise InputError(
            f"candidates: expected random trials that hold, got none of {len(rows)} that sensed points leave free; "
            "give more candidates, or objects that fit the hand"
        )


def _counted(rows: Rows) -> dict[str, Any]:
    """How many trials taught, of random ones by rows, and of the rounds at home."""
    return {
        "random_rows": int((rows.round == 0).sum()),
        "own": int(rows.home.sum()),
        "own_held": int((rows.home & rows.success).sum()),
    }


if __name__ == "__main__":
    door("judge", JudgeConfig, run)
