"""What the learner sees of an object: features, their pairs with the tried grasps, and sensed collisions.

Nothing here depends on K or on the folds, so it is made once, and kept for later runs where there is a cache.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, TypeVar

import torch
from torch import Tensor

from spgf_torch.affordance.config import AffordanceConfig
from spgf_torch.affordance.pairs import CellPairs, cell_pairs
from spgf_torch.affordance.sensed_collision import HandVolume, sensed_collision
from spgf_torch.cache import Cache, code_fingerprint, fingerprint
from spgf_torch.features.config import FeatureConfig
from spgf_torch.features.descriptors import descriptor, library
from spgf_torch.features.interface import VectorFeatures
from spgf_torch.hands.config import GRASP_TYPES
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.progress import ProgressReporter
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.sensing.sense import sense
from spgf_torch.sensing.texlets import Texlets
from spgf_torch.threads import in_parts

T = TypeVar("T")

# Objects described at once, at most: numpy, torch and embree let go of the interpreter while they work.
THREADS = 2

# The settings that pairs of features and grasps depend on; the others are about what is learned from them.
PAIRING = ("reach", "voxel", "rotation_deg", "features_per_object")


@dataclass(frozen=True)
class Grasps:
    """Candidate grasps on one object.

    Attributes:
        T_object_tcp: (G, 4, 4) f32, m.
        grasp_type: (G,) int64, index into `config.GRASP_TYPES`.
    """

    T_object_tcp: Tensor
    grasp_type: Tensor


@dataclass(frozen=True)
class Described:
    """One object as the learner sees it.

    Attributes:
        relations (F, D) f32: the relational part of its features.
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

    def of_grasps(self, chosen: Tensor) -> Described:
        """With the grasps `chosen` (C,) int64 alone."""
        return Described(self.relations, self.pairs.of_grasps(chosen), self.collides[chosen])


@dataclass(frozen=True)
class Description:
    """The settings and the hand that describe objects, and the cache that keeps what they are described by."""

    sensing: SensingConfig
    features: FeatureConfig
    affordance: AffordanceConfig
    volumes: Mapping[str, HandVolume]
    seed: int
    device: str = "cpu"
    cache: Cache = field(default_factory=lambda: Cache(None))

    def describe(
        self, objects: Sequence[GraspObject], grasps: Sequence[Grasps], stages: ProgressReporter
    ) -> list[Described]:
        """Sense objects, compute features, pair these with grasps, look for collisions; a stage of progress each."""
        all_steps = [Steps(self, obj, tried) for obj, tried in zip(objects, grasps, strict=True)]

        def in_turn(stage: str, work: Callable[[Steps], T], *made: str) -> list[T]:
            def kept() -> str:
                count = sum(not steps.made & set(made) for steps in all_steps)
                return f", {count} from the cache" if count else ""

            with stages.stage(stage, len(objects), "objects", kept) as advance:
                return [(advance(1), done)[1] for done in in_parts(work, all_steps, THREADS)]

        in_turn("sensing", Steps.sense_if_needed, "texlets")
        in_turn("features", lambda steps: steps.features, "features")
        in_turn("particles", lambda steps: steps.pairs, "pairs")
        in_turn("collisions", lambda steps: steps.collides, "collisions")
        return [steps.described() for steps in all_steps]


class once(Generic[T]):  # noqa: N801
    """A property that is computed when first asked for: `functools.cached_property` as from Python 3.12 on.

    Before, that holds one lock for all objects of a class, and no two threads would ever describe at once.
    """

    def __init__(self, make: Callable[[Any], T]) -> None:
        self.make, self.__doc__ = make, make.__doc__

    def __get__(self, owner: Any, kind: type | None = None) -> T:
        value = owner.__dict__[self.make.__name__] = self.make(owner)
        return value


