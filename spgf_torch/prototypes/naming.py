"""Names of prototypes that a person can check: surface, wall, rim, edge, corner.

The rule looks at the two rings of a prototype (alpha1: how far the surface falls away below the centre's plane,
alpha2: the angle to the centre's normal), in degrees, cell by cell:

- a cell is a *gap* where alpha1 >= 60: an empty cell is written as 90, and a surface so steep is hardly ever seen;
- the *other side* of a thin wall is where the bottom ring has no gap and alpha2 >= 135: it faces away;
- a cell *bends* where the top ring has no gap and alpha2 >= 30, or the bottom ring no gap and alpha2 < 120;
- the ring bends *to one side* where alpha2 of the top ring (without gaps) ranges over 30 or more: a sphere bends too,
  but everywhere alike;
- it is *concave* where the neighbours around the largest alpha2 lie above the plane: alpha1 <= -5 on average there.

Then, the first that holds:

1. rim: a wall that ends. The top ring has a gap, and the bottom ring none in half of its cells.
2. corner: more than 220 of the 360 degrees bend. A straight edge bends at most half of the ring, and the moving
   average widens that by some 20 degrees at each end.
3. edge: the ring bends to one side. (A wall that folds is one, too: both of its sides bend.)
4. wall: the other side shows in a quarter of the ring.
5. surface: the rest, flat or evenly round.

"inner" stands before the name of what is concave: the inside of a bowl, the foot of a wall. The thresholds were set by
looking at the twenty prototypes of K = 20; nothing is learned from them. Gaps must be encoded as the paper does
(`features.gaps: saturated`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

FAMILIES = ("surface", "wall", "rim", "edge", "corner")

GAP_DEG = 60.0
OTHER_SIDE_DEG = 135.0
BEND_DEG = 30.0
BEYOND_DEG = 120.0  # of the bottom ring: below it is a side face, bent by a little more than a right angle
RANGE_DEG = 30.0
CONCAVE_DEG = -5.0
OTHER_SIDE_SHARE = 0.25
BOTTOM_SHARE = 0.5
CORNER_SHARE = 220 / 360
AROUND_DEG = 30.0  # the neighbourhood of the largest alpha2 that tells concave from convex


@dataclass(frozen=True)
class RingShape:
    """What the rule looks at.

    Attributes:
        gap: share of the top ring's cells that are gaps.
        bottom: share of the bottom ring's cells that are none.
        other_side: share of cells that show the other side of a wall.
        bend: share of cells that bend.
        range_deg: range of alpha2 over the top ring.
        alpha1_deg: mean alpha1 around the largest alpha2 of the top ring.
    """

    gap: float
    bottom: float
    other_side: float
    bend: float
    range_deg: float
    alpha1_deg: float

    @property
    def concave(self) -> bool:
        return self.alpha1_deg <= CONCAVE_DEG

    @property
    def family(self) -> str:
        """One of `FAMILIES`, by the rule of this module."""
        sided = self.range_deg >= RANGE_DEG
        if self.gap > 0 and self.bottom >= BOTTOM_SHARE:
            return "rim"
        if self.bend > CORNER_SHARE:
            return "corner"
        if sided:
            return "edge"
        return "wall" if self.other_side >= OTHER_SIDE_SHARE else "surface"

    @property
    def name(self) -> str:
        return f"inner {self.family}" if self.concave else self.family


def gaps(rings_deg: np.ndarray) -> np.ndarray:
    """Which cells of rings (..., cells, 2), in degrees, are gaps: (..., cells) bool."""
    return rings_deg[..., 0] >= GAP_DEG


def ring_shape(rings_deg: np.ndarray) -> RingShape:
    """The features of the rule, of one prototype's rings (2, cells, 2): layer, cell, (alpha1, alpha2) in degrees."""
    top_gap, bottom_gap = gaps(rings_deg)
    top, bottom = rings_deg[..., 1]
    bend = (~top_gap & (top >= BEND_DEG)) | (~bottom_gap & (bottom < BEYOND_DEG))
    seen = top[~top_gap]
    return RingShape(
        gap=float(top_gap.mean()),
        bottom=float((~bottom_gap).mean()),
        other_side=float((~bottom_gap & (bottom >= OTHER_SIDE_DEG)).mean()),
        bend=float(bend.mean()),
        range_deg=float(np.ptp(seen)) if len(seen) else 0.0,
        alpha1_deg=_around_the_bend(rings_deg[0], top_gap),
    )


def prototype_names(rings_deg: np.ndarray) -> list[str]:
    """Names of K prototypes with rings (K, 2, cells, 2) in degrees, numbered by id: `rim 7`."""
    return [f"{ring_shape(rings).name} {k}" for k, rings in enumerate(rings_deg)]


def family_of(name: str) -> str:
    """The family of a numbered name: `inner wall 3` -> `wall`."""
    return name.split()[-2]


def _around_the_bend(ring: np.ndarray, gap: np.ndarray) -> float:
    """Mean alpha1 within 30 deg of the largest alpha2, of one ring (cells, 2) without its gaps; 0 of gaps alone."""
    cells = len(ring)
    if gap.all():
        return 0.0
    largest = int(np.where(gap, -np.inf, ring[:, 1]).argmax())
    reach = round(AROUND_DEG / 360 * cells)
    near = (largest + np.arange(-reach, reach + 1)) % cells
    return float(ring[near, 0][~gap[near]].mean())
