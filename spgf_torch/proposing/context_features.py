"""Numbers that describe an open hand at a hypothesis among other things on a table, beside those of `judge_features`.

In the TCP frame (x closing, y across, z approach); up is the table's normal; h is half the opening. Lengths are metres.

- down: cosine of the approach with down; tilt: of the closing axis with the vertical, its size; height: of the TCP
  above the table; lowest: of the lowest part of the hand.
- way_margin: least signed distance to a sensed point of what the hand sweeps on its way to the grasp, at most
  `HypothesesConfig.margin`; other_margin: the same to points of other bodies than the one at the TCP; way_unseen: share
  of fingers and palm that is unseen, mean over places on the way.
- body: log(1 + points of the body at the TCP). strange: of the points between the pads the share of other bodies.
- beside: log(1 + sensed points within `BALL` of the TCP that are not between the pads); others: log(1 + those within it
  that are of other bodies).
- gap: the widest stretch along closing without a point between those of the pads, over 2h: two things, or two rims.
- top: height above the TCP of the highest point about the pads; foot: above the table, of the lowest between them.
- off_x, off_y, off_z: |x|, |y| and z of the mean of the points within `BALL` of the TCP; std_x, std_y, std_z: their
  standard deviations.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from spgf_torch.compiled import compiled
from spgf_torch.proposing.clearance import Plane, Surroundings
from spgf_torch.proposing.hand_geometry import HandGeometry
from spgf_torch.proposing.hand_loops import nearest_piece
from spgf_torch.proposing.hypotheses import Hypotheses, Search, local, parts
from spgf_torch.proposing.judge_features import Seen
from spgf_torch.sensing.unseen import behind_at

POSE = ("down", "tilt", "height", "lowest")
WAY = ("way_margin", "other_margin", "way_unseen")
ABOUT = (
    "body",
    "strange",
    "beside",
    "others",
    "gap",
    "top",
    "foot",
    "off_x",
    "off_y",
    "off_z",
    "std_x",
    "std_y",
    "std_z",
)
CONTEXT = (*POSE, *WAY, *ABOUT)
BALL = 0.06  # m: what is nearer than this is about the hand; a mug's radius and a finger
# Shares of the way back at which unseen space is looked for.
_BACK = (1 / 3, 2 / 3, 1.0)
# Stretches of the opening that are told apart for `gap`: 2 mm of an opening of 8 cm.
_STRETCHES = 40
# m across the pads and along the approach within which the highest point about them is looked for.
_ABOUT = 0.03

_FAR = 100.0  # m; where points are put that are not to be met

Floats = NDArray[np.float32]
Bools = NDArray[np.bool_]


def context_features(seen: Seen, around: Surroundings, hypotheses: Hypotheses, search: Search) -> Tensor:
    """(H, 20) f32, the numbers `CONTEXT` of each hypothesis; `around` has a table."""
    assert around.table is not None  # without one nothing is known of what is up
    sensed = torch.cat([seen.texlets.positions.float().cpu(), around.obstacles.float().cpu()])
    known = torch.zeros(len(seen.texlets), dtype=torch.int64) if seen.bodies is None else seen.bodies
    bodies = torch.cat([known, torch.full((len(around.obstacles),), -1)])  # what is no target is of another body
    numbers = torch.zeros(len(hypotheses), len(CONTEXT))
    for code, hand in enumerate(search.hands):
        of_type = (hypotheses.grasp_type == code).nonzero()[:, 0]
        name = search.clearance.grasp_types[code]
        swept = HandGeometry(search.clearance.swept[name], hand.region, hand.config)
        for part in parts(of_type, len(sensed)):
            T, at = hypotheses.T[part], local(hypotheses.T[part], sensed)
            own = seen.body_at(T[:, :3, 3])[:, None] == bodies
            numbers[part, :4] = pose_numbers(T, around.table, search.clearance.corners[name])
            numbers[part, 4:6] = way_margins(at, own, swept)
            numbers[part, 7:] = about(at, own, T, around.table, hand)
        if seen.views and len(of_type):
            numbers[of_type, 6] = way_unseen(hypotheses.T[of_type], seen, hand, around.retreat)
    return numbers


def pose_numbers(T: Tensor, table: Plane, corners: Tensor) -> Tensor:
    """(G, 4): the numbers `POSE` of hands at T (G, 4, 4) whose convex hull has corners (C, 3)."""
    x, z, height = T[:, :3, 0] @ table.normal, T[:, :3, 2] @ table.normal, T[:, :3, 3] @ table.normal - table.offset
    lowest = height + (table.normal @ T[:, :3, :3] @ corners.T).amin(1)
    return torch.stack([-z, x.abs(), height, lowest], dim=1)


def way_margins(at: Tensor, own: Tensor, swept: HandGeometry) -> Tensor:
    """(G, 2) m of swept hands to points at (G, 3, N), and to those that are not `own` (G, N) bool; negative inside."""
    normals, offsets = (part.numpy() for part in swept.planes)
    least = torch.full((2, len(at)), swept.config.margin)
    far = torch.where(own.unsqueeze(1), torch.full_like(at, _FAR), at)
    for points, to in ((at, least[0]), (far, least[1])):
        nearest_piece(points.numpy(), normals, offsets, to.numpy())
    return least.T


def way_unseen(T: Tensor, seen: Seen, hand: HandGeometry, way: float) -> Tensor:
    """(G,) share of hands at T (G, 4, 4) that is unseen, mean over places up to `way` m back."""
    body = torch.cat([hand.fingers, hand.palm])
    total = torch.zeros(len(T))
    for share in _BACK:
        back = T.clone()
        back[:, :3, 3] -= share * way * T[:, :3, 2]
        total += (behind_at(back, body, seen.views, hand.config.unseen) > hand.config.unseen).float().mean(1)
    return total / len(_BACK)


def about(at: Tensor, own: Tensor, T: Tensor, table: Plane, hand: HandGeometry) -> Tensor:
    """(G, 13): the numbers `ABOUT`, of points at (G, 3, N) in TCP frames T (G, 4, 4); own (G, N) bool: the body's."""
    region = hand.region
    limits = np.array([region.half, region.height, region.low, region.high, region.middle], np.float32)
    up = torch.einsum("gij,i->gj", T[:, :3, :3], table.normal).contiguous()
    height = (T[:, :3, 3] @ table.normal - table.offset).contiguous()
    numbers = torch.empty(len(at), len(ABOUT))
    about_numbers(at.numpy(), own.numpy(), up.numpy(), height.numpy(), limits, numbers.numpy())
    return numbers


