"""What a model learned as shapes in space: what features have around them, and hands at the grasps tied to prototypes.

All in the feature's frame: origin at the centre, z its normal, x the aligned direction (ring cell 0); metres.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from spgf_torch.affordance.model import GraspModel
from spgf_torch.drawing.outline import outline
from spgf_torch.hands.records import Gripper
from spgf_torch.prototypes.naming import gaps

LAYERS = ("top", "bottom")
MOST_DEG = 89.99  # alpha1 of a cell that nothing reached is 90; that of a neighbour on the normal is none at all

BEHIND, HANDLE = 0.03, 0.02  # m of a hand and its axis; a third of the SDH-2's: many hands fit around one prototype
DEEPER = 1.7  # the same in pictures of one object

POOL = 1500  # best supported points that stick figures are chosen from
ANGLE_LENGTH = 0.04  # m; how far apart two grasps count that differ by 1 rad


@dataclass(frozen=True)
class Members:
    """What the features have that belong to each of K prototypes: a mean over all hides which of them end.

    Attributes:
        share: (K,) of all features.
        degrees: (K, 2, cells, 2) the mean of those that have something in the cell; the prototype's own where none.
        seen: (K, 2, cells) their share.
    """

    share: np.ndarray
    degrees: np.ndarray
    seen: np.ndarray

    @staticmethod
    def of(rings_deg: np.ndarray, ids: np.ndarray, prototypes_deg: np.ndarray) -> Members:
        """Of features with rings (F, 2, cells, 2) that belong to prototypes ids (F,)."""
        degrees, seen = prototypes_deg.copy(), (~gaps(prototypes_deg)).astype(float)
        for k in np.unique(ids):
            mine = rings_deg[ids == k]
            known = mine[..., 0] < MOST_DEG
            count = known.sum(axis=0)
            total = (mine * known[..., None]).sum(axis=0)
            degrees[k] = np.where(count[..., None] > 0, total / count.clip(1)[..., None], prototypes_deg[k])
            seen[k] = count / len(mine)
        return Members(np.bincount(ids, minlength=len(prototypes_deg)) / len(ids), degrees, seen)


@dataclass(frozen=True)
class Grasps:
    """Condensed points of one prototype and type.

    Attributes:
        sticks: (G, S, 2, 3) m, the line segments of each hand (`short_outline`).
        probability, support: (G,).
        points: how many condensed points there are in all.
    """

    sticks: np.ndarray
    probability: np.ndarray
    support: np.ndarray
    points: int


def short_outline(gripper: Gripper) -> np.ndarray:
    """(S, 2, 3) m segments of a hand in the TCP frame, of little depth; those of a jaw end at the pads."""
    return outline(gripper, BEHIND, HANDLE, tips=False)


def deep_outline(gripper: Gripper) -> np.ndarray:
    """The same in the hand's own depth, for pictures of one object."""
    return outline(gripper, DEEPER * BEHIND, DEEPER * HANDLE, tips=False)


def best_percent(model: GraspModel, prototype: int, kind: str) -> float:
    """Mean probability of the most successful hundredth of a prototype's points of a type; 0 without any."""
    start, stop = _slice(model, prototype, kind)
    probability = model.condensed.probability[start:stop]
    return float(probability.topk(-(-len(probability) // 100)).values.mean()) if len(probability) else 0.0


def learned_grasps(model: GraspModel, prototype: int, kind: str, stick: np.ndarray, count: int) -> Grasps:
    """Up to `count` well supported points of a prototype and type, spread out in SE(3), as outlines `stick` (S, 2, 3).

    Half of them are spread over the best-supported points of the highest probability, the other half over all of the
    best-supported points, so that what works and what does not are both seen.
    """
    start, stop = _slice(model, prototype, kind)
    supported = model.condensed.support[start:stop]
    pool = supported.topk(min(POOL, len(supported))).indices
    position, quaternion = (t.numpy() for t in model.grid.centres(model.condensed.cell[start:stop][pool].cpu()))
    probability, support = (t[pool].numpy() for t in (model.condensed.probability[start:stop], supported))
    best = np.argsort(-probability, kind="stable")[: max(len(pool) // 8, count // 2)]
    chosen = spread(position[best], quaternion[best], count // 2)
    rest = np.setdiff1d(np.arange(len(pool)), best[chosen])
    which = np.r_[best[chosen], rest[spread(position[rest], quaternion[rest], count - len(chosen))]].astype(int)
    T = Rotation.from_quat(quaternion[which], scalar_first=True).as_matrix()
    sticks = np.einsum("gij,skj->gski", T, stick) + position[which][:, None, None]
    return Grasps(sticks, probability[which], support[which], stop - start)


def spread(position: np.ndarray, quaternion: np.ndarray, count: int) -> np.ndarray:
    """Indices (<= count,) of poses far from each other: the first, then always the one farthest from all so far."""
    if not len(position) or count < 1:
        return np.zeros(0, dtype=int)
    chosen, distance = [0], np.full(len(position), np.inf)
    while len(chosen) < min(count, len(position)):
        last = chosen[-1]
        angle = 2 * np.arccos(np.clip(np.abs(quaternion @ quaternion[last]), 0, 1))
        apart = np.linalg.norm(position - position[last], axis=1) + ANGLE_LENGTH * angle
        distance = np.minimum(distance, apart)
        chosen.append(int(distance.argmax()))
    return np.array(chosen)


def _slice(model: GraspModel, prototype: int, kind: str) -> tuple[int, int]:
    """Where the condensed points of a prototype and type begin and end."""
    s = prototype * len(model.grasp_types) + model.grasp_types.index(kind)
    start, stop = (int(model.condensed.partition_start[i]) for i in (s, s + 1))
    return start, stop
