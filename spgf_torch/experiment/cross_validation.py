"""Cross-validation over objects: prototypes and grasps are learned on the training folds, the others are novel."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from spgf_torch.affordance.model import GraspModel, learn, vote
from spgf_torch.affordance.ranking import all_scores
from spgf_torch.config import AffordanceConfig, PrototypeConfig
from spgf_torch.experiment.describe import Described
from spgf_torch.progress import Stages
from spgf_torch.prototypes.kmeans import assign


class Learner:
    """Learns a model from described objects and scores the grasps of novel ones."""

    def __init__(self, prototypes: PrototypeConfig, affordance: AffordanceConfig, seed: int, stages: Stages) -> None:
        self.prototypes, self.affordance, self.seed, self.stages = prototypes, affordance, seed, stages

    def learn(self, objects: Sequence[Described], success: Sequence[Tensor], folder: Path | None = None) -> GraspModel:
        """Prototypes of all features (sections 3.2), then condensed shape-grasp particles (section 3.4).

        With a folder, the fit of the prototypes is checkpointed there and resumed from there.
        """
        from spgf_torch.prototypes.module import fit_prototypes  # brings Lightning: seconds to import

        with self.stages.stage("prototypes", len(objects), "objects") as advance:
            relations = torch.cat([obj.relations for obj in objects])
            centres = fit_prototypes(relations, self.prototypes, self.seed, folder)
            advance(len(objects))
        with self.stages.stage("particles", len(objects), "objects") as advance:
            examples = [
                (obj.pairs, assign(obj.relations, centres), held) for obj, held in zip(objects, success, strict=True)
            ]
            model = learn(examples, centres, self.affordance)
            advance(len(objects))
        return model

    def scores(self, model: GraspModel, obj: Described) -> dict[str, Tensor]:
        """Every ranking's score (G,) of a novel object's grasps."""
        votes = vote(model, obj.pairs, assign(obj.relations, model.centres))
        return all_scores(votes, model.condensed, obj.grasp_type, obj.collides, self.affordance)


def cross_validate(
    learner: Learner, objects: Sequence[Described], success: Sequence[Tensor], fold: np.ndarray
) -> list[dict[str, Tensor]]:
    """Scores of every object's grasps by the model that has not seen the object: ranking -> (G,) f32.

    Args:
        success: of each object (G,) bool.
        fold: (objects,) int, the fold in which each object is novel.
    """
    result: list[dict[str, Tensor]] = [{} for _ in objects]
    for test in np.unique(fold):
        train, novel = np.flatnonzero(fold != test).tolist(), np.flatnonzero(fold == test).tolist()
        model = learner.learn([objects[i] for i in train], [success[i] for i in train])
        with learner.stages.stage("voting", len(novel), "objects") as advance:
            for i in novel:
                result[i] = learner.scores(model, objects[i])
                advance(1)
    return result
