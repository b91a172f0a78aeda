"""What SPGF could tell a judge beside its own numbers, and controls that tell the same without SPGF."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from shared.at_pads import Bends, Met, Rates, curvature
from shared.hidden import CELLS, Hidden, Piece, counted, occupancy, pieces_of, profile, without_frames
from shared.tried_rows import Tried
from spgf_torch.experiment.learning import PrototypeFit
from spgf_torch.features.config import FeatureConfig
from spgf_torch.features.descriptors import descriptor
from spgf_torch.judging.training_rows import Bench
from spgf_torch.proposing.hypotheses import Hypotheses
from spgf_torch.prototypes.config import PrototypeConfig
from spgf_torch.prototypes.kmeans import assign
from spgf_torch.settings import settings
from spgf_torch.threads import in_parts

K = 20
# Hypotheses of a cloud whose unseen points teach what lies behind a surface.
TEACHING = 40


@dataclass(frozen=True)
class Described:
    """One cloud of an object with the hands that were tried there.

    Attributes:
        obj, number, rows (H,): which object, which of its clouds, and which of all rows.
        frames (N, 4, 4), relations (N, D), valid (N,): its SPGFs.
        hidden: unseen points in those hands; teaching: in other hypotheses of the cloud.
        met: texlets between their pads. bends (N, 5): `curvature`.
    """

    obj: int
    number: int
    rows: Tensor
    frames: Tensor
    relations: Tensor
    valid: Tensor
    hidden: Hidden
    teaching: Hidden
    met: Met
    bends: Tensor

    def prototype(self, centres: Tensor) -> Tensor:
        """(N,) int64 of each texlet; K where there is nothing to describe."""
        return torch.where(self.valid, assign(self.relations, centres), len(centres))


def describe(made: Tried, advance: Callable[[int], None] = lambda done: None) -> list[Described]:
    """Every cloud of every object, with its rows."""

    def of(bench: Bench) -> list[Described]:
        pieces, found = pieces_of(bench.obj.parts), []
        for number in range(len(bench.clouds)):
            rows = ((made.rows.obj == bench.index) & (made.rows.cloud == number)).nonzero()[:, 0]
            found.append(cloud_of(made, bench, number, rows, pieces))
        advance(1)
        return found

    return [cloud for clouds in in_parts(of, made.benches) for cloud in clouds]


def cloud_of(made: Tried, bench: Bench, number: int, rows: Tensor, pieces: Sequence[Piece]) -> Described:
    """A cloud with the hands of these rows (H,) int64."""
    config, cloud, proposed = settings(FeatureConfig), bench.clouds[number], bench.hypotheses[number]
    texlets = cloud.seen.texlets
    spgf = descriptor(config)(texlets.positions, texlets.normals, config, torch.Generator().manual_seed(0))
    frames, poses = spgf.T_object_feature, Hypotheses(made.T[rows], made.grasp_type[rows])
    picked = torch.randperm(len(proposed), generator=torch.Generator().manual_seed(0))[:TEACHING]
    hidden = Hidden.of(poses, cloud.seen, frames, made.search, pieces)
    teaching = Hidden.of(proposed.at(picked), cloud.seen, frames, made.search, pieces)
    met = Met.of(poses, texlets, made.search)
    about = (frames, spgf.relations(), spgf.valid)
    return Described(bench.index, number, rows, *about, hidden, teaching, met, curvature(texlets))


def with_hands(cloud: Described, poses: Hypotheses, made: Tried, pieces: Sequence[Piece]) -> Described:
    """The same cloud with other hands, of which there are no rows."""
    seen = made.benches[cloud.obj].clouds[cloud.number].seen
    hidden = Hidden.of(poses, seen, cloud.frames, made.search, pieces)
    met = Met.of(poses, seen.texlets, made.search)
    return replace(cloud, rows=torch.zeros(0, dtype=torch.int64), hidden=hidden, met=met)


def prototypes(made: Tried, clouds: Sequence[Described], taught: Tensor) -> Tensor:
    """(K, D) learned from the clouds of the objects of the mask (objects,) alone."""
    relations = torch.cat([c.relations[c.valid] for c in clouds if taught[c.obj]])
    return PrototypeFit(settings(PrototypeConfig, num_clusters=K), made.config.seed, made.cache)(relations)


class Behind:
    """P(solid) of unseen points from the meshes of training objects, never of a row's own object."""

    def __init__(self, clouds: Sequence[Described], kinds: Sequence[Tensor], taught: Tensor, frames: bool) -> None:
        """kinds: of each cloud the class (N,) of its texlets; frames: whether sides of the SPGF frame are told."""
        self.frames, self.kinds = frames, 1 + max(int(k.max()) for k in kinds if len(k)) + 1
        self.counts = torch.zeros(len(taught), 2, self.kinds, CELLS, dtype=torch.float64)
        for cloud, kind in zip(clouds, kinds, strict=True):
            if taught[cloud.obj]:
                its = cloud.teaching
                self.counts[cloud.obj] += counted(self.kind(its, kind), self.cell(its), its.solid, self.kinds)

    def kind(self, hidden: Hidden, kind: Tensor) -> Tensor:
        """(U,) class of the texlet in front; the last one where there is none."""
        return torch.where(hidden.texlet >= 0, kind[hidden.texlet], self.kinds - 1)

    def cell(self, hidden: Hidden) -> Tensor:
        return hidden.cell if self.frames else without_frames(hidden.cell)

    def solid(self, cloud: Described, kind: Tensor) -> Tensor:
        """(U,) of the cloud's unseen points."""
        table = profile(self.counts.sum(0) - self.counts[cloud.obj])
        return table[self.kind(cloud.hidden, kind), self.cell(cloud.hidden)]


