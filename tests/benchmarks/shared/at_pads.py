"""The local shapes that a hand meets: prototypes of the texlets at its pads and between them, or plain curvature."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from scipy.cluster.vq import kmeans2
from torch import Tensor

from spgf_torch.proposing.hypotheses import Hypotheses, Search, local, parts
from spgf_torch.sensing.texlets import Texlets

LOW, HIGH, BETWEEN = range(3)
# m about a texlet in which it bends: the radius of an SPGF.
RADIUS = 0.03
# Kinds of texlets by curvature: as many as prototypes.
KINDS = 20
# Trials' worth of all pairs that are mixed into the rate of one.
SHRINKAGE = 20.0
CURVATURE = ("bend", "bend_low", "bend_high", "facing_away", "crowd")


@dataclass(frozen=True)
class Met:
    """What H hands meet: E pairs of row (E,) and texlet (E,) int64; place (E,): `LOW` or `HIGH` pad, or `BETWEEN`."""

    row: Tensor
    texlet: Tensor
    place: Tensor
    hands: int

    @staticmethod
    def of(poses: Hypotheses, texlets: Texlets, search: Search) -> Met:
        found = [torch.zeros(3, 0, dtype=torch.int64)]
        positions = texlets.positions.float()
        for code, hand in enumerate(search.hands):
            for rows in parts((poses.grasp_type == code).nonzero()[:, 0], len(positions)):
                x, y, z = local(poses.T[rows].float(), positions).unbind(1)
                on = hand.region.holds(x, y, z)
                high = torch.where(on, x, -torch.inf).amax(1, keepdim=True)
                low = torch.where(on, x, torch.inf).amin(1, keepdim=True)
                depth = hand.config.pad_depth
                place = torch.where(x > high - depth, HIGH, torch.where(x < low + depth, LOW, BETWEEN))
                row, texlet = on.nonzero(as_tuple=True)
                found.append(torch.stack([rows[row], texlet, place[row, texlet]]))
        return Met(*torch.cat(found, dim=1), len(poses))

    def shares(self, prototype: Tensor, kinds: int) -> Tensor:
        """(H, 2 kinds) f32: share of each prototype (of texlets (N,)) at the pads, then of all between them."""
        pads = self.place != BETWEEN
        counts = [self.counts(prototype[self.texlet], kinds, which) for which in (pads, torch.ones_like(pads))]
        return torch.cat([c / c.sum(1, keepdim=True).clamp(min=1) for c in counts], dim=1)

    def counts(self, kind: Tensor, kinds: int, which: Tensor) -> Tensor:
        """(H, kinds) f32: how many of the entries `which` (E,) bool are of each kind (E,)."""
        at = self.row[which] * kinds + kind[which]
        return torch.bincount(at, minlength=self.hands * kinds).view(self.hands, kinds).float()

    def pair(self, prototype: Tensor, kinds: int) -> Tensor:
        """(H,) int64: the commonest prototypes of both pads, in either order, as one number below (kinds + 1)^2."""
        sides = []
        for place in (LOW, HIGH):
            count, kind = self.counts(prototype[self.texlet], kinds, self.place == place).max(1)
            sides.append(torch.where(count > 0, kind, kinds))
        return torch.minimum(*sides) * (kinds + 1) + torch.maximum(*sides)

    def means(self, values: Tensor) -> Tensor:
        """(H, 2 V) f32 means of values (N, V) of texlets at the pads, then of all between them; 0 of nothing."""
        found = []
        for which in (self.place != BETWEEN, torch.ones_like(self.place, dtype=torch.bool)):
            total = torch.zeros(self.hands, values.shape[1]).index_add_(0, self.row[which], values[self.texlet[which]])
            found.append(total / torch.bincount(self.row[which], minlength=self.hands).clamp(min=1)[:, None])
        return torch.cat(found, dim=1)


def curvature(texlets: Texlets) -> Tensor:
    """(N, 5) f32, `CURVATURE` of texlets: how the surface about each bends, in 1/m, positive where it is convex.

    bend, bend_low, bend_high: mean, 10 and 90 % quantile of the normal curvature towards each neighbour;
    facing_away: share of neighbours whose normals face away; crowd: log(1 + neighbours).
    """
    X, n = texlets.positions.float(), texlets.normals.float()
    apart = torch.cdist(X, X, compute_mode="donot_use_mm_for_euclid_dist")
    found = torch.zeros(len(X), len(CURVATURE))
    for i in range(len(X)):
        near = ((apart[i] < RADIUS) & (apart[i] > 1e-6)).nonzero()[:, 0]
        if not len(near):
            continue
        bends = ((n[near] - n[i]) * (X[near] - X[i])).sum(1) / apart[i, near].square()
        low, high = bends.quantile(torch.tensor([0.1, 0.9]))
        away = (n[near] @ n[i] < 0).float().mean()
        found[i] = torch.stack([bends.mean(), low, high, away, torch.log1p(torch.tensor(float(len(near))))])
    return found


@dataclass(frozen=True)
class Bends:
    """As many kinds of texlets as there are prototypes, by curvature alone: the control of pairs of prototypes.

    mean, scale (V,) of the curvature learned from; centres (K, V) of what it is standardised to.
    """

    mean: Tensor
    scale: Tensor
    centres: Tensor

    @staticmethod
    def of(curvature: Tensor, seed: int) -> Bends:
        mean, scale = curvature.mean(0), curvature.std(0).clamp(min=1e-6)
        centres, _ = kmeans2(((curvature - mean) / scale).numpy(), KINDS, minit="++", seed=seed)
        return Bends(mean, scale, torch.from_numpy(centres).float())

    def kind(self, curvature: Tensor) -> Tensor:
        """(N,) int64 of texlets whose curvature is (N, V)."""
        return torch.cdist((curvature - self.mean) / self.scale, self.centres).argmin(1)


class Rates:
    """How often trials held that met each kind of shape, never told by a row's own object."""

    def __init__(self, kind: Tensor, obj: Tensor, held: Tensor, kinds: int, objects: int) -> None:
        """kind, obj (R,) int64 and held (R,) bool of the rows that teach."""
        at, size = obj * kinds + kind, objects * kinds
        both = [torch.bincount(at, weights=w.double(), minlength=size) for w in (torch.ones_like(held), held)]
        self.counts = torch.stack(both).view(2, objects, kinds)

    def of(self, kind: Tensor, obj: int) -> Tensor:
        """(H,) f32 of kinds (H,) on an object; few trials are drawn to the rate of all kinds."""
        count, held = self.counts.sum(1) - self.counts[:, obj]
        every = (held.sum() + 1) / (count.sum() + 2)
        return ((held + SHRINKAGE * every) / (count + SHRINKAGE))[kind].float()
