"""`python -m spgf_torch.train +K=20`: the experiment of the paper, and a model learned on all objects.

`ranking=judge` has candidates ranked by a learned judge, too (`judging.candidates`), cross-validated like the votes.

`hand=panda judge=learn` is all that a new hand takes: random trials, votes, rounds of own trials, a judge.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from spgf_torch.affordance.config import JUDGE
from spgf_torch.cli.command import run_command, write_settings
from spgf_torch.errors import InputError
from spgf_torch.experiment.config import TrainConfig
from spgf_torch.extras import needed
from spgf_torch.files.given_paths import check_folder, check_model, check_place
from spgf_torch.paths import root
from spgf_torch.progress import ProgressReporter, show

if TYPE_CHECKING:
    from spgf_torch.cache import Cache
    from spgf_torch.experiment.describe import Describer
    from spgf_torch.experiment.described_object import DescribedObject
    from spgf_torch.experiment.experiment import Design
    from spgf_torch.judging.judge_training import Course
    from spgf_torch.objects.grasp_object import GraspObject
    from spgf_torch.simulation.table import TrialTable


def run(config: TrainConfig, folder: Path) -> None:
    """Describe the objects, cross-validate, learn on all of them; write results and the model into `folder`.

    With `judge=learn` a judge of the hand, and the trials that were made to teach it, go beside the model.
    """
    _check_packages(config)
    _check_constellations(config)
    check_folder("objects", config.objects, "a folder of meshes or descriptions")
    if config.prototypes_from is not None:
        check_model("prototypes_from", config.prototypes_from)
    check_folder("trials", config.trials, "the trial tables that simulate leaves")
    _check_judge(config)
    place = _place(config)

    from spgf_torch.affordance.model import check_device
    from spgf_torch.cache import Cache
    from spgf_torch.evaluation.files import write_results
    from spgf_torch.evaluation.tables import calibration_lines, chosen_line, hopeless_types, judge_lines, results_table
    from spgf_torch.experiment.dictionary import check_dictionary
    from spgf_torch.objects.folders import read_objects
    from spgf_torch.simulation.executors import check_address

    check_address(config.runner, config.address)
    check_device(config.device)
    check_dictionary(config)
    _check_hand(config)
    start, stages = time.perf_counter(), ProgressReporter()
    cache = Cache.open(config.cache, config.cache_gb)
    found = read_objects(config, stages, cache)
    for note in found.notes:
        show(note)
    if config.classwise and config.final_model:
        show("classwise: each class is learned by itself, no model of all objects is kept")
        config = replace(config, final_model=False)
    design = _design(found.objects, config)
    course = _course(found.objects, config, cache, stages)
    tables, made = _tables(found.objects, config, course)
    if made:
        config = replace(config, trials=str(folder / "trials"))
    results = _votes(config, folder, found.objects, design, tables, cache, stages)
    if course is not None:
        results["judge"] = _judge(course, tables, made, config, folder)
    write_results(folder, {**results, "seconds": {**stages.seconds, "total": time.perf_counter() - start}})
    lines = [chosen_line(results), *calibration_lines(results), *judge_lines(results)]
    for content in (results_table(results), *lines, *hopeless_types(tables, config.hand.name)):
        show(content)
    show(f"results, model and settings in {folder}" if config.final_model else f"results and settings in {folder}")
    if place is not None:
        _keep(place, folder)
    if course is not None:
        show(
            "a judge is beside them: predict and evaluate of this folder (model=) rank by it, with judge=none by votes"
        )


def _check_packages(config: TrainConfig) -> None:
    """InputError for settings that need a package that is not installed."""
    if config.features.descriptor == "fpfh":
        needed("features.descriptor: fpfh", "open3d")
    if config.judge != "none":
        needed(f"judge: {config.judge}", "sklearn")
    if config.runner == "dask":
        needed("runner: dask", "distributed")
    if config.ranking == JUDGE:
        needed(f"ranking: {JUDGE}", "sklearn")


def _place(config: TrainConfig) -> Path | None:
    """Where the model is kept by its name, if it is to have one; InputError where it cannot be."""
    if config.name is None:
        return None
    if config.classwise or not config.final_model:
        raise InputError("name: expected with final_model=true and classwise=false, got no model of all objects")
    return check_place(config.name, config.replace)


def _keep(place: Path, folder: Path) -> None:
    """The model of this run by its name, in few bytes."""
    from spgf_torch.affordance.small_config import SmallConfig
    from spgf_torch.files.given_paths import model_and_judge
    from spgf_torch.proposing.kept_model import keep

    for line in keep(place, model_and_judge(folder, None), SmallConfig()):
        show(line)


def _check_hand(config: TrainConfig) -> None:
    """InputError for a hand that is not what its description says, as far as geometry tells."""
    from spgf_torch.handcheck.check import checked_hand

    checked_hand(config.hand)


def _check_constellations(config: TrainConfig) -> None:
    """InputError where words are asked for that a model cannot keep, or lie in an empty ring."""
    asked = config.constellations
    if asked.words and (config.final_model or config.fold_models):
        raise InputError(
            "constellations.words: expected with final_model=false and fold_models=false, got a model to keep"
        )
    if asked.words and asked.inner >= asked.outer:
        raise InputError(f"constellations.inner: expected less than outer, {asked.outer:g} m, got {asked.inner:g}")


def _check_judge(config: TrainConfig) -> None:
    """InputError for settings of a judge where none is to be learned, and for tables that are not there.

    A judge stands beside a model of all objects, which `classwise` leaves out.
    """
    if config.judge != "none" and config.classwise:
        raise InputError(f"classwise: expected false with judge={config.judge}, got true")
    given = {"own_trials": config.own_trials, "judging": config.judging}
    for key, value in given.items():
        if value and config.judge == "none":
            raise InputError(f"{key}: expected with judge=learn, got judge=none")
    if config.own_trials is not None:
        check_folder("own_trials", config.own_trials, "the tables of own trials that judge=learn leaves")


def _course(
    objects: Sequence[GraspObject], config: TrainConfig, cache: Cache, stages: ProgressReporter
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
    return Course.of(objects, settings, cache, stages)


def _tables(
    objects: Sequence[GraspObject], config: TrainConfig, course: Course | None
) -> tuple[list[TrialTable], bool]:
    """The random trials on each object, and whether they were made here.

    They are where a judge is learned, `trials` is not given, and what it stands for is of another hand or other
    objects.
    """
    from spgf_torch.experiment.labelled_grasps import tables_of
    from spgf_torch.hands.hand import load_hand
    from spgf_torch.simulation.worker import Trials

    try:
        return tables_of(objects, config.trials, Trials(load_hand(config.hand), config.episode), config.sampler), False
    except InputError as error:
        shipped = yaml.safe_load((root() / "conf/train.yaml").read_text(encoding="utf-8"))["trials"]
        if course is None or config.trials != shipped:
            raise
        count = course.shop.config.candidates
        show(
            f"random trials: {count} of each type on each object are made here, those in {shipped} are others ({error})"
        )
        return course.made_tables(), True


def _votes(
    config: TrainConfig,
    folder: Path,
    objects: Sequence[GraspObject],
    design: Design,
    tables: Sequence[TrialTable],
    cache: Cache,
    stages: ProgressReporter,
) -> dict[str, Any]:
    """The paper's experiment on these trials: its results; the model and what was predicted are written."""
    from spgf_torch.affordance.model import save_model
    from spgf_torch.evaluation.card import model_card
    from spgf_torch.evaluation.files import write_per_object
    from spgf_torch.evaluation.predictions import Predictions, write_predictions
    from spgf_torch.evaluation.results import build_results
    from spgf_torch.experiment.cluster import cluster_of
    from spgf_torch.experiment.costs import prediction_ms
    from spgf_torch.experiment.dictionary import load_dictionary
    from spgf_torch.experiment.experiment import Experiment
    from spgf_torch.experiment.held_out import save_fold_models
    from spgf_torch.experiment.labelled_grasps import dataset_digest
    from spgf_torch.files.writing import write_text
    from spgf_torch.hands.carried_hand import carry
    from spgf_torch.hands.hand import load_hand

    if (dictionary := load_dictionary(config, design, objects)) is not None:
        show(dictionary.told)
    describer = _describer(config, cache)
    with cluster_of(config.address) as cluster:
        examples = _examples(replace(describer, cluster=cluster), objects, tables, stages)
        learned = Experiment.of(config, design, objects, examples, cache, dictionary).run(stages, cluster)
    scores = learned.scores
    if config.ranking == JUDGE:
        from spgf_torch.judging.candidates import CandidateRanking  # brings scikit-learn

        judged = CandidateRanking.of(config, cache).scores(design, objects, tables, examples, stages)
        scores = [each.joined_by(JUDGE, score) for each, score in zip(scores, judged, strict=True)]

    rows, model = zip(objects, tables, scores, design.fold.tolist(), strict=True), learned.model
    predictions = [Predictions.of(*row) for row in rows]
    results = build_results(predictions, config, dataset_digest(objects, tables)) | {"from_cache": dict(cache.hits)}
    if dictionary is not None:
        results["prototypes_from"] = dict(dictionary.about)
    if model is not None:
        size = save_model(model, folder)
        carry(load_hand(config.hand), folder)
        results["costs"] = {"model_bytes": size, "prediction_ms": prediction_ms(model, describer, objects, tables)}
        write_text(folder / "README.md", model_card(results, config, len(objects), sum(map(len, tables)), size))
    if learned.of_fold:
        save_fold_models(learned.of_fold, objects, design.fold.tolist(), folder)
    write_per_object(folder / "per_object.csv", predictions, config.N)
    write_predictions(folder / "predictions.parquet", predictions)
    return results


