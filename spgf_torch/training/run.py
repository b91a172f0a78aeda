"""One training: objects and trials are read, the experiment is run, model and judge are written into a folder."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from spgf_torch.affordance.config import JUDGE
from spgf_torch.compiled import loops_kept, loops_wanted
from spgf_torch.experiment.config import TrainConfig, is_recorded
from spgf_torch.files.run_settings import write_settings
from spgf_torch.progress import ProgressReporter
from spgf_torch.training.checks import check_hand, check_name, check_recorded, check_settings
from spgf_torch.training.folds import design_of
from spgf_torch.training.taught import Taught, Tell

if TYPE_CHECKING:
    from spgf_torch.cache import Cache
    from spgf_torch.experiment.describe import Describer
    from spgf_torch.experiment.design import Design
    from spgf_torch.experiment.experiment import Learned
    from spgf_torch.judging.judge_training import Course


@dataclass(frozen=True)
class Material:
    """What is learned from, and how.

    Attributes:
        why: nothing is measured, if so. course: how a judge is learned, if one is.
        made: whether the trials were made in this run.
    """

    taught: Taught
    design: Design
    why: str
    course: Course | None = None
    made: bool = False


def run(config: TrainConfig, folder: Path, stages: ProgressReporter, tell: Tell) -> None:
    """Describe the objects, cross-validate, learn on all of them; write results and the model into `folder`.

    With `judge=learn` a judge of the hand, and the trials that were made to teach it, go beside the model. `tell` hears
    every line and table that a person should read.

    Raises InputError for what cannot be used, before anything is written.
    """
    check_settings(config)
    place = check_name(config)
    cache = _opened(config)
    with cache.going_on():
        _run(config, folder, place, cache, stages, tell)


def _run(
    config: TrainConfig, folder: Path, place: Path | None, cache: Cache, stages: ProgressReporter, tell: Tell
) -> None:
    """`run`, of settings that were looked at; `place`: where the model is kept by a name, too."""
    start = time.perf_counter()
    if config.classwise and config.final_model:
        tell("classwise: each class is learned by itself, no model of all objects is kept")
        config = replace(config, final_model=False)
    material = _material(config, cache, stages, tell)
    if material.made:
        config = replace(config, trials=str(folder / "trials"))
    results = _votes(config, folder, material, cache, stages, tell)
    if material.course is not None:
        results["judge"] = _judge(material.course, material.taught, folder, tell)
    if material.made:
        _keep(material.taught, config, folder)
    _finish({**results, "seconds": {**stages.seconds, "total": time.perf_counter() - start}}, material, folder, tell)
    tell(f"results, model and settings in {folder}" if config.final_model else f"results and settings in {folder}")
    if place is not None:
        _named(place, folder, tell)
    if material.course is not None:
        tell(
            "a judge is beside them: predict and evaluate of this folder (model=) rank by it, with judge=none by votes"
        )


def _named(place: Path, folder: Path, tell: Tell) -> None:
    """The model of this run by its name, in few bytes."""
    from spgf_torch.affordance.small_config import SmallConfig
    from spgf_torch.files.given_paths import model_and_judge
    from spgf_torch.proposing.kept_model import keep

    for line in keep(place, model_and_judge(folder, None), SmallConfig()):
        tell(line)


def _opened(config: TrainConfig) -> Cache:
    """The cache, once hand, device and all else that the machine must have are looked at."""
    from spgf_torch.affordance.model import check_device
    from spgf_torch.cache import Cache
    from spgf_torch.experiment.dictionary import check_dictionary
    from spgf_torch.simulation.executors import check_address

    check_address(config.runner, config.address)
    check_device(config.device)
    check_dictionary(config)
    check_hand(config)
    return Cache.open(config.cache, config.cache_gb)


def _material(config: TrainConfig, cache: Cache, stages: ProgressReporter, tell: Tell) -> Material:
    if is_recorded(config.trials):
        from spgf_torch.training.recorded import recorded

        check_recorded(config)
        taught = recorded(config, cache, stages, tell)
        return Material(taught, *_design(taught, config, tell))
    from spgf_torch.training.simulated import Simulation

    simulation = Simulation(config, cache, stages, tell)
    objects = simulation.objects()
    design, why = _design(Taught(objects, []), config, tell)
    course = simulation.course(objects)
    tables, made = simulation.tables(objects, course)
    return Material(Taught(objects, tables), design, why, course, made)


def _design(taught: Taught, config: TrainConfig, tell: Tell) -> tuple[Design, str]:
    """The folds, and why nothing is measured, if so, which is told."""
    design, why = design_of([obj.category for obj in taught.objects()], config)
    if why := why or taught.why_unmeasured:
        tell(f"no rates: {why}; a model is learned all the same, evaluate objects=OTHERS measures it")
    return design, why


def _keep(taught: Taught, config: TrainConfig, folder: Path) -> None:
    """Trials that were made, beside the model, and the settings that name them."""
    from spgf_torch.judging.making_trials import TRIALS, write_tables

    write_tables(taught.simulated, folder / TRIALS)
    write_settings(folder, config)


def _votes(
    config: TrainConfig, folder: Path, material: Material, cache: Cache, stages: ProgressReporter, tell: Tell
) -> dict[str, Any]:
    """The paper's experiment on these trials: its results; the model and what was predicted are written."""
    from spgf_torch.experiment.cluster import cluster_of
    from spgf_torch.experiment.dictionary import load_dictionary
    from spgf_torch.experiment.experiment import Experiment

    taught, design = material.taught, material.design
    objects = taught.objects()
    _tell_of_compiling(tell)
    if (dictionary := load_dictionary(config, design, objects)) is not None:
        tell(dictionary.told)
    describer = _describer(config, cache)
    with cluster_of(config.address) as cluster:
        examples = taught.examples(replace(describer, cluster=cluster), stages)
        learned = Experiment.of(config, design, objects, examples, cache, dictionary).run(stages, cluster)
    if config.ranking == JUDGE:
        from spgf_torch.judging.candidates import CandidateRanking  # brings scikit-learn

        bodies: Any = taught.seen  # and their tables, which `check_recorded` sees to
        judged = CandidateRanking.of(config, cache).scores(design, bodies, taught.simulated, examples, stages)
        scores = [each.joined_by(JUDGE, score) for each, score in zip(learned.scores, judged, strict=True)]
        learned = replace(learned, scores=scores)
    results = _measured(config, folder, material, learned) | {"from_cache": dict(cache.hits)}
    if dictionary is not None:
        results["prototypes_from"] = dict(dictionary.about)
    return results | _saved(config, folder, material, learned, describer, results)


