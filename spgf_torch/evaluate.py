"""`python -m spgf_torch.evaluate objects=FOLDER`: a trained model's best grasps on scanned meshes, held in SAPIEN."""

from __future__ import annotations

from pathlib import Path

from spgf_torch.cli import door
from spgf_torch.config import (
    AffordanceConfig,
    EvaluateConfig,
    FeatureConfig,
    InputError,
    PrototypeConfig,
    find,
    plain,
    typed,
)
from spgf_torch.objects.scans import load_scans
from spgf_torch.progress import Stages


def run(config: EvaluateConfig, folder: Path) -> None:
    """Sense the meshes, rank candidate grasps, execute the best of each type; write the rates into `folder`."""
    from rich import print as show

    from spgf_torch.affordance.model import load_model
    from spgf_torch.evaluation.executed import executed_results, executed_table, scans_table, write_executed
    from spgf_torch.experiment.cross_validation import Learner
    from spgf_torch.experiment.describe import Description
    from spgf_torch.experiment.execution import candidate_grasps, execute_best
    from spgf_torch.experiment.tried import open_hand
    from spgf_torch.trials.hand import load_hand
    from spgf_torch.trials.runner import Trials

    stages = Stages()
    model = load_model(find(config.model), config.device)
    if model.settings["hand"] != plain(config.hand):
        raise InputError(f"{config.model}: expected a model learned with the hand {config.hand.name} of the settings")
    scans = load_scans(find(config.objects), config.unit, config.collision)
    show(scans_table(scans))
    objects = [scan.object for scan in scans]
    grasps = [candidate_grasps(obj, config.candidates, config.sampler, config.seed) for obj in objects]
    affordance = typed(AffordanceConfig, model.settings["affordance"])
    description = Description(
        config.sensing,
        typed(FeatureConfig, model.settings["features"]),
        affordance,
        open_hand(config.hand),
        config.seed,
        config.device,
    )
    described = description.describe(objects, grasps, stages)
    learner = Learner(typed(PrototypeConfig, model.settings["prototypes"]), affordance, config.seed, stages)
    scores = [learner.scores(model, obj)[config.ranking].cpu() for obj in described]
    trials = Trials(load_hand(config.hand), config.episode)
    executed = execute_best(objects, grasps, scores, trials, config.N, config.random_trials, config.workers, stages)
    results = executed_results(objects, executed, config)
    write_executed(folder, results)
    show(executed_table(results))
    print(f"results in {folder}")


if __name__ == "__main__":
    door("evaluate", EvaluateConfig, run)
