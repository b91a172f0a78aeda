"""`python -m spgf_torch.train +K=20`: the experiment of the paper, and a model learned on all objects.

`ranking=judge` has candidates ranked by a learned judge, too (`judging.candidates`), cross-validated like the votes.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from spgf_torch.cli import door
from spgf_torch.config import JUDGE, InputError, TrainConfig
from spgf_torch.given import check_folder
from spgf_torch.progress import Stages, show

if TYPE_CHECKING:
    from spgf_torch.experiment.experiment import Design
    from spgf_torch.objects.grasp_object import GraspObject


def run(config: TrainConfig, folder: Path) -> None:
    """Describe the objects, cross-validate, learn on all of them; write results and the model into `folder`."""
    check_folder("objects", config.objects, "a folder of meshes or descriptions")
    check_folder("trials", config.trials, "the trial tables that simulate leaves")

    from spgf_torch.affordance.model import check_device, save_model
    from spgf_torch.cache import Cache
    from spgf_torch.evaluation.card import model_card
    from spgf_torch.evaluation.files import write_per_object, write_predictions, write_results
    from spgf_torch.evaluation.novel import novel_objects
    from spgf_torch.evaluation.results import build_results
    from spgf_torch.evaluation.tables import calibration_line, chosen_line, judge_lines, results_table
    from spgf_torch.experiment.costs import prediction_ms
    from spgf_torch.experiment.describe import Description
    from spgf_torch.experiment.experiment import Experiment
    from spgf_torch.experiment.held_out import save_fold_models
    from spgf_torch.experiment.space import Example
    from spgf_torch.experiment.tried import dataset_digest, open_hand, tried_grasps
    from spgf_torch.objects.folders import read_objects
    from spgf_torch.writing import write_text

    check_device(config.device)
    start, stages = time.perf_counter(), Stages()
    cache = Cache.open(config.cache, config.cache_gb)
    found = read_objects(config, stages, cache)
    objects = found.objects
    for note in found.notes:
        show(note)
    design = _design(objects, config)
    tried = tried_grasps(objects, config)
    volumes = open_hand(config.hand)
    describe = Description(
        config.sensing, config.features, config.affordance, volumes, config.seed, config.device, cache
    )
    described = describe.describe(objects, [t.grasps for t in tried], stages)
    examples = [Example(d, t.success.to(config.device)) for d, t in zip(described, tried, strict=True)]
    learned = Experiment.of(config, design, objects, examples, cache).run(stages)
    predicted = learned.predicted
    if config.ranking == JUDGE:
        from spgf_torch.judging.candidates import CandidateRanking  # brings scikit-learn

        scores = CandidateRanking.of(config, cache).scores(design, objects, tried, examples, stages)
        predicted = [each.joined_by(JUDGE, score) for each, score in zip(predicted, scores, strict=True)]

    novel, model = novel_objects(objects, tried, predicted, design.fold), learned.model
    results = build_results(novel, config, dataset_digest(objects, tried)) | {"from_cache": dict(cache.hits)}
    if model is not None:
        size = save_model(model, folder)
        results["costs"] = {"model_bytes": size, "prediction_ms": prediction_ms(model, describe, objects, tried)}
        trials = sum(len(t.success) for t in tried)
        write_text(folder / "README.md", model_card(results, config, len(objects), trials, size))
    if learned.of_fold:
        save_fold_models(learned.of_fold, objects, design.fold.tolist(), folder)
    write_per_object(folder / "per_object.csv", novel, config.N)
    write_predictions(folder / "predictions.parquet", novel)
    write_results(folder, {**results, "seconds": {**stages.seconds, "total": time.perf_counter() - start}})
    for content in (results_table(results), chosen_line(results), calibration_line(results), *judge_lines(results)):
        show(content)
    show(f"results, model and settings in {folder}" if model else f"results and settings in {folder}")


def _design(objects: Sequence[GraspObject], config: TrainConfig) -> Design:
    """Folds and order of the objects; InputError where a fold would leave fewer than two to learn from."""
    import numpy as np

    from spgf_torch.evaluation.folds import stratified_folds, stratified_order
    from spgf_torch.experiment.experiment import Design

    classes = [obj.category for obj in objects]
    fold = stratified_folds(classes, config.folds, config.seed)
    teach = len(objects) - int(np.bincount(fold).max())
    if teach < 2:  # one is held out from the other, to calibrate
        raise InputError(
            f"objects: expected two at least to learn from in each of the folds ({config.folds}), got {teach}: "
            f"{config.objects} holds {len(objects)}"
        )
    return Design(fold, stratified_order(classes, config.seed), config.training_objects)


if __name__ == "__main__":
    door("train", TrainConfig, run)