class Steps:
    """The steps of describing one object; each is read from the cache or made when it is first asked for.

    A step's key holds the keys of the steps before it, so nothing need be sensed to find what was made of it.
    """

    def __init__(self, settings: Description, obj: GraspObject, grasps: Grasps) -> None:
        self.settings, self.obj, self.grasps = settings, obj, grasps
        self.pairing = AffordanceConfig(**{name: getattr(settings.affordance, name) for name in PAIRING})
        self.made: set[str] = set()
        surface = (obj.name, obj.mesh.vertices, obj.mesh.faces)
        device, seed, tried = torch.device(settings.device).type, settings.seed, fingerprint(grasps)
        texlets = _key(sense, surface, settings.sensing, seed)
        describes, needs = descriptor(settings.features), library(settings.features)
        features = _key(describes, texlets, settings.features, needs, seed, device)
        self.keys = {
            "texlets": texlets,
            "features": features,
            "pairs": _key(cell_pairs, features, tried, self.pairing, seed, device),
            "collisions": _key(sensed_collision, texlets, tried, settings.volumes, device),
        }

    @once
    def texlets(self) -> Texlets:
        """What the cameras see, on the CPU."""
        return Texlets(
            **self._kept("texlets", lambda: vars(sense(self.obj, self.settings.sensing, self.settings.seed)))
        )

    @once
    def features(self) -> VectorFeatures:
        """The features of the texlets that have a neighbour."""

        def make() -> dict[str, Tensor]:
            device = self.settings.device
            positions, normals = self.texlets.positions.to(device), self.texlets.normals.to(device)
            describe = descriptor(self.settings.features)
            found = describe(positions, normals, self.settings.features, self.generator(0))
            return {"T": found.T_object_feature[found.valid], "relations": found.relations()[found.valid]}

        kept = self._kept("features", make)
        valid = torch.ones(len(kept["T"]), dtype=torch.bool, device=kept["T"].device)
        return VectorFeatures(kept["T"], kept["relations"], valid)

    @once
    def pairs(self) -> CellPairs:
        """Pairs of features and grasps."""
        grasp_type = self.grasps.grasp_type.to(self.settings.device)

        def make() -> dict[str, Tensor]:
            T_object_grasp = self.grasps.T_object_tcp.to(self.settings.device)
            poses = self.features.T_object_feature
            pairs = cell_pairs(poses, T_object_grasp, grasp_type, self.pairing, self.generator(1))
            return {"feature": pairs.feature, "grasp": pairs.grasp, "cell": pairs.cell}

        return CellPairs(**self._kept("pairs", make), grasp_type=grasp_type)

    @once
    def collides(self) -> Tensor:
        """(G,) bool: the grasps at which a sensed point lies inside the open hand."""

        def make() -> dict[str, Tensor]:
            device = self.settings.device
            points, T = self.texlets.positions.to(device), self.grasps.T_object_tcp.to(device)
            collides = torch.zeros(len(T), dtype=torch.bool, device=device)
            for code, kind in enumerate(GRASP_TYPES):
                of_type = self.grasps.grasp_type.to(device) == code
                collides[of_type] = sensed_collision(points, T[of_type], self.settings.volumes[kind])
            return {"collides": collides}

        return self._kept("collisions", make)["collides"]

    def sense_if_needed(self) -> None:
        """Sense the object unless all that follows from the texlets is in the cache."""
        if not all(self.settings.cache.holds(kind, self.keys[kind]) for kind in ("features", "collisions")):
            self.texlets  # noqa: B018

    def described(self) -> Described:
        """The object as the learner sees it."""
        return Described(self.features.relations(), self.pairs, self.collides)

    def generator(self, stream: int) -> torch.Generator:
        """The object's own random stream: free of the order of objects."""
        name = f"{self.settings.seed}/{stream}/{self.obj.name}"
        return torch.Generator().manual_seed(zlib.crc32(name.encode()))

    def _kept(self, kind: str, make: Callable[[], dict[str, Tensor]]) -> dict[str, Tensor]:
        """The tensors of a step on the settings' device, but for texlets, which are on the CPU."""

        def noted() -> dict[str, Tensor]:
            self.made.add(kind)
            return make()

        tensors = self.settings.cache.tensors(kind, self.keys[kind], noted)
        device = "cpu" if kind == "texlets" else self.settings.device
        return {name: tensor.to(device) for name, tensor in tensors.items()}


def _key(compute: Callable[..., Any], *parts: Any) -> str:
    """The key of what the function `compute` of another room makes of `parts`."""
    return fingerprint(code_fingerprint(compute.__module__), Path(__file__).read_bytes(), GRASP_TYPES, *parts)
