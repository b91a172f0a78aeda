"""Which objects are novel when: the folds of the experiment, and when there are none."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from spgf_torch.affordance.config import JUDGE
from spgf_torch.command_settings import command_settings
from spgf_torch.errors import InputError
from spgf_torch.experiment.config import TrainConfig

if TYPE_CHECKING:
    from spgf_torch.experiment.design import Design

# Objects that a cross-validation takes at least: of fewer, two teach in no fold, or an object alone is a rate.
FEWEST = 4


def design_of(classes: Sequence[str], config: TrainConfig) -> tuple[Design, str]:
    """Folds and order of objects of these classes, and why there are no folds, if so.

    Fewer than `FEWEST` objects have none, unless `folds` is set to what they can have. Raises InputError for more folds
    than objects, and where a fold would leave fewer than two to learn from.
    """
    from spgf_torch.evaluation.folds import classwise_folds, stratified_folds, stratified_order
    from spgf_torch.experiment.design import Design

    count, order = len(classes), stratified_order(classes, config.seed)
    chosen = config.folds != default_folds("train")
    if config.classwise:
        fold, part = classwise_folds(classes, config.folds, config.seed)
        design = Design(fold, order, config.training_objects, part)
    elif count < FEWEST and not chosen:
        _check_alone(count, config)
        why = f"{count} object{'s' * (count > 1)}, too few for a cross-validation, which takes {FEWEST}"
        return Design(np.full(count, -1), order, config.training_objects), why
    elif chosen and config.folds > count:
        raise InputError(f"folds: expected at most one for each of the {count} objects, got {config.folds}")
    else:
        design = Design(stratified_folds(classes, config.folds, config.seed), order, config.training_objects)
    teach = min(len(design.training(test)) for test in design.tests)
    if teach < 2:  # one is held out from the other, to calibrate
        hint = "" if config.classwise else "; without folds= all teach one model, and nothing is measured"
        raise InputError(
            f"objects: expected two at least to learn from in each of the folds ({config.folds}"
            f"{' of each class' if config.classwise else ''}), got {teach}: {config.objects} holds {count}{hint}"
        )
    return design, ""


def default_folds(command: str) -> int:
    """What conf/ has for a command."""
    return int(command_settings(command, {})["folds"])


def _check_alone(count: int, config: TrainConfig) -> None:
    """InputError for settings that want a cross-validation."""
    for key, expected, got in (
        ("final_model", "true", str(config.final_model).lower()),
        ("fold_models", "false", str(config.fold_models).lower()),
    ):
        if got != expected:
            raise InputError(f"{key}: expected {expected} with fewer than {FEWEST} objects ({count}), got {got}")
    if config.ranking == JUDGE:
        raise InputError(f"ranking: expected one of votes with fewer than {FEWEST} objects ({count}), got {JUDGE}")