@compiled
def about_numbers(at: Floats, own: Bools, up: Floats, height: Floats, limits: Floats, numbers: Floats) -> None:
    """Into numbers (G, 13): `ABOUT` of points at (G, 3, N), with up (G, 3) in their frame and TCPs height (G,) above.

    limits (5,): half, height, low, high and middle of the closing region.
    """
    half, wide, low, high, middle = limits
    full = np.empty(_STRETCHES, np.bool_)
    for g in range(len(at)):
        x, y, z = at[g, 0], at[g, 1], at[g, 2]
        full[:] = False
        count, strange, others, beside, near = 0, 0, 0, 0, 0
        foot, top = np.float32(np.inf), np.float32(-np.inf)
        sums, squares = np.zeros(3), np.zeros(3)
        for i in range(len(x)):
            over = up[g, 0] * x[i] + up[g, 1] * y[i] + up[g, 2] * z[i]
            along = abs(x[i] - middle) < half
            between = along and abs(y[i]) < wide and z[i] > low and z[i] < high
            if between:
                stretch = int((x[i] - middle + half) / (np.float32(2) * half) * _STRETCHES)
                full[min(max(stretch, 0), _STRETCHES - 1)] = True
                foot = min(foot, over)
                count += 1
                strange += not own[g, i]
            if along and abs(y[i]) < _ABOUT and z[i] > low - _ABOUT and z[i] < high + _ABOUT:
                top = max(top, over)
            if x[i] * x[i] + y[i] * y[i] + z[i] * z[i] < BALL * BALL:
                near += 1
                beside += not between
                others += not own[g, i]
                for k in range(3):
                    sums[k] += at[g, k, i]
                    squares[k] += at[g, k, i] * at[g, k, i]
        numbers[g] = 0
        numbers[g, 0], numbers[g, 1] = np.log1p(own[g].sum()), strange / max(count, 1)
        numbers[g, 2], numbers[g, 3] = np.log1p(beside), np.log1p(others)
        numbers[g, 4] = widest_gap(full) / _STRETCHES
        numbers[g, 5] = top if top > -np.inf else np.float32(0)
        numbers[g, 6] = height[g] + foot if foot < np.inf else height[g]
        if near:
            for k in range(3):
                mean = sums[k] / near
                numbers[g, 7 + k] = mean if k == 2 else abs(mean)
                numbers[g, 10 + k] = np.sqrt(max(0.0, squares[k] / near - mean * mean))


@compiled
def widest_gap(full: Bools) -> int:
    """The longest run of empty stretches between full ones, of full (S,)."""
    widest, empty, begun = 0, 0, False
    for stretch in range(len(full)):
        if full[stretch]:
            widest = max(widest, empty) if begun else 0
            begun, empty = True, 0
        else:
            empty += 1
    return widest