def _examples(
    describer: Describer, objects: Sequence[GraspObject], tables: Sequence[TrialTable], stages: ProgressReporter
) -> list[DescribedObject]:
    """The objects with the outcomes of their trials."""
    described = describer.describe(objects, tables, stages)
    return [obj.with_success(table.success) for obj, table in zip(described, tables, strict=True)]


def _describer(config: TrainConfig, cache: Cache) -> Describer:
    """What describes objects as the settings say."""
    from spgf_torch.experiment.describe import Describer
    from spgf_torch.experiment.labelled_grasps import open_hand

    rooms, volumes = (config.sensing, config.features, config.affordance), open_hand(config.hand)
    return Describer(*rooms, volumes, config.seed, config.device, cache, config.constellations)


def _judge(
    course: Course, tables: Sequence[TrialTable], made: bool, config: TrainConfig, folder: Path
) -> dict[str, Any]:
    """Learn the judge; write it, and the trials that were made, beside the model. How it did on held-out objects."""
    from spgf_torch.judging.judge_training import TRIALS, write_tables
    from spgf_torch.judging.validation import executed_table

    lessons = course.judge(tables)
    if made:
        write_tables(tables, folder / TRIALS)
        write_settings(folder, config)
    course.save(lessons, folder, "JUDGE.md")
    show(executed_table(dict(lessons.judge.results["executed"]), course.shop.config.best))
    return dict(lessons.judge.results)


def _design(objects: Sequence[GraspObject], config: TrainConfig) -> Design:
    """Folds and order of the objects; InputError where a fold would leave fewer than two to learn from."""
    from spgf_torch.evaluation.folds import classwise_folds, stratified_folds, stratified_order
    from spgf_torch.experiment.experiment import Design

    classes = [obj.category for obj in objects]
    order = stratified_order(classes, config.seed)
    if config.classwise:
        fold, part = classwise_folds(classes, config.folds, config.seed)
        design = Design(fold, order, config.training_objects, part)
    else:
        design = Design(stratified_folds(classes, config.folds, config.seed), order, config.training_objects)
    teach = min(len(design.training(test)) for test in design.tests)
    if teach < 2:  # one is held out from the other, to calibrate
        raise InputError(
            f"objects: expected two at least to learn from in each of the folds ({config.folds}"
            f"{' of each class' if config.classwise else ''}), got {teach}: {config.objects} holds {len(objects)}"
        )
    return design


if __name__ == "__main__":
    run_command("train", TrainConfig, run)
