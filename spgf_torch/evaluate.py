"""`python -m spgf_torch.evaluate objects=FOLDER`: a trained model's best grasps on scanned meshes, executed."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from spgf_torch.cli.command import run_command
from spgf_torch.errors import InputError
from spgf_torch.experiment.config import EvaluateConfig
from spgf_torch.extras import needed
from spgf_torch.files.given_paths import NONE, check_folder, model_and_judge, model_folder
from spgf_torch.paths import find
from spgf_torch.progress import ProgressReporter, show

if TYPE_CHECKING:
    from torch import Tensor

    from spgf_torch.affordance.model import GraspModel
    from spgf_torch.evaluation.executed import ObjectOutcome
    from spgf_torch.experiment.describe import Grasps
    from spgf_torch.experiment.execution import Executed
    from spgf_torch.experiment.loaded_model import LoadedModel
    from spgf_torch.objects.grasp_object import GraspObject
    from spgf_torch.proposing.judge import Judge


def run(config: EvaluateConfig, folder: Path) -> None:
    """Sense the meshes, rank candidate grasps, execute the best of each type; write the rates into `folder`."""
    _check_episode(config)
    config = _resolved(config)
    check_folder("objects", config.objects, "a folder of meshes or descriptions")

    from spgf_torch.affordance.model import check_device
    from spgf_torch.evaluation.draws import draw_results
    from spgf_torch.evaluation.executed import executed_results
    from spgf_torch.evaluation.files import write_json
    from spgf_torch.evaluation.tables import draws_table, executed_table
    from spgf_torch.experiment.execution import execute_best, execute_draws
    from spgf_torch.hands.hand import load_hand
    from spgf_torch.reporting.evaluated import Left
    from spgf_torch.simulation.execute import Trials

    check_device(config.device)
    config = _with_hand(config)
    stages = ProgressReporter()
    meets = None if config.model == NONE else models(config)
    objects, start = _objects(config), time.perf_counter()
    judge = _judge(config)
    known = _known(objects, meets(objects[0]).model if meets else None, judge, config)
    which = asked(meets(objects[0]).model if meets else None, judge, config)
    for line in (*which, *(doubts := known_lines(known, judge, len(objects)))):
        show(line)
    loaded = [meets(obj) for obj in objects] if meets else []
    if config.candidates == "proposed":
        grasps, scores = proposed(loaded, objects, config, stages, judge)
    else:
        grasps, scores = sampled(loaded, objects, config, stages)
    each = (time.perf_counter() - start) / len(objects)

    trials = Trials(load_hand(config.hand), config.episode)
    by_engine = execute_best(objects, grasps, scores, trials, config, stages)
    executed = next(iter(by_engine.values()))
    further = execute_draws(objects, grasps, scores, trials, config, stages) if config.draws > 1 else []
    results = executed_results(outcomes_of(objects, executed, each), config)
    results |= {"learned_from": known, **_judged(executed, scores, config), **_ended(executed, config)}
    told: list[Any] = [executed_table(results), *doubts]
    left = Left(folder, objects, grasps, trials.hand)
    if len(by_engine) > 1:
        told += left.both_engines(by_engine, config, results)
    if further:
        results["robustness"] = in_draws = draw_results(objects, [executed, *further], config)
        told.append(draws_table(in_draws, config.N))
    told.append(left.failures([executed, *further]))
    write_json(folder / "results.json", results)
    for content in told:
        show(content)


def _check_episode(config: EvaluateConfig) -> None:
    """InputError where the engine does not know the episode, or the episode draws nothing."""
    if config.engine != "sapien":
        needed(f"engine: {config.engine}", "mujoco")
        if config.episode.robot is not None:
            raise InputError(f"engine: expected sapien with the robot's episode, got {config.engine}")
    if config.draws > 1 and config.episode.robot is None:
        raise InputError(
            f"draws: expected 1 with an episode that draws nothing, got {config.draws}; episode=robot does"
        )


def _objects(config: EvaluateConfig) -> Sequence[GraspObject]:
    """What lies in the folder; lines and a table tell what it was taken for."""
    from spgf_torch.cache import Cache
    from spgf_torch.evaluation.tables import scans_table
    from spgf_torch.objects.folders import read_objects

    found = read_objects(config, ProgressReporter(), Cache.open(config.cache, config.cache_gb))
    for note in found.notes:
        show(note)
    if found.scans:
        show(scans_table(found.scans))
    return found.objects


def _resolved(config: EvaluateConfig) -> EvaluateConfig:
    """With `model` the folder that has votes, or none, and `judge` that of the judge that ranks, or None.

    A judge in the model's folder ranks what is proposed for what is sensed, and no other candidates. Raises InputError
    for settings that a judge or a table does not go with.
    """
    named = config.judge not in (None, NONE)
    for key, value in (("judge", named), ("table", config.table)):
        if value and config.candidates != "proposed":
            raise InputError(f"{key}: expected with candidates=proposed, got {config.candidates}")
    if named and config.held_out:
        raise InputError(
            "held_out: expected false with judge=, got true: one judge has no folds; how it does on objects that it "
            "has not seen is in its README.md, and train ranking=judge cross-validates judges on candidates"
        )
    if config.held_out:
        return replace(config, model=str(model_folder(config.model)), judge=None)
    votes, judge = model_and_judge(config.model, config.judge if config.candidates == "proposed" else NONE)
    return replace(config, model=str(votes or NONE), judge=None if judge is None else str(judge))


def _with_hand(config: EvaluateConfig) -> EvaluateConfig:
    """With the URDF that the model's folder carries, where the description's own is gone."""
    from spgf_torch.hands.carried_hand import found

    folder = config.judge if config.model == NONE else config.model
    return config if folder is None else replace(config, hand=found(config.hand, find(folder)))


def _judge(config: EvaluateConfig) -> Judge | None:
    """The judge that ranks, if one does; a line tells which."""
    from spgf_torch.proposing.judge import load_judge
    from spgf_torch.settings import plain

    if config.judge is None:
        show("ranked by votes")
        return None
    judge = load_judge(find(config.judge))
    try:
        judge.check_hand(plain(config.hand), "this hand")
    except InputError as error:
        raise InputError(f"{error}; or give the judge's own: hand={judge.settings['hand']['name']}") from None
    show(f"ranked by the judge in {config.judge}")
    return judge


def _known(
    objects: Sequence[GraspObject], model: GraspModel | None, judge: Judge | None, config: EvaluateConfig
) -> int:
    """From how many of the objects it has learned who ranks: the judge, or else the model."""
    if judge is not None:
        return sum(obj.digest in judge.taught.values() for obj in objects)
    return 0 if config.held_out or model is None else learned_from(objects, model)


def asked(model: GraspModel | None, judge: Judge | None, config: EvaluateConfig) -> list[str]:
    """Whose grasps these are: a line each of the model and the judge."""
    from spgf_torch.proposing.model_folder import Identity

    parts = (("model", model, config.model), ("judge", judge, config.judge))
    return [f"{name}: {folder}, {Identity.of(part).words()}" for name, part, folder in parts if part is not None]


def known_lines(known: int, judge: Judge | None, count: int) -> list[str]:
    """What to say of rates on `count` objects, `known` of which taught who ranks."""
    if not known:
        return []
    who, instead = "model", "held_out=true asks models that have not seen them"
    if judge is not None:
        who, instead = "judge", "its README.md has its rates on held-out ones"
    return [f"not novel: the {who} learned from {known} of these {count} objects; {instead}"]


def _judged(executed: Sequence[Executed], scores: Sequence[Tensor], config: EvaluateConfig) -> dict[str, Any]:
    """What `results.json` holds more where a judge ranked, or things stood on a table."""
    from spgf_torch.evaluation.executed import judged_results

    if config.judge is None and not config.table:
        return {}
    chosen = [ran.best["CG"] for ran in executed]
    success = [ran.success[best].numpy() for ran, best in zip(executed, chosen, strict=True)]
    probability = [score[best].numpy() for score, best in zip(scores, chosen, strict=True)]
    return judged_results(success, probability if config.judge is not None else None, config)


def _ended(executed: Sequence[Executed], config: EvaluateConfig) -> dict[str, Any]:
    """What `results.json` holds more of an episode that knows causes: how many of the best CG grasps failed how."""
    from spgf_torch.evaluation.endings import failure_counts
    from spgf_torch.simulation.label import Label

    if config.episode.robot is None:
        return {}
    words = [ran.ended[index] for ran in executed for index in ran.best["CG"].tolist()]
    return {"failures": failure_counts([Label.of(word) for word in words])}


def models(config: EvaluateConfig) -> Callable[[GraspObject], LoadedModel]:
    """The model that meets an object: one for all, or with `held_out` one that has not seen it."""
    from spgf_torch.affordance.model import load_model
    from spgf_torch.experiment.held_out import load_fold_models
    from spgf_torch.experiment.loaded_model import loaded_model

    run = find(config.model)
    if not config.held_out:
        one = loaded_model(load_model(run, config.device), config)
        return lambda obj: one
    folds = load_fold_models(run, config.device)
    loaded = {fold: loaded_model(model, config) for fold, model in folds.models.items()}
    return lambda obj: loaded[folds.fold_of(obj)]


def learned_from(objects: Sequence[GraspObject], model: GraspModel) -> int:
    """How many of the objects the model learned from."""
    taught = model.settings.get("taught")
    digests = list(taught.values()) if isinstance(taught, dict) else []
    return sum(obj.digest in digests for obj in objects)


def sampled(
    loaded: Sequence[LoadedModel], objects: Sequence[GraspObject], config: EvaluateConfig, stages: ProgressReporter
) -> tuple[list[Grasps], list[Tensor]]:
    """Candidates sampled on the objects' meshes, and their scores."""
    from spgf_torch.experiment.execution import candidate_grasps
    from spgf_torch.simulation.config import samplers_of

    samplers = samplers_of(config.hand)
    grasps = [candidate_grasps(obj, config.samples, config.sampler, config.seed, samplers) for obj in objects]
    described = loaded[0].describer.describe(objects, grasps, stages)
    with stages.stage("voting", len(objects), "objects") as advance:
        scores = []
        for model, obj in zip(loaded, described, strict=True):
            scores.append(model.scores(obj)[config.ranking].cpu())
            advance(1)
    return grasps, scores


