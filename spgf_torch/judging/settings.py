"""The settings of a judge that `train` learns: those of the run itself, the others as conf/judge.yaml has them."""

from __future__ import annotations

from dataclasses import fields, replace

from spgf_torch.command_settings import command_settings
from spgf_torch.errors import InputError
from spgf_torch.experiment.config import TrainConfig
from spgf_torch.judging.config import JudgeConfig
from spgf_torch.settings import plain, typed


def judge_settings(config: TrainConfig) -> JudgeConfig:
    """Keys that both commands have are the run's, `config.judging` changes others, the rest is conf/judge.yaml's.

    Raises InputError for a key in `judging` that does not exist, or that is the run's own.
    """
    run, own = plain(config), {entry.name for entry in fields(JudgeConfig)}
    shared = {name: value for name, value in run.items() if name in own}
    for name in config.judging:
        if name in shared:
            raise InputError(f"judging.{name}: expected a key that train has not, got {name}, which is the run's own")
    try:
        return typed(JudgeConfig, {**command_settings("judge", config.judging), **shared})
    except InputError as error:
        raise InputError(f"judging.{error}") from None


def with_folds_for(config: JudgeConfig, objects: int) -> JudgeConfig:
    """Where there are fewer objects than folds, and `folds` is not set: a fold for each.

    Raises InputError for a single object: who chooses trials has not seen it.
    """
    if objects < 2:
        raise InputError(
            "objects: expected two at least to learn a judge, which chooses trials on objects that it has not seen, "
            f"got {objects} in {config.objects}; train judge=none learns votes of one"
        )
    chosen = config.folds != command_settings("judge", {})["folds"]
    return config if chosen or objects >= config.folds else replace(config, folds=objects)


def stages(config: JudgeConfig, tried: bool) -> list[tuple[str, float]]:
    """The stages of learning a judge, each with its share of the work; `tried`: random trials are given."""
    plan = [] if tried else [("trials", _SHARES["random"] * config.candidates)]
    plan.append(("hypotheses", _SHARES["hypotheses"]))
    for number in range(1, config.rounds + 1 if config.own_trials is None else 1):
        chosen = 2 * (config.one_view + config.four_views) * (config.best + config.random)
        plan += [("rows", _SHARES["rows"]), ("learning", number * _SHARES["learning"])]
        plan.append(("trials", _SHARES["chosen"] * chosen))
    taught = (config.rounds + 1) * _SHARES["learning"]
    plan += [("rows", _SHARES["rows"]), ("learning", 1.7 * taught), ("learning", 0.3 * taught)]
    if (scenes := config.context) is None:
        return plan
    counts = [scenes.number] * scenes.rounds + [scenes.measured]
    in_scenes = [("scenes", 2 * count * _SHARES["scene"]) for count in counts]
    return in_scenes if config.known is not None else [*plan, *in_scenes]


# Processor seconds an object, of the Panda: of a candidate of each type, of clouds and hypotheses, of a trial that a
# judge chose, of describing trials, of learning from the trials of one round; of a scene, where there are 50 objects.
_SHARES = {"random": 0.02, "hypotheses": 1.7, "chosen": 0.027, "rows": 0.05, "learning": 0.1, "scene": 0.09}
# The same of a votes' model.
VOTES = [("sensing", 0.2), ("features", 0.1), ("prototypes", 0.8), ("voting", 0.4)]