class Shapes:
    """What the objects of a mask (objects,) teach of local shapes; of an object among them, what the others do."""

    def __init__(self, made: Tried, clouds: Sequence[Described], centres: Tensor, taught: Tensor, few: Tensor) -> None:
        """few (R,) bool: rows that may teach."""
        self.centres = centres
        ids = [cloud.prototype(centres) for cloud in clouds]
        self.local = Behind(clouds, ids, taught, frames=True)
        alike = [torch.zeros_like(its) for its in ids]
        self.one = Behind(clouds, alike, taught, frames=False)
        self.frame = Behind(clouds, alike, taught, frames=True)
        at = few & made.rows.free & taught[made.rows.obj]
        self.bends = Bends.of(torch.cat([cloud.bends for cloud in clouds if taught[cloud.obj]]), made.config.seed)
        self.pairs = self.rates(made, clouds, ids, at)
        self.bent_pairs = self.rates(made, clouds, [self.bends.kind(cloud.bends) for cloud in clouds], at)

    def rates(self, made: Tried, clouds: Sequence[Described], kinds: Sequence[Tensor], at: Tensor) -> Rates:
        """How often the rows of the mask (R,) held, by the pair of kinds (N,) of texlets at their pads."""
        pair = torch.zeros(len(made.rows), dtype=torch.int64)
        for cloud, its in zip(clouds, kinds, strict=True):
            pair[cloud.rows] = cloud.met.pair(its, self.kinds)
        held, obj = made.rows.success[at], made.rows.obj[at]
        return Rates(pair[at], obj, held, (self.kinds + 1) ** 2, len(made.benches))

    @property
    def kinds(self) -> int:
        """Prototypes, and one for texlets that nothing describes."""
        return len(self.centres) + 1

    def numbers(self, cloud: Described) -> dict[str, Tensor]:
        """Name -> numbers (H, E) f32 that are added to the judge's, of the cloud's hands."""
        ids, hidden, met = cloud.prototype(self.centres), cloud.hidden, cloud.met
        return {
            "depth": occupancy(hidden, self.one.solid(cloud, torch.zeros_like(ids))),
            "behind": occupancy(hidden, self.local.solid(cloud, ids)),
            "frame": occupancy(hidden, self.frame.solid(cloud, torch.zeros_like(ids))),
            "true": occupancy(hidden, hidden.solid),
            "curvature": met.means(cloud.bends),
            "shares": met.shares(ids, self.kinds),
            "pairs": self.pairs.of(met.pair(ids, self.kinds), cloud.obj)[:, None],
            "bent_pairs": self.bent_pairs.of(met.pair(self.bends.kind(cloud.bends), self.kinds), cloud.obj)[:, None],
        }


def of_rows(clouds: Sequence[Described], parts: Sequence[dict[str, Tensor]]) -> dict[str, Tensor]:
    """Name -> numbers (R, E) of all rows, from those of each cloud."""
    order = torch.cat([cloud.rows for cloud in clouds]).argsort()
    return {name: torch.cat([part[name] for part in parts])[order] for name in parts[0]}
