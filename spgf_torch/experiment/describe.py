"""What the learner sees of an object: features, their pairs with the tried grasps, and the outcomes.

Nothing here depends on K or on the folds, so it is made once.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TypeVar

import torch
from torch import Tensor

from spgf_torch.affordance.model import CellPairs, cell_pairs
from spgf_torch.affordance.sensed_collision import HandVolume, sensed_collision
from spgf_torch.config import GRASP_TYPES, AffordanceConfig, FeatureConfig, SensingConfig
from spgf_torch.features.spgf import Features, spgf
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.progress import Stages
from spgf_torch.sensing.sense import sense
from spgf_torch.sensing.texlets import Texlets

T = TypeVar("T")

# Objects described at once: numpy, torch and embree let go of the interpreter while they work.
THREADS = 2


@dataclass(frozen=True)
class Grasps:
    """Candidate grasps on one object.

    Attributes:
        T_object_tcp (G, 4, 4) f32.
        grasp_type (G,) int64: index into `config.GRASP_TYPES`.
    """

    T_object_tcp: Tensor
    grasp_type: Tensor


@dataclass(frozen=True)
class Described:
    """One object as the learner sees it.

    Attributes:
        relations (F, 4 N_g) f32: the relational part of its features.
        pairs: its features' pairs with the grasps.
        collides (G,) bool: a sensed point lies inside the open hand.
    """

    relations: Tensor
    pairs: CellPairs
    collides: Tensor

    @property
    def grasp_type(self) -> Tensor:
        """(G,) int64: index into `config.GRASP_TYPES`."""
        return self.pairs.grasp_type


@dataclass(frozen=True)
class Description:
    """The settings and the hand that describe objects."""

    sensing: SensingConfig
    features: FeatureConfig
    affordance: AffordanceConfig
    volumes: Mapping[str, HandVolume]
    seed: int
    device: str = "cpu"

    def describe(self, objects: Sequence[GraspObject], grasps: Sequence[Grasps], stages: Stages) -> list[Described]:
        """Sense objects, compute their features, and pair these with grasps; one stage of progress each."""

        def in_turn(stage: str, work: Callable[[int], T]) -> list[T]:
            with stages.stage(stage, len(objects), "objects") as advance, ThreadPoolExecutor(THREADS) as pool:
                return [(advance(1), done)[1] for done in pool.map(work, range(len(objects)))]

        texlets = in_turn("sensing", lambda i: sense(objects[i], self.sensing, self.seed))
        features = in_turn("features", lambda i: self.valid_features(objects[i].name, texlets[i]))
        return in_turn("particles", lambda i: self.pair(objects[i].name, texlets[i], features[i], grasps[i]))

    def valid_features(self, name: str, texlets: Texlets) -> Features:
        """The features of the texlets that have a neighbour."""
        positions, normals = texlets.positions.to(self.device), texlets.normals.to(self.device)
        found = spgf(positions, normals, self.features, self.generator(name, 0))
        return Features(found.T_object_feature[found.valid], found.rings[found.valid], found.valid[found.valid])

    def pair(self, name: str, texlets: Texlets, features: Features, grasps: Grasps) -> Described:
        """Pairs of features and grasps, and the grasps' sensed collisions."""
        T, grasp_type = grasps.T_object_tcp.to(self.device), grasps.grasp_type.to(self.device)
        pairs = cell_pairs(features.T_object_feature, T, grasp_type, self.affordance, self.generator(name, 1))
        collides = torch.zeros_like(grasp_type, dtype=torch.bool)
        for code, kind in enumerate(GRASP_TYPES):
            of_type = grasp_type == code
            points = texlets.positions.to(self.device)
            collides[of_type] = sensed_collision(points, T[of_type], self.volumes[kind])
        return Described(features.relations(), pairs, collides)

    def generator(self, name: str, stream: int) -> torch.Generator:
        """An object's own random stream: free of the order of objects."""
        return torch.Generator().manual_seed(zlib.crc32(f"{self.seed}/{stream}/{name}".encode()))