def proposed(
    loaded: Sequence[LoadedModel],
    objects: Sequence[GraspObject],
    config: EvaluateConfig,
    stages: ProgressReporter,
    judge: Judge | None = None,
) -> tuple[list[Grasps], list[Tensor]]:
    """Grasps proposed for what is sensed of the objects, no mesh used, and their scores; random candidates beside.

    Args:
        loaded: of each object the model that meets it; none of a judge alone.
    """
    from spgf_torch.experiment.execution import candidate_grasps, with_random
    from spgf_torch.simulation.config import samplers_of

    pairs, samplers = [], samplers_of(config.hand)
    with stages.stage("proposing", len(objects), "objects") as advance:
        for index, obj in enumerate(objects):
            found, score = _proposals(loaded[index] if loaded else None, obj, config, judge)
            random = candidate_grasps(obj, config.random_trials, config.sampler, config.seed, samplers)
            pairs.append(with_random(found, score, random))
            advance(1)
    return [grasps for grasps, _ in pairs], [score for _, score in pairs]


def _proposals(
    model: LoadedModel | None, obj: GraspObject, config: EvaluateConfig, judge: Judge | None
) -> tuple[Grasps, Tensor]:
    """What the judge, or else the model, proposes for an object, alone or on a table, and the scores."""
    from spgf_torch.experiment.describe import Grasps
    from spgf_torch.experiment.labelled_grasps import open_hand
    from spgf_torch.judging.clouds import seen_as
    from spgf_torch.proposing.judge_proposer import JudgedProposer, ranked

    cloud = seen_as(obj, config.sensing, config.table, config.seed)
    if judge is None:
        assert model is not None  # one of them ranks
        found = model.proposer.propose(cloud.seen.texlets, cloud.around)
        return Grasps(found.T_object_tcp.cpu(), found.grasp_type.cpu()), found.score.cpu()
    search = JudgedProposer.alone(judge, open_hand(config.hand), config.proposing).search
    best = ranked(judge, search, config.proposing, cloud.seen, cloud.around)
    return Grasps(best.poses.T, best.poses.grasp_type), best.probability


def outcomes_of(objects: Sequence[GraspObject], executed: Sequence[Executed], seconds: float) -> list[ObjectOutcome]:
    """Rates of each object; `seconds` of prediction an object."""
    import torch

    from spgf_torch.evaluation.executed import ObjectOutcome

    outcomes = []
    for obj, ran in zip(objects, executed, strict=True):
        random = {name: ran.rate(chosen) for name, chosen in ran.random.items()}
        random["CG"] = ran.rate(torch.cat(list(ran.random.values())))
        best = {name: ran.rate(chosen) for name, chosen in ran.best.items()}
        outcomes.append(ObjectOutcome(obj.name, obj.category, best, random, seconds))
    return outcomes


if __name__ == "__main__":
    run_command("evaluate", EvaluateConfig, run)
