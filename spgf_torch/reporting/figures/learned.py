"""What a model learned as shapes in space: rings of prototypes, and hands at the grasps tied to them. Pure geometry.

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
INNER = 0.5  # of the radius: where the drawn band of a ring begins
SUNK = 0.15  # of the radius: how much lower the bottom layer is drawn, so that the layers do not cover each other
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
class Ring:
    """One layer of a prototype as a band of quadrilaterals.

    Attributes:
        quads: (C, 4, 3) m, the cells that are no gap.
        alpha2_deg: (C,) angle to the centre's normal.
        gap_lines: (G, 2, 3) m, where the cells that are gaps would lie in the plane.
    """

    quads: np.ndarray
    alpha2_deg: np.ndarray
    gap_lines: np.ndarray


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


def ring_positions(alpha1: np.ndarray, azimuth: np.ndarray, radius: float) -> np.ndarray:
    """(..., 3) where a neighbour at distance `radius` lies: alpha1 is how far it falls below the plane (Eq. 2), rad."""
    flat = np.cos(alpha1)
    return radius * np.stack([flat * np.cos(azimuth), flat * np.sin(azimuth), -np.sin(alpha1)], axis=-1)


def rings(degrees: np.ndarray, seen: np.ndarray, radius: float) -> tuple[Ring, Ring]:
    """Top and bottom layer of one prototype (2, cells, 2) in degrees; cell k is centred on azimuth k * 360 / cells.

    A cell is as wide, from the outside in, as the share of features that have something there, `seen` (2, cells); a
    gap where it is less than half of them.
    """
    return _ring(degrees[0], seen[0], radius, 0.0), _ring(degrees[1], seen[1], radius, SUNK * radius)


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


def _ring(layer_deg: np.ndarray, seen: np.ndarray, radius: float, sunk: float) -> Ring:
    cells = len(layer_deg)
    azimuth = np.arange(cells) * 2 * np.pi / cells
    half = np.pi / cells
    gap, inner = seen < 0.5, 1 - (1 - INNER) * seen
    borders = zip(_borders(np.radians(layer_deg[:, 0]), gap), _borders(inner, gap), (-half, half), strict=True)
    (a, b), (d, c) = (
        [np.reshape(share, (-1, 1)) * ring_positions(alpha1, azimuth + side, radius) for share in (begin, 1)]
        for alpha1, begin, side in borders
    )
    corners = [a, b, c, d]
    down = np.array([0, 0, sunk])
    ends = ring_positions(np.zeros((2, gap.sum())), azimuth[gap] + half * np.array([[-0.6], [0.6]]), radius)
    return Ring((np.stack(corners, axis=1) - down)[~gap], layer_deg[~gap, 1], np.swapaxes(ends, 0, 1) - down)


def _borders(values: np.ndarray, gap: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values (C,) at both borders of each cell: the mean with the neighbour, or its own where that is a gap."""
    before, after = (np.where(np.roll(gap, k), values, (values + np.roll(values, k)) / 2) for k in (1, -1))
    return before, after
