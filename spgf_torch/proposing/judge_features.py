"""Thirty-one numbers that describe an open hand at a hypothesis against what the cameras saw, for a judge to weigh.

In the TCP frame: x closing, y across, z approach; h is half the opening. Lengths are metres. None of them knows what is
up: a table takes part through what is free of it, not here.

- type: the grasp type, its place among the sorted names. margin: least signed distance of the hand to a sensed point,
  at most `config.margin`.
- log_points: log(1 + points between the pads). width: their extent along x over 2h; off_mid: how far their middle is
  from the hand's; mean_z: their mean along the approach.
- pads: the points within `pad_depth` of the outermost on either side, and how far their normals face along x.
  anti_min, anti_max: mean share of the friction cone's inside, 0 on the cone and 1 on its axis, of the worse and the
  better side; n_min, n_max: mean cosine.
- both_sides, log_both: points whose cosine with x is beyond 0.5 to either side, of the rarer side: any, log(1 + count).
- reach: how deep the pads reach past the nearest point in front of them.
- c_x, c_y, c_z, c_arm: the mean of the body's texlets: |x|, |y|, z, hypot(y, z). span: their extent along x over 2h;
  size_1 to size_3: their root mean square extents along their principal axes. The body is all that is seen, or of
  several (`Seen.bodies`) the one nearest to the TCP.
- views: how many images; 0: no image is known, and then the rest is 0 too.
- from_seen: cosine-like, how far the hand comes from where the cameras are.
- finger_near, finger_mid, finger_far: share of the fingers' inside that is unseen, by metres behind the seen surface
  (`unseen`, `unseen_mid`, `unseen_far`); worst_finger, best_finger: the share unseen at all, of the two sides; palm: of
  the palm; sweep, sweep_depth: of what the pads sweep, and its mean depth behind the surface (0 to 0.1).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from spgf_torch.ops.nearest_piece import Blocks, nearest_piece
from spgf_torch.ops.pad_numbers import pad_numbers
from spgf_torch.proposing.bodies import body_at
from spgf_torch.proposing.hand_geometry import HandGeometry
from spgf_torch.proposing.hypotheses import Hypotheses, Search, local, parts
from spgf_torch.sensing.texlets import Texlets
from spgf_torch.sensing.unseen import DepthView, behind_at, mean_direction

PADS = ("log_points", "width", "off_mid", "mean_z", "anti_min", "anti_max", "n_min", "n_max", "both_sides", "log_both")
BODY = ("c_x", "c_y", "c_z", "c_arm", "span", "size_1", "size_2", "size_3")
GEOMETRY = ("type", "margin", *PADS, "reach", *BODY)
UNSEEN = (
    "views",
    "from_seen",
    "finger_near",
    "finger_mid",
    "finger_far",
    "worst_finger",
    "best_finger",
    "palm",
    "sweep",
    "sweep_depth",
)
NAMES = (*GEOMETRY, *UNSEEN)
# Cosine from which on a normal faces a pad.
_FACING = 0.5
# m; side of the blocks of points that are near a hand together, or far from it.
_BLOCK = 0.02
# m; depth behind the surface counts up to here.
_DEEPEST = 0.1


@dataclass(frozen=True)
class Seen:
    """What is known of a target.

    Attributes:
        texlets: its surface. views: the images, () where there are none.
        bodies: (N,) int64, the thing that each texlet is of, where there may be several (`bodies`); None: all of one.
    """

    texlets: Texlets
    views: Sequence[DepthView] = ()
    bodies: Tensor | None = None

    def body_at(self, places: Tensor) -> Tensor:
        """(G,) int64: the body nearest to each place (G, 3)."""
        if self.bodies is None or not len(self.bodies):
            return torch.zeros(len(places), dtype=torch.int64)
        return body_at(places, self.texlets.positions, self.bodies)


def judge_features(seen: Seen, hypotheses: Hypotheses, search: Search) -> Tensor:
    """(H, 31) f32, the numbers `NAMES` of each hypothesis."""
    positions, normals = seen.texlets.positions.float().cpu(), seen.texlets.normals.float().cpu()
    numbers, blocks = torch.zeros(len(hypotheses), len(NAMES)), Blocks.of(positions, _BLOCK)
    for code, hand in enumerate(search.hands):
        of_type = (hypotheses.grasp_type == code).nonzero()[:, 0]
        for part in parts(of_type, len(positions)):
            T = hypotheses.T[part]
            at = local(T, positions)
            numbers[part, 0] = code
            numbers[part, 1] = margin(at, hand, hand.config.margin, blocks)
            cosine = (T[:, :3, 0] @ normals.T).view(len(T), len(normals))
            numbers[part, 2 : 3 + len(PADS)] = between_pads(at, cosine, hand)
            numbers[part, 3 + len(PADS) : len(GEOMETRY)] = bodies(at, T, seen, hand)
        if seen.views:
            numbers[of_type, len(GEOMETRY) :] = unseen(hypotheses.T[of_type], seen, hand)
    return numbers


def in_images(seen: Seen, hypotheses: Hypotheses, search: Search) -> Tensor:
    """(H,) bool: every part of the fingers is at a place that some image shows; all where there are no images.

    What lies beyond the border of all images is not known to be free, and an object that the border cuts does not end
    there.
    """
    shown = torch.ones(len(hypotheses), dtype=torch.bool)
    for code, hand in enumerate(search.hands):
        of_type = (hypotheses.grasp_type == code).nonzero()[:, 0]
        if seen.views:
            shown[of_type] = behind_at(hypotheses.T[of_type], hand.fingers, seen.views, math.inf).isfinite().all(1)
    return shown


def margin(at: Tensor, hand: HandGeometry, most: float, blocks: Blocks) -> Tensor:
    """(G,) least signed distance of the hand's pieces to points at (G, 3, N), m: negative inside; at most `most`.

    The distance to a piece is that to the plane of its farthest face, which near an edge is less than the true one.
    """
    return nearest_piece(at, *hand.planes, most, blocks)


def between_pads(at: Tensor, cosine: Tensor, hand: HandGeometry) -> Tensor:
    """(G, 11): the numbers `PADS` and reach, of points at (G, 3, N) with normals whose cosine with x is (G, N)."""
    region, config = hand.region, hand.config
    box, edge = (
        (region.half, region.height, region.low, region.high, region.middle),
        math.cos(math.atan(config.friction)),
    )
    return pad_numbers(at, cosine, torch.tensor([*box, config.near_fingers, config.pad_depth, edge, _FACING]))


def bodies(at: Tensor, T: Tensor, seen: Seen, hand: HandGeometry) -> Tensor:
    """(G, 8): the numbers `BODY` of hands at poses (G, 4, 4) against the body that each is at; all lie at (G, 3, N)."""
    positions = seen.texlets.positions.float().cpu()
    if seen.bodies is None:
        return body(at, positions, hand)
    which, numbers = seen.body_at(T[:, :3, 3]), torch.zeros(len(T), len(BODY))
    for number in which.unique().tolist():
        its, own = which == number, seen.bodies == number
        numbers[its] = body(at[its][:, :, own], positions[own], hand)
    return numbers


def body(at: Tensor, positions: Tensor, hand: HandGeometry) -> Tensor:
    """(G, 8): the numbers `BODY`, of points (N, 3) that lie at (G, 3, N) in the TCP frames."""
    x, y, z = at.mean(2).unbind(1)
    span = (at[:, 0].amax(1) - at[:, 0].amin(1)) / (2 * hand.region.half)
    offsets = (positions - positions.mean(0)).double()
    size = torch.linalg.eigvalsh(offsets.T @ offsets / len(offsets)).clamp(min=0).sqrt().flip(0).float()
    return torch.stack([x.abs(), y.abs(), z, torch.hypot(y, z), span, *size[:, None].expand(3, len(at))], dim=1)


def unseen(T: Tensor, seen: Seen, hand: HandGeometry) -> Tensor:
    """(G, 10): the numbers `UNSEEN` of hands at poses (G, 4, 4)."""
    config = hand.config
    fingers, palm = (behind_at(T, points, seen.views, config.unseen) for points in (hand.fingers, hand.palm))
    sweep = behind_at(T, hand.sweep, seen.views, 0.0)
    hidden = fingers > config.unseen
    left = hand.fingers[:, 0] < hand.region.middle
    sides = torch.stack([share(hidden[:, left]), share(hidden[:, ~left])])
    centre = seen.texlets.positions.float().cpu().mean(0)
    numbers = (
        torch.full((len(T),), float(len(seen.views))),
        -T[:, :3, 2] @ mean_direction(seen.views, centre),
        share(hidden & (fingers <= config.unseen_mid)),
        share((fingers > config.unseen_mid) & (fingers <= config.unseen_far)),
        share(fingers > config.unseen_far),
        sides.amax(0),
        sides.amin(0),
        share(palm > config.unseen),
        share(sweep > config.unseen),
        sweep.clamp(0, _DEEPEST).mean(1),
    )
    return torch.stack(numbers, dim=1)


def share(which: Tensor) -> Tensor:
    """(G,) f32 of points (G, I) bool; 0 of none."""
    return which.float().sum(1) / max(1, which.shape[1])
