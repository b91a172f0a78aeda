"""One training: objects and trials are read, the experiment is run, model and judge are written into a folder."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from spgf_torch.affordance.config import JUDGE
from spgf_torch.errors import InputError
from spgf_torch.experiment.config import TrainConfig
from spgf_torch.files.run_settings import write_settings
from spgf_torch.paths import find
from spgf_torch.progress import ProgressReporter
from spgf_torch.training.checks import check_hand, check_recorded, check_settings, default_trials, is_recorded
from spgf_torch.training.folds import design_of
from spgf_torch.training.taught import Taught, Tell

if TYPE_CHECKING:
    from spgf_torch.cache import Cache
    from spgf_torch.experiment.describe import Describer
    from spgf_torch.experiment.design import Design
    from spgf_torch.judging.judge_training import Course
    from spgf_torch.objects.grasp_object import GraspObject
    from spgf_torch.simulation.table import TrialTable


def run(config: TrainConfig, folder: Path, stages: ProgressReporter, tell: Tell) -> None:
    """Describe the objects, cross-validate, learn on all of them; write results and the model into `folder`.

    With `judge=learn` a judge of the hand, and the trials that were made to teach it, go beside the model. `tell` hears
    every line and table that a person should read.

    Raises InputError for what cannot be used, before anything is written.
    """
    check_settings(config)

    from spgf_torch.affordance.model import check_device
    from spgf_torch.cache import Cache
    from spgf_torch.evaluation.files import write_results
    from spgf_torch.experiment.dictionary import check_dictionary
    from spgf_torch.simulation.executors import check_address

    check_address(config.runner, config.address)
    check_device(config.device)
    check_dictionary(config)
    check_hand(config)
    start, cache = time.perf_counter(), Cache.open(config.cache, config.cache_gb)
    if config.classwise and config.final_model:
        tell("classwise: each class is learned by itself, no model of all objects is kept")
        config = replace(config, final_model=False)
    course, made = None, False
    if is_recorded(find(config.trials)):
        from spgf_torch.training.recorded import recorded

        check_recorded(config)
        taught = recorded(config, cache, stages, tell)
        design, why = _design(taught, config, tell)
    else:
        objects = _objects(config, cache, stages, tell)
        design, why = _design(Taught(objects, []), config, tell)
        course = _course(objects, config, cache, stages, tell)
        tables, made = _tables(objects, config, course, cache, stages, tell)
        taught = Taught(objects, tables)
    if made:
        config = replace(config, trials=str(folder / "trials"))
    results = _votes(config, folder, taught, design, why, cache, stages, tell)
    if made:
        _keep(taught.tables, config, folder)
    if course is not None:
        results["judge"] = _judge(course, taught.tables, folder, tell)
    write_results(folder, {**results, "seconds": {**stages.seconds, "total": time.perf_counter() - start}})
    _told(results, taught, config, tell)
    tell(f"results, model and settings in {folder}" if config.final_model else f"results and settings in {folder}")
    if course is not None:
        tell(
            "a judge is beside them: predict and evaluate of this folder (model=) rank by it, with judge=none by votes"
        )


def _told(results: dict[str, Any], taught: Taught, config: TrainConfig, tell: Tell) -> None:
    """What came out."""
    from spgf_torch.evaluation.results import NO_RATES
    from spgf_torch.evaluation.tables import (
        calibration_lines,
        chosen_line,
        hopeless_types,
        judge_lines,
        results_table,
    )

    if NO_RATES not in results:
        for content in (
            results_table(results),
            chosen_line(results),
            *calibration_lines(results),
            *judge_lines(results),
        ):
            tell(content)
    for line in hopeless_types(taught.simulated, config.hand.name) if taught.simulated else ():
        tell(line)


def _objects(config: TrainConfig, cache: Cache, stages: ProgressReporter, tell: Tell) -> list[GraspObject]:
    from spgf_torch.objects.folders import read_objects

    found = read_objects(config, stages, cache)
    for note in found.notes:
        tell(note)
    return found.objects


def _design(taught: Taught, config: TrainConfig, tell: Tell) -> tuple[Design, str]:
    """The folds, and why nothing is measured, if so, which is told."""
    design, why = design_of([obj.category for obj in taught.objects()], config)
    if why := why or taught.why_unmeasured:
        tell(f"no rates: {why}; a model is learned all the same, evaluate objects=OTHERS measures it")
    return design, why


def _course(
    objects: Sequence[GraspObject], config: TrainConfig, cache: Cache, stages: ProgressReporter, tell: Tell
) -> Course | None:
    """How a judge is learned, if one is asked for; InputError where the settings do not go together."""
    if config.judge == "none":
        return None
    from spgf_torch.judging.judge_training import Course
    from spgf_torch.judging.settings import VOTES, judge_settings
    from spgf_torch.judging.settings import stages as plan

    settings = judge_settings(config)
    random, *others = plan(settings, tried=False)
    stages.plan = [random, *VOTES, *others]
    course = Course.of(objects, settings, cache, stages)
    if (folds := course.shop.config.folds) != config.folds:
        tell(f"judge: {folds} folds in the place of {config.folds}, one for each object; its rates are of so few")
    return course


def _tables(
    objects: Sequence[GraspObject],
    config: TrainConfig,
    course: Course | None,
    cache: Cache,
    stages: ProgressReporter,
    tell: Tell,
) -> tuple[list[TrialTable], bool]:
    """The random trials on each object, and whether they were made here.

    They are where `trials` is not given, and what it stands for is of another hand or other objects.
    """
    from spgf_torch.experiment.labelled_grasps import tables_of
    from spgf_torch.hands.hand import load_hand
    from spgf_torch.simulation.worker import Trials

    try:
        return tables_of(objects, config.trials, Trials(load_hand(config.hand), config.episode), config.sampler), False
    except InputError as error:
        if config.trials != (shipped := default_trials()):
            raise
        count = config.random_trials if course is None else course.shop.config.candidates
        tell(
            f"random trials: {count} of each type on each object are made here, those in {shipped} are others ({error})"
        )
        if course is not None:
            return course.made_tables(), True
        from spgf_torch.judging.making_trials import random_trials

        return random_trials(objects, config, cache, stages), True


def _keep(tables: Sequence[Any], config: TrainConfig, folder: Path) -> None:
    """Trials that were made, beside the model, and the settings that name them."""
    from spgf_torch.judging.making_trials import TRIALS, write_tables

    write_tables(tables, folder / TRIALS)
    write_settings(folder, config)


def _votes(
    config: TrainConfig,
    folder: Path,
    taught: Taught,
    design: Design,
    why: str,
    cache: Cache,
    stages: ProgressReporter,
    tell: Tell,
) -> dict[str, Any]:
    """The paper's experiment on these trials: its results; the model and what was predicted are written.

    why: nothing is measured, if so.
    """
    from spgf_torch.affordance.model import save_model
    from spgf_torch.evaluation.card import model_card
    from spgf_torch.evaluation.results import unmeasured_results
    from spgf_torch.experiment.cluster import cluster_of
    from spgf_torch.experiment.costs import prediction_ms
    from spgf_torch.experiment.dictionary import load_dictionary
    from spgf_torch.experiment.experiment import Experiment
    from spgf_torch.experiment.held_out import save_fold_models
    from spgf_torch.experiment.labelled_grasps import dataset_digest
    from spgf_torch.files.writing import write_text

    objects, tables = taught.objects(), taught.by_object()
    if (dictionary := load_dictionary(config, design, objects)) is not None:
        tell(dictionary.told)
    describer = _describer(config, cache)
    with cluster_of(config.address) as cluster:
        examples = taught.examples(replace(describer, cluster=cluster), stages)
        learned = Experiment.of(config, design, objects, examples, cache, dictionary).run(stages, cluster)
    scores = learned.scores
    if config.ranking == JUDGE:
        from spgf_torch.judging.candidates import CandidateRanking  # brings scikit-learn

        bodies: Any = taught.seen  # and their tables, which `check_recorded` sees to
        judged = CandidateRanking.of(config, cache).scores(design, bodies, taught.simulated, examples, stages)
        scores = [each.joined_by(JUDGE, score) for each, score in zip(scores, judged, strict=True)]

    dataset = dataset_digest(objects, tables)
    if why:
        results = unmeasured_results(describer.grasp_types, config, dataset, why)
    else:
        results = _measured(config, folder, zip(objects, tables, scores, design.fold.tolist(), strict=True), dataset)
    results |= {"from_cache": dict(cache.hits)}
    if dictionary is not None:
        results["prototypes_from"] = dict(dictionary.about)
    if (model := learned.model) is not None:
        size = save_model(model, folder)
        milliseconds = prediction_ms(model, describer, taught.seen, taught.tables)
        results["costs"] = {"model_bytes": size, "prediction_ms": milliseconds}
        write_text(folder / "README.md", model_card(results, config, len(objects), sum(map(len, tables)), size))
    if learned.of_fold:
        save_fold_models(learned.of_fold, objects, design.fold.tolist(), folder)
    return results


def _measured(config: TrainConfig, folder: Path, rows: Any, dataset: str) -> dict[str, Any]:
    """Results of what was predicted on novel objects, `rows` of an object, its trials, scores and fold; all written."""
    from spgf_torch.evaluation.files import write_per_object
    from spgf_torch.evaluation.predictions import Predictions, write_predictions
    from spgf_torch.evaluation.results import build_results

    predictions = [Predictions.of(*row) for row in rows]
    write_per_object(folder / "per_object.csv", predictions, config.N)
    write_predictions(folder / "predictions.parquet", predictions)
    return build_results(predictions, config, dataset)


def _describer(config: TrainConfig, cache: Cache) -> Describer:
    """What describes objects as the settings say."""
    from spgf_torch.experiment.describe import Describer
    from spgf_torch.experiment.labelled_grasps import open_hand

    rooms, volumes = (config.sensing, config.features, config.affordance), open_hand(config.hand)
    return Describer(*rooms, volumes, config.seed, config.device, cache, config.constellations)


def _judge(course: Course, tables: Sequence[Any], folder: Path, tell: Tell) -> dict[str, Any]:
    """Learn the judge; write it, and the trials of its rounds, beside the model. How it did on held-out objects."""
    from spgf_torch.judging.validation import executed_table

    lessons = course.judge(tables)
    course.save(lessons, folder, "JUDGE.md")
    tell(executed_table(dict(lessons.judge.results["executed"]), course.shop.config.best))
    return dict(lessons.judge.results)
