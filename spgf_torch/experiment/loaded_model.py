"""A saved model's own settings, ready to describe and score new objects."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from torch import Tensor

from spgf_torch.affordance.config import AffordanceConfig
from spgf_torch.affordance.model import GraspModel, vote
from spgf_torch.affordance.ranking import score_grasps
from spgf_torch.affordance.voting import VotingIndex
from spgf_torch.cache import Cache
from spgf_torch.errors import InputError
from spgf_torch.experiment.config import EvaluateConfig
from spgf_torch.experiment.describe import Describer
from spgf_torch.experiment.described_object import DescribedObject
from spgf_torch.experiment.labelled_grasps import open_hand
from spgf_torch.features.config import FeatureConfig
from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import load_hand
from spgf_torch.paths import find, root
from spgf_torch.proposing.config import ProposingConfig
from spgf_torch.proposing.propose import Proposer
from spgf_torch.prototypes.kmeans import assign
from spgf_torch.settings import plain, settings, typed


@dataclass(frozen=True)
class LoadedModel:
    """A model that describes objects and scores their grasps as it was learned, and proposes new ones."""

    model: GraspModel
    describer: Describer
    proposing: ProposingConfig = field(default_factory=lambda: settings(ProposingConfig))

    @cached_property
    def index(self) -> VotingIndex:
        return VotingIndex(self.model.condensed, self.model.grid)

    @cached_property
    def proposer(self) -> Proposer:
        return Proposer.of(self.model, self.proposing, self.describer.volumes)

    def scores(self, obj: DescribedObject) -> dict[str, Tensor]:
        """Every ranking's score (G,) of an object's grasps."""
        votes = vote(self.index, obj.pairs.listed(), assign(obj.relations, self.model.centres))
        rates, config = self.model.condensed.base_rate, self.describer.affordance
        scores = score_grasps(votes, rates, obj.grasp_type, obj.collides, config)
        return scores.calibrated(self.model.calibration).by_ranking


def loaded_model(model: GraspModel, config: EvaluateConfig) -> LoadedModel:
    """How to describe objects and score grasps as `model` was learned; sensing and hand are the settings' own.

    Raises InputError where the model was learned with another hand: its grasps would mean something else.
    """
    if not _same_hand(model.settings["hand"], config.hand):
        learned, same = model.settings["hand"]["name"], model.settings["hand"]["name"] == config.hand.name
        got = "one of another URDF or description of it" if same else f"one of {learned}"
        shipped = (root() / f"conf/hand/{learned}.yaml").is_file() and not same
        raise InputError(
            f"{config.model}: expected a model learned with this hand ({config.hand.name}), got {got}; give the "
            f"model's own: hand={learned if shipped else 'FILE.yaml, its description'}"
        )
    affordance = typed(AffordanceConfig, model.settings["affordance"])
    features = typed(FeatureConfig, model.settings["features"])
    volumes, cache = open_hand(config.hand), Cache.open(config.cache, config.cache_gb)
    describer = Describer(config.sensing, features, affordance, volumes, config.seed, config.device, cache)
    return LoadedModel(model, describer, config.proposing)


def _same_hand(learned: dict[str, Any], config: HandConfig) -> bool:
    """Whether a model's hand is the one of the settings, wherever its files lie now."""
    ours = plain(config)
    if learned == ours:
        return True
    if any(learned.get(key) != ours[key] for key in ours if key not in ("urdf", "packages")):
        return False
    there = find(learned["urdf"]).is_file()  # else its description is all that is left of it
    return not there or load_hand(typed(HandConfig, learned)).digest == load_hand(config).digest
