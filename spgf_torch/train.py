"""`python -m spgf_torch.train +K=20`: the experiment of the paper, and a model learned on all objects."""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path

from spgf_torch.cli import door
from spgf_torch.config import TrainConfig, find, plain
from spgf_torch.objects.library import load_objects
from spgf_torch.progress import Stages


def run(config: TrainConfig, folder: Path) -> None:
    """Describe the objects, cross-validate, learn on all of them; write results and the model into `folder`."""
    from spgf_torch.affordance.model import check_device, save_model
    from spgf_torch.cache import Cache
    from spgf_torch.evaluation.folds import stratified_folds
    from spgf_torch.evaluation.results import Novel, build_results, write_json, write_per_object
    from spgf_torch.evaluation.tables import free_line, results_table
    from spgf_torch.experiment.cross_validation import Learner, cross_validate
    from spgf_torch.experiment.describe import Description
    from spgf_torch.experiment.tried import open_hand, tried_grasps
    from spgf_torch.progress import show

    check_device(config.device)
    start, stages = time.perf_counter(), Stages()
    objects = load_objects(find(config.objects))
    tried = tried_grasps(objects, config)
    volumes = open_hand(config.hand)
    cache = Cache.open(config.cache, config.cache_gb)
    describe = Description(
        config.sensing, config.features, config.affordance, volumes, config.seed, config.device, cache
    )
    described = describe.describe(objects, [t.grasps for t in tried], stages)
    success = [t.success.to(config.device) for t in tried]

    fold = stratified_folds([obj.category for obj in objects], config.folds, config.seed)
    prototypes = dataclasses.replace(config.prototypes, num_clusters=config.K)
    learner = Learner(prototypes, config.affordance, config.seed, stages)
    scores = cross_validate(learner, described, success, fold)
    model = learner.learn(described, success)
    save_model(dataclasses.replace(model, settings=plain(config)), folder)

    novel = [
        Novel(
            obj.name,
            obj.category,
            int(fold[i]),
            {name: score.cpu().numpy() for name, score in scores[i].items()},
            tried[i].success.numpy(),
            tried[i].grasps.grasp_type.numpy(),
            described[i].collides.cpu().numpy(),
        )
        for i, obj in enumerate(objects)
    ]
    seconds = {**stages.seconds, "total": time.perf_counter() - start}
    results = build_results(novel, config, seconds)
    write_per_object(folder / "per_object.csv", novel, config.N)
    write_json(folder / "results.json", results)
    show(results_table(results))
    show(free_line(results))
    show(f"results, model and settings in {folder}")


if __name__ == "__main__":
    door("train", TrainConfig, run)