def _tell_of_compiling(tell: Tell) -> None:
    """That the first steps of the stages take longer, where this machine has no compiled loops yet."""
    if loops_wanted() and not loops_kept("kmeans.add_nearest"):
        tell("compiling inner loops, once on this machine: some two minutes, in the first steps of the stages")


def _measured(config: TrainConfig, folder: Path, material: Material, learned: Learned) -> dict[str, Any]:
    """Results of what was predicted on novel objects, which is written, or why there are none."""
    from spgf_torch.evaluation.files import write_per_object
    from spgf_torch.evaluation.predictions import Predictions, write_predictions
    from spgf_torch.evaluation.results import build_results, unmeasured_results
    from spgf_torch.experiment.labelled_grasps import dataset_digest

    objects, tables = material.taught.objects(), material.taught.by_object()
    dataset = dataset_digest(objects, tables)
    if material.why:
        return unmeasured_results(tables[0].grasp_types, config, dataset, material.why)
    rows: Iterable[Any] = zip(objects, tables, learned.scores, material.design.fold.tolist(), strict=True)
    predictions = [Predictions.of(*row) for row in rows]
    write_per_object(folder / "per_object.csv", predictions, config.N)
    write_predictions(folder / "predictions.parquet", predictions)
    return build_results(predictions, config, dataset)


def _saved(
    config: TrainConfig,
    folder: Path,
    material: Material,
    learned: Learned,
    describer: Describer,
    results: dict[str, Any],
) -> dict[str, Any]:
    """Models and the card in the folder; what the model costs."""
    from spgf_torch.affordance.model import save_model
    from spgf_torch.evaluation.card import model_card
    from spgf_torch.experiment.costs import prediction_ms
    from spgf_torch.experiment.held_out import save_fold_models
    from spgf_torch.files.writing import write_text
    from spgf_torch.hands.carried_hand import carry
    from spgf_torch.hands.hand import load_hand

    taught = material.taught
    if learned.of_fold:
        save_fold_models(learned.of_fold, taught.objects(), material.design.fold.tolist(), folder)
    if (model := learned.model) is None:
        return {}
    size, trials = save_model(model, folder), sum(map(len, taught.tables))
    carry(load_hand(config.hand), folder)
    milliseconds = prediction_ms(model, describer, taught.seen, taught.tables)
    write_text(folder / "README.md", model_card(results, config, len(taught.members), trials, size))
    return {"costs": {"model_bytes": size, "prediction_ms": milliseconds}}


def _describer(config: TrainConfig, cache: Cache) -> Describer:
    """What describes objects as the settings say."""
    from spgf_torch.experiment.describe import Describer
    from spgf_torch.experiment.labelled_grasps import open_hand

    rooms, volumes = (config.sensing, config.features, config.affordance), open_hand(config.hand)
    return Describer(*rooms, volumes, config.seed, config.device, cache, config.constellations)


def _judge(course: Course, taught: Taught, folder: Path, tell: Tell) -> dict[str, Any]:
    """Learn the judge; write it, and the trials of its rounds, beside the model. How it did on held-out objects."""
    from spgf_torch.judging.validation import executed_table

    lessons = course.judge(taught.simulated)
    course.save(lessons, folder, "JUDGE.md")
    tell(executed_table(dict(lessons.judge.results["executed"]), course.shop.config.best))
    return dict(lessons.judge.results)


def _finish(results: dict[str, Any], material: Material, folder: Path, tell: Tell) -> None:
    """Write the results, the last of the files, and tell what came out."""
    from spgf_torch.evaluation.files import write_results
    from spgf_torch.evaluation.tables import (
        calibration_lines,
        chosen_line,
        hopeless_types,
        judge_lines,
        results_table,
    )

    write_results(folder, results)
    contents: Sequence[Any] = []
    if not material.why:
        contents = [results_table(results), chosen_line(results), *calibration_lines(results), *judge_lines(results)]
    for content in contents:
        tell(content)
    if tables := material.taught.simulated:
        for line in hopeless_types(tables, results["hand"]):
            tell(line)
