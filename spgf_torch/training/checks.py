"""What of the settings of `train` can be refused before torch is loaded, and what takes a look at the hand."""

from __future__ import annotations

from pathlib import Path

from spgf_torch.affordance.config import JUDGE
from spgf_torch.command_settings import command_settings
from spgf_torch.errors import InputError
from spgf_torch.experiment.config import TrainConfig, is_recorded
from spgf_torch.extras import needed
from spgf_torch.files.given_paths import check_folder, check_model, check_place
from spgf_torch.files.reading import existing
from spgf_torch.paths import find


def check_settings(config: TrainConfig) -> None:
    """InputError, in one line, for settings that do not go together, packages and folders that are not there."""
    _check_packages(config)
    _check_constellations(config)
    check_folder("objects", config.objects, "a folder of meshes or descriptions")
    if config.prototypes_from is not None:
        check_model("prototypes_from", config.prototypes_from)
    if is_recorded(config.trials):
        existing(find(config.trials))
    else:
        check_folder("trials", config.trials, "the trial tables that simulate leaves, or a table of recorded ones")
    _check_judge(config)


def default_trials() -> str:
    """What `trials` stands for where it is not given."""
    return str(command_settings("train", {})["trials"])


def check_recorded(config: TrainConfig) -> None:
    """InputError for settings that do not go with recorded trials."""
    told = "with recorded trials (trials=FILE)"
    if config.judge != "none":
        raise InputError(f"judge: expected none {told}, since a judge chooses trials of its own, got {config.judge}")
    if config.ranking == JUDGE:
        raise InputError(f"ranking: expected one of votes {told}, got {JUDGE}")
    if config.runner != "local":
        raise InputError(f"runner: expected local {told}, got {config.runner}")
    if config.constellations.words:
        raise InputError(f"constellations.words: expected 0 {told}, got {config.constellations.words}")


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


def check_hand(config: TrainConfig) -> None:
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
    if config.recorded and not is_recorded(config.trials):
        raise InputError(f"recorded: expected with a file of recorded trials, got trials={config.trials}")
    given = {"own_trials": config.own_trials, "judging": config.judging}
    for key, value in given.items():
        if value and config.judge == "none":
            raise InputError(f"{key}: expected with judge=learn, got judge=none")
    if config.own_trials is not None:
        check_folder("own_trials", config.own_trials, "the tables of own trials that judge=learn leaves")


def check_name(config: TrainConfig) -> Path | None:
    """Where the model is kept by its name, if it is to have one; InputError where it cannot be."""
    if config.name is None:
        return None
    if config.classwise or not config.final_model:
        raise InputError("name: expected with final_model=true and classwise=false, got no model of all objects")
    return check_place(config.name, config.replace)
