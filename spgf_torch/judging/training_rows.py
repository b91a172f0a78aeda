"""What a judge learns from: trials described by the numbers of each cloud in which they could have been proposed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import torch
from torch import Tensor

from spgf_torch.judging.clouds import Cloud
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.proposing.hypotheses import Hypotheses, Search
from spgf_torch.proposing.judge_features import NAMES, in_images, judge_features
from spgf_torch.simulation.table import OUTCOMES

SUCCESS, COLLISION = OUTCOMES.index("success"), OUTCOMES.index("collision")
# Outcome of what is free, by the mesh, and was not tried.
UNTRIED = -1
# Rank of rows that nobody ranked: of hypotheses surveyed without a trial, of random trials on the mesh, and of
# hypotheses picked at random.
SURVEYED, SAMPLED, PICKED = -3, -2, -1


@dataclass(frozen=True)
class Rows:
    """R rows, one for each trial and cloud.

    Attributes:
        numbers (R, 31) f32: `judge_features.NAMES`. outcome (R,) int64: index into `trials.table.OUTCOMES`,
            or `UNTRIED`.
        obj (R,), cloud (R,) int64: of which object, in which of its clouds; -1: in none.
        round (R,) int64: 0 of random trials.
        rank (R,) int64: place among the highest-ranked of its cloud, from 0; `SURVEYED`, `SAMPLED` or `PICKED`.
        home (R,) bool: it was proposed in this very cloud. probability (R,) f32: what was said of it there.
    """

    numbers: Tensor
    outcome: Tensor
    obj: Tensor
    cloud: Tensor
    round: Tensor
    rank: Tensor
    home: Tensor
    probability: Tensor

    def __len__(self) -> int:
        return len(self.outcome)

    @property
    def success(self) -> Tensor:
        """(R,) bool."""
        return self.outcome == SUCCESS

    @property
    def free(self) -> Tensor:
        """(R,) bool: the open hand did not collide."""
        return self.outcome != COLLISION

    @property
    def tried(self) -> Tensor:
        """(R,) bool: not surveyed alone."""
        return self.rank != SURVEYED

    def at(self, chosen: Tensor) -> Rows:
        """Those of the mask (R,) bool."""
        return Rows(*(getattr(self, part.name)[chosen] for part in fields(self)))

    @staticmethod
    def together(parts: Sequence[Rows]) -> Rows:
        """All of them, one after the other."""
        if not parts:
            return Rows(torch.zeros(0, len(NAMES)), *(torch.zeros(0, dtype=kind) for kind in _KINDS))
        return Rows(*(torch.cat([getattr(rows, part.name) for rows in parts]) for part in fields(Rows)))


_KINDS = (*[torch.int64] * 5, torch.bool, torch.float32)


@dataclass(frozen=True)
class Chosen:
    """Hypotheses of one object that are to be tried.

    Attributes:
        poses (C). cloud (C,), rank (C,) int64 and probability (C,) f32: as in `Rows`.
    """

    poses: Hypotheses
    cloud: Tensor
    rank: Tensor
    probability: Tensor


@dataclass(frozen=True)
class Bench:
    """An object with its clouds, and the hypotheses in each with their numbers.

    Attributes:
        index: of the object among all.
    """

    index: int
    obj: GraspObject
    clouds: list[Cloud]
    hypotheses: list[Hypotheses]
    numbers: list[Tensor]

    @staticmethod
    def of(index: int, obj: GraspObject, clouds: list[Cloud], search: Search) -> Bench:
        """With the hypotheses of each cloud whose fingers are within the images."""
        found = []
        for cloud in clouds:
            hypotheses = search.hypotheses(cloud.seen.texlets, cloud.around)
            found.append(hypotheses.at(in_images(cloud.seen, hypotheses, search)))
        numbers = [judge_features(c.seen, h, search) for c, h in zip(clouds, found, strict=True)]
        return Bench(index, obj, clouds, found, numbers)

    def rows(self, chosen: Chosen, outcome: Tensor, round_: int, search: Search) -> Rows:
        """A row for each cloud in which a tried pose is admissible: free of what is seen, with points to close on.

        Args:
            outcome: (C,) int64.
        """
        parts = []
        for number, cloud in enumerate(self.clouds):
            positions, poses = cloud.seen.texlets.positions, chosen.poses
            at = search.closes(poses.T, poses.grasp_type, positions).nonzero()[:, 0]
            at = at[search.free(poses.T[at], poses.grasp_type[at], positions, cloud.around)]
            at = at[in_images(cloud.seen, poses.at(at), search)]
            obj, its_cloud, its_round = (torch.full((len(at),), value) for value in (self.index, number, round_))
            numbers = judge_features(cloud.seen, poses.at(at), search)
            where = (obj, its_cloud, its_round, chosen.rank[at], chosen.cloud[at] == number)
            parts.append(Rows(numbers, outcome[at], *where, chosen.probability[at]))
        return Rows.together(parts)
