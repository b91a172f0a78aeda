"""What lies behind a seen surface: how often points there are solid, learned from meshes, by local shape or without.

A point that no camera sees through has a seen surface in front of it. Its cell says how far behind it lies along the
ray, and to which side of the texlet there, in that texlet's SPGF frame: straight behind, or towards the direction of
highest curvature, away from it, or across. A profile is the share of solid points in each cell, for each class of
texlets: its prototype, or one class for all (the control).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from scipy.spatial import ConvexHull, cKDTree
from torch import Tensor

from spgf_torch.proposing.hypotheses import Hypotheses, Search
from spgf_torch.proposing.judge_features import Seen
from spgf_torch.sensing.unseen import DepthView

# m behind the surface where one cell ends and the next begins; the first is where space counts as unseen.
DEPTHS = torch.tensor([0.006, 0.01, 0.015, 0.02, 0.03, 0.04, 0.05, 0.065, 0.08, 0.1])
SIDES = 4
# Cells of a point: depth, side, one view or several.
CELLS = len(DEPTHS) * SIDES * 2
# m from where a ray meets the surface to the texlet that stands for it; further, as on a table, none does.
NEAR = 0.015
# Points' worth of all texlets that are mixed into the profile of one class.
SHRINKAGE = 50.0
LEFT, RIGHT, PALM, SWEEP = range(4)
NAMES = ("finger_solid", "worst_finger_solid", "finger_peak", "palm_solid", "palm_peak", "sweep_solid")
# Hypotheses looked at together.
_TOGETHER = 128
# A convex piece: lowest and highest corner (3,), planes (F, 4) with n @ p + d <= 0 inside.
Piece = tuple[np.ndarray, np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Hidden:
    """U unseen points inside hands, or between their pads.

    Attributes:
        row (U,) int64: of which hand; part (U,) int64: `LEFT` to `SWEEP`.
        texlet (U,) int64: in front of it; -1 where there is none near. cell (U,) int64, below `CELLS`.
        solid (U,) bool: inside the object.
        size (H, 4) f32: points of each part of each hand, seen ones too.
    """

    row: Tensor
    part: Tensor
    texlet: Tensor
    cell: Tensor
    solid: Tensor
    size: Tensor

    @staticmethod
    def of(poses: Hypotheses, seen: Seen, frames: Tensor, search: Search, pieces: Sequence[Piece]) -> Hidden:
        """Of hands at these poses; frames (N, 4, 4) of the texlets, convex pieces of the object."""
        tree, found, size = cKDTree(seen.texlets.positions.numpy()), [], torch.zeros(len(poses), 4)
        for code, hand in enumerate(search.hands):
            grids = (hand.fingers, hand.palm, hand.sweep)
            part = torch.cat([
                torch.where(hand.fingers[:, 0] < 0, LEFT, RIGHT),
                torch.full((len(hand.palm),), PALM),
                torch.full((len(hand.sweep),), SWEEP),
            ])  # fmt: skip
            of_type = (poses.grasp_type == code).nonzero()[:, 0]
            size[of_type] = torch.bincount(part, minlength=4).float()
            for rows in of_type.split(_TOGETHER):
                T = poses.T[rows].float()
                at = (T[:, :3, :3] @ torch.cat(grids).T).mT + T[:, None, :3, 3]
                depth, hit = in_front(at.flatten(0, 1), seen.views)
                some = ((depth > DEPTHS[0]) & depth.isfinite()).nonzero()[:, 0]
                point, hit, depth = at.flatten(0, 1)[some], hit[some], depth[some]
                texlet = nearest(tree, hit)
                cell = cell_of(depth, in_frame(point, frames[texlet]), len(seen.views))
                row, its = rows[some // len(part)], part[some % len(part)]
                found.append((row, its, texlet, cell, inside(point, pieces)))
        if not found:
            none = torch.zeros(0, dtype=torch.int64)
            return Hidden(none, none, none, none, none.bool(), size)
        return Hidden(*(torch.cat(column) for column in zip(*found, strict=True)), size)


def in_front(points: Tensor, views: Sequence[DepthView]) -> tuple[Tensor, Tensor]:
    """m (P,) behind the seen surface of points (P, 3), the least of all views, and where (P, 3) its ray meets it."""
    least, hit = torch.full((len(points),), torch.inf), points.clone()
    for view in views:
        behind, ray = view.behind(points), points - view.eye
        z = (ray @ view.rotation[:, 2]).clamp(min=1e-6)
        nearer = behind < least
        least = torch.where(nearer, behind, least)
        hit[nearer] = (view.eye + ray * ((z - behind) / z)[:, None])[nearer]
    return least, hit


def nearest(tree: cKDTree, hit: Tensor) -> Tensor:
    """(P,) int64 texlet nearest to each place (P, 3), -1 where none is near."""
    at = torch.from_numpy(tree.query(hit.numpy(), distance_upper_bound=NEAR)[1])
    return torch.where(at < tree.n, at, -1)


def in_frame(points: Tensor, frames: Tensor) -> Tensor:
    """(P, 3) points in the frames (P, 4, 4) of one texlet each."""
    return (frames[:, :3, :3].mT.float() @ (points - frames[:, :3, 3].float())[:, :, None])[:, :, 0]


def cell_of(depth: Tensor, offset: Tensor, views: int) -> Tensor:
    """(P,) int64 cells of points so far behind the surface (P,), at offsets (P, 3) in the frame of its texlet."""
    x, y, z = offset.unbind(1)
    side = torch.where(y.abs() > x.abs(), 3, torch.where(x > 0, 1, 2))
    side[torch.hypot(x, y) < z.abs() / 2] = 0
    level = torch.bucketize(depth, DEPTHS, right=True) - 1
    return (level.clamp(min=0) * SIDES + side) * 2 + int(views > 1)


def pieces_of(parts: Sequence[np.ndarray]) -> list[Piece]:
    """Convex pieces from the corners (V, 3) of their hulls."""
    return [(corners.min(axis=0), corners.max(axis=0), ConvexHull(corners).equations) for corners in parts]


def inside(points: Tensor, pieces: Sequence[Piece]) -> Tensor:
    """(P,) bool: points (P, 3) inside one of the pieces."""
    at, solid = points.double().numpy(), np.zeros(len(points), bool)
    for low, high, planes in pieces:
        may = (((at >= low) & (at <= high)).all(axis=1) & ~solid).nonzero()[0]
        solid[may] = (at[may] @ planes[:, :3].T <= -planes[:, 3]).all(axis=1)
    return torch.from_numpy(solid)


def without_frames(cell: Tensor) -> Tensor:
    """The cells of a control that knows no SPGF frame: straight behind or not is all that it is told of sides."""
    side = (cell // 2) % SIDES
    return cell - 2 * (side - (side > 0).long())


def counted(kind: Tensor, cell: Tensor, solid: Tensor, kinds: int) -> Tensor:
    """(2, kinds, CELLS) f64: points of each class (U,) and cell (U,), and the solid ones among them."""
    at = kind * CELLS + cell
    both = [torch.bincount(at, weights=w, minlength=kinds * CELLS) for w in (torch.ones(len(at)), solid.float())]
    return torch.stack(both).double().view(2, kinds, CELLS)


def profile(counts: Tensor) -> Tensor:
    """(kinds, CELLS) f64 P(solid) from counts (2, kinds, CELLS), drawn to that of all classes where points are few."""
    points, solid = counts
    every = (solid.sum(0) + 1) / (points.sum(0) + 2)
    return (solid + SHRINKAGE * every) / (points + SHRINKAGE)


def occupancy(hidden: Hidden, solid: Tensor) -> Tensor:
    """(H, 6) f32, the numbers `NAMES` of hands whose unseen points are solid with probability (U,); others are not."""
    at, count = hidden.row * 4 + hidden.part, hidden.size.numel()
    total = torch.bincount(at, weights=solid.double(), minlength=count).view(-1, 4)
    peak = torch.zeros(count).scatter_reduce_(0, at, solid.float(), "amax").view(-1, 4)
    size = hidden.size.double().clamp(min=1)
    mean, fingers = total / size, total[:, :2].sum(1) / size[:, :2].sum(1)
    return torch.stack(
        [fingers, mean[:, :2].amax(1), peak[:, :2].amax(1), mean[:, PALM], peak[:, PALM], mean[:, SWEEP]], dim=1
    ).float()
