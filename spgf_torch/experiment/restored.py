"""A saved model's own settings, ready to describe and score new objects."""

from __future__ import annotations

from spgf_torch.affordance.model import GraspModel
from spgf_torch.cache import Cache
from spgf_torch.config import (
    AffordanceConfig,
    EvaluateConfig,
    FeatureConfig,
    InputError,
    PrototypeConfig,
    plain,
    typed,
)
from spgf_torch.experiment.cross_validation import Learner
from spgf_torch.experiment.describe import Description
from spgf_torch.experiment.tried import open_hand
from spgf_torch.progress import Stages


def restore(model: GraspModel, config: EvaluateConfig, stages: Stages) -> tuple[Description, Learner]:
    """How to describe objects and score grasps as `model` was learned; sensing and hand are the settings' own.

    Raises InputError where the model was learned with another hand: its grasps would mean something else.
    """
    if model.settings.get("hand") != plain(config.hand):
        learned = model.settings.get("hand", {}).get("name")
        raise InputError(f"{config.model}: expected a model learned with this hand ({config.hand.name}), got {learned}")
    affordance = typed(AffordanceConfig, model.settings["affordance"])
    features = typed(FeatureConfig, model.settings["features"])
    volumes = open_hand(config.hand)
    cache = Cache.open(config.cache, config.cache_gb)
    describe = Description(config.sensing, features, affordance, volumes, config.seed, config.device, cache)
    return describe, Learner(typed(PrototypeConfig, model.settings["prototypes"]), affordance, config.seed, stages)
