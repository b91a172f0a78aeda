"""Objects that a model predicted on without having seen them, as arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from spgf_torch.experiment.cross_validation import Predicted
    from spgf_torch.experiment.labelled_grasps import Tried
    from spgf_torch.objects.grasp_object import GraspObject


@dataclass(frozen=True)
class Novel:
    """One object, predicted on by a model that had not seen it.

    Attributes:
        chosen: the ranking that was chosen without this object's fold.
        scores: ranking -> (G,) float score of each grasp.
        probability_before, probability (G,) float: of success, as voted and as calibrated; votes (G,) int.
        success (G,) bool, grasp_type (G,) int, collides (G,) bool: a sensed point lies inside the open hand.
        pose (G, 7) float: T_object_tcp as x y z (m) and quaternion wxyz.
    """

    name: str
    category: str
    fold: int
    chosen: str
    scores: Mapping[str, np.ndarray]
    probability_before: np.ndarray
    probability: np.ndarray
    votes: np.ndarray
    success: np.ndarray
    grasp_type: np.ndarray
    collides: np.ndarray
    pose: np.ndarray


def novel_objects(
    objects: Sequence[GraspObject], tried: Sequence[Tried], predicted: Sequence[Predicted], fold: np.ndarray
) -> list[Novel]:
    """What was predicted on each object, beside what became of its grasps; fold (objects,) int."""
    return [_novel(*row) for row in zip(objects, tried, predicted, fold.tolist(), strict=True)]


def _novel(obj: GraspObject, tried: Tried, predicted: Predicted, fold: int) -> Novel:
    from spgf_torch.geometry import se3

    judged, T = predicted.judged, tried.grasps.T_object_tcp
    return Novel(
        obj.name,
        obj.category,
        fold,
        predicted.chosen,
        {name: score.cpu().numpy() for name, score in predicted.scores.items()},
        judged.probability.cpu().numpy(),
        predicted.probability.cpu().numpy(),
        judged.votes.cpu().numpy(),
        tried.success.numpy(),
        tried.grasps.grasp_type.numpy(),
        judged.collides.cpu().numpy(),
        np.concatenate([se3.position_of(T).numpy(), se3.quaternion_of(T).numpy()], axis=1),
    )
