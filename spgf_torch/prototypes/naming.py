"""Names of prototypes that say what most of their features are: surface, wall, rim, edge, cap, mixed.

The rule looks at the two rings of a prototype (alpha1: how far the surface falls away below the centre's plane,
alpha2: the angle to the centre's normal), in degrees, cell by cell:

- a cell is a *gap* where alpha1 >= 60: an empty cell is written as 90, and a surface so steep is hardly ever seen;
- the *other side* of a thin wall is where the bottom ring has no gap and alpha2 >= 135: it faces away;
- it is *concave* where the neighbours around the largest alpha2 of the top ring lie above the plane: alpha1 <= -5 on
  average there.

Then, the first that holds:

1. rim: the other side shows in half of the ring, and a tenth of the top ring is gap: a wall that ends.
2. wall: the other side shows in half of the ring.
3. mixed: the other side shows in more than a twentieth of the ring, and it is not concave: some of the features are
   walls, others are not, and no word holds for most.
4. cap: alpha2 of the whole top ring is 35 or more: the surface falls away all around.
5. edge: alpha2 of the top ring (without gaps) ranges over 30 or more: the surface bends, but not all around alike.
6. surface: the rest, flat or evenly round.

"inner" stands before the name of what is concave: the inside of a bowl, the foot of a wall. Corners have no word: the
prototypes that bend in most directions are edges of narrow faces as often as corners. The thresholds were set by what
the objects' meshes have within the radius of each feature, on training objects of cross-validation; docs/paper.md says
how many features are what the name of their prototype says. Gaps must be encoded as the paper does
(`features.gaps: saturated`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

FAMILIES = ("surface", "wall", "rim", "edge", "cap", "mixed")

GAP_DEG = 60.0
OTHER_SIDE_DEG = 135.0
RANGE_DEG = 30.0
AROUND_DEG = 35.0  # least alpha2 of a cap
CONCAVE_DEG = -5.0
WALL_SHARE = 0.5
MIXED_SHARE = 0.05
RIM_SHARE = 0.1
TWIN = 0.5  # of the distance between two prototypes: as near are they once one is mirrored
NEAR_DEG = 30.0  # the neighbourhood of the largest alpha2 that tells concave from convex


@dataclass(frozen=True)
class RingShape:
    """What the rule looks at.

    Attributes:
        gap: share of the top ring's cells that are gaps.
        other_side: share of cells that show the other side of a wall.
        least_deg, range_deg: the smallest alpha2 of the top ring, and how far it ranges, without gaps.
        alpha1_deg: mean alpha1 around the largest alpha2 of the top ring.
    """

    gap: float
    other_side: float
    least_deg: float
    range_deg: float
    alpha1_deg: float

    @property
    def concave(self) -> bool:
        return self.alpha1_deg <= CONCAVE_DEG

    @property
    def family(self) -> str:
        """One of `FAMILIES`, by the rule of this module."""
        if self.other_side >= WALL_SHARE:
            return "rim" if self.gap >= RIM_SHARE else "wall"
        if self.other_side > MIXED_SHARE and not self.concave:
            return "mixed"
        if self.least_deg >= AROUND_DEG and not self.concave:
            return "cap"
        return "edge" if self.range_deg >= RANGE_DEG else "surface"

    @property
    def name(self) -> str:
        return f"inner {self.family}" if self.concave else self.family


def gaps(rings_deg: np.ndarray) -> np.ndarray:
    """Which cells of rings (..., cells, 2), in degrees, are gaps: (..., cells) bool."""
    return rings_deg[..., 0] >= GAP_DEG


def ring_shape(rings_deg: np.ndarray) -> RingShape:
    """The features of the rule, of one prototype's rings (2, cells, 2): layer, cell, (alpha1, alpha2) in degrees."""
    top_gap, bottom_gap = gaps(rings_deg)
    seen = rings_deg[0, ~top_gap, 1]
    return RingShape(
        gap=float(top_gap.mean()),
        other_side=float((~bottom_gap & (rings_deg[1, :, 1] >= OTHER_SIDE_DEG)).mean()),
        least_deg=float(seen.min()) if len(seen) else 0.0,
        range_deg=float(np.ptp(seen)) if len(seen) else 0.0,
        alpha1_deg=_around_the_bend(rings_deg[0], top_gap),
    )


def prototype_names(rings_deg: np.ndarray) -> list[str]:
    """Names of K prototypes with rings (K, 2, cells, 2) in degrees, numbered by id: `rim 7`."""
    return [f"{ring_shape(rings).name} {k}" for k, rings in enumerate(rings_deg)]


def family_of(name: str) -> str:
    """The family of a numbered name: `inner wall 3` -> `wall`."""
    return name.split()[-2]


def mirror_twins(rings_deg: np.ndarray) -> dict[int, int]:
    """Prototypes that are each other's mirror images: id -> id, both ways.

    Rings (K, 2, cells, 2) are mirrored by going round them the other way, from the same cell 0. Twins are each other's
    nearest mirror image, which brings them to at most `TWIN` of their distance. What is its own mirror image has none.
    """
    K, cells = len(rings_deg), rings_deg.shape[2]
    mirrored = rings_deg[:, :, -np.arange(cells) % cells]
    apart, plain = (
        np.linalg.norm((rings_deg[:, None] - other[None]).reshape(K, K, -1), axis=2) for other in (mirrored, rings_deg)
    )
    nearest = apart.argmin(axis=1)
    twins = [(i, int(j)) for i, j in enumerate(nearest) if i != j and nearest[j] == i]
    return {i: j for i, j in twins if apart[i, j] <= TWIN * plain[i, j]}


def _around_the_bend(ring: np.ndarray, gap: np.ndarray) -> float:
    """Mean alpha1 within 30 deg of the largest alpha2, of one ring (cells, 2) without its gaps; 0 of gaps alone."""
    cells = len(ring)
    if gap.all():
        return 0.0
    largest = int(np.where(gap, -np.inf, ring[:, 1]).argmax())
    reach = round(NEAR_DEG / 360 * cells)
    near = (largest + np.arange(-reach, reach + 1)) % cells
    return float(ring[near, 0][~gap[near]].mean())
