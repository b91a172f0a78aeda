"""What the learner sees of an object: features, their pairs with the tried grasps, and sensed collisions.

Nothing here depends on K or on the folds, so it is made once, and kept for later runs where there is a cache.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Generic, Protocol, TypeVar

import torch
from torch import Tensor

from spgf_torch.affordance.config import AffordanceConfig
from spgf_torch.affordance.pairs import PosePairs, pose_pairs
from spgf_torch.affordance.sensed_collision import HandVolume, sensed_collision
from spgf_torch.cache import Cache, code_fingerprint, fingerprint
from spgf_torch.experiment.described_object import DescribedObject
from spgf_torch.experiment.recorded_view import RecordedView
from spgf_torch.features.config import FeatureConfig
from spgf_torch.features.descriptors import descriptor, library
from spgf_torch.features.interface import VectorFeatures
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.progress import ProgressReporter
from spgf_torch.prototypes.config import ConstellationConfig
from spgf_torch.prototypes.constellations import surroundings
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.sensing.sense import sense
from spgf_torch.sensing.texlets import Texlets
from spgf_torch.threads import in_parts

T = TypeVar("T")
# What can be described: a body, which is sensed here, or what a camera saw of one.
Seen = GraspObject | RecordedView

# Objects described at once, at most: numpy, torch and embree let go of the interpreter while they work.
THREADS = 2

# Objects described stage by stage; then all but what is learned from is dropped. 50 take 0.6 GB until then.
TOGETHER = 50


@dataclass(frozen=True)
class Grasps:
    """Candidate grasps on one object.

    Attributes:
        T_object_tcp: (G, 4, 4) f32, m.
        grasp_type: (G,) int64, index into the hand's grasp types.
    """

    T_object_tcp: Tensor
    grasp_type: Tensor


class GraspPoses(Protocol):
    """Grasps on one object, tried (`TrialTable`) or not (`Grasps`)."""

    @property
    def T_object_tcp(self) -> Tensor: ...  # noqa: N802

    @property
    def grasp_type(self) -> Tensor: ...


class TriedGrasps(GraspPoses, Protocol):
    """Grasps on one object and how each ended: in simulation (`TrialTable`), or with a robot (`RecordedTrials`)."""

    @property
    def success(self) -> Tensor: ...

    @property
    def grasp_types(self) -> tuple[str, ...]: ...

    def __len__(self) -> int: ...


class Elsewhere(Protocol):
    """Where objects are described, if not here (`cluster.Cluster`)."""

    def describe(self, objects: Sequence[CachedSteps], advance: Callable[[int], None]) -> None:
        """Fill `given` of each with the tensors of the steps that its cache lacks."""


@dataclass(frozen=True)
class Describer:
    """The settings and the hand that describe objects, and the cache that keeps what they are described by."""

    sensing: SensingConfig
    features: FeatureConfig
    affordance: AffordanceConfig
    volumes: Mapping[str, HandVolume]
    seed: int
    device: str = "cpu"
    cache: Cache = field(default_factory=lambda: Cache(None))
    constellations: ConstellationConfig = field(default_factory=ConstellationConfig)
    cluster: Elsewhere | None = None

    @property
    def grasp_types(self) -> tuple[str, ...]:
        """Names of the hand's grasp types."""
        return tuple(sorted(self.volumes))

    def describe(
        self, objects: Sequence[Seen], grasps: Sequence[GraspPoses], stages: ProgressReporter
    ) -> list[DescribedObject]:
        """Sense objects, compute features, look for collisions; a stage of progress each.

        Of many objects `TOGETHER` at a time.
        """
        blocks = [slice(i, i + TOGETHER) for i in range(0, len(objects), TOGETHER)]
        return [each for block in blocks for each in self._described(objects[block], grasps[block], stages)]

    def _described(
        self, objects: Sequence[Seen], grasps: Sequence[GraspPoses], stages: ProgressReporter
    ) -> list[DescribedObject]:
        all_steps = [CachedSteps(self, *each) for each in zip(objects, grasps, strict=True)]

        def in_turn(stage: str, work: Callable[[CachedSteps], T], *made: str) -> list[T]:
            def kept() -> str:
                count = sum(not steps.made & set(made) for steps in all_steps)
                return f", {count} from the cache" if count else ""

            with stages.stage(stage, len(objects), "objects", kept) as advance:
                return [(advance(1), done)[1] for done in in_parts(work, all_steps, THREADS)]

        if self.cluster is not None:
            with stages.stage("describing", len(objects), "objects") as advance:
                self.cluster.describe(all_steps, advance)
        in_turn("sensing", CachedSteps.sense_if_needed, "texlets")
        in_turn("features", lambda steps: steps.features, "features")
        in_turn("collisions", lambda steps: steps.collides, "collisions")
        return [steps.described() for steps in all_steps]


class cached_step(Generic[T]):  # noqa: N801
    """A property that is computed when first asked for: `functools.cached_property` as from Python 3.12 on.

    In Python 3.11 that holds one lock for all objects of a class, and no two threads would ever describe at once.
    """

    def __init__(self, make: Callable[[Any], T]) -> None:
        self.make, self.__doc__ = make, make.__doc__

    def __get__(self, owner: Any, owner_type: type | None = None) -> T:
        value = owner.__dict__[self.make.__name__] = self.make(owner)
        return value


class CachedSteps:
    """The steps of describing one object; each is read from the cache or made when it is first asked for.

    A step's key holds the keys of the steps before it, so nothing need be sensed to find what was made of it.
    """

    def __init__(self, settings: Describer, obj: Seen, grasps: GraspPoses) -> None:
        self.settings, self.obj, self.grasps = settings, obj, grasps
        self.made: set[str] = set()
        self.given: dict[str, dict[str, Tensor]] = {}  # made elsewhere, by step
        surface: Any = obj.digest if isinstance(obj, RecordedView) else (obj.name, obj.mesh.vertices, obj.mesh.faces)
        device, seed, poses = (
            torch.device(settings.device).type,
            settings.seed,
            fingerprint(grasps.T_object_tcp, grasps.grasp_type),
        )
        texlets = _key(sense, surface, settings.sensing, seed)
        describes, needs = descriptor(settings.features), library(settings.features)
        features = _key(describes, texlets, settings.features, needs, seed, device)
        self.keys = {
            "texlets": texlets,
            "features": features,
            "collisions": _key(sensed_collision, texlets, poses, settings.volumes, device),
        }

    @cached_step
    def texlets(self) -> Texlets:
        """What the cameras see, or saw, on the CPU."""
        if isinstance(self.obj, RecordedView):
            return self.obj.texlets
        body = self.obj
        return Texlets(**self._kept("texlets", lambda: vars(sense(body, self.settings.sensing, self.settings.seed))))

    @cached_step
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

    @property
    def pairs(self) -> PosePairs:
        """The features' pairs with the grasps, which are listed where they are asked for: that takes milliseconds."""
        device, poses = self.settings.device, self.features.T_object_feature
        T, grasp_type = self.grasps.T_object_tcp.to(device), self.grasps.grasp_type.to(device)
        return pose_pairs(poses, T, grasp_type, self.settings.affordance, self.generator(1))

    @cached_step
    def collides(self) -> Tensor:
        """(G,) bool: the grasps at which a sensed point lies inside the open hand."""

        def make() -> dict[str, Tensor]:
            device = self.settings.device
            points, T = self.texlets.positions.to(device), self.grasps.T_object_tcp.to(device)
            collides = torch.zeros(len(T), dtype=torch.bool, device=device)
            for code, name in enumerate(self.settings.grasp_types):
                of_type = self.grasps.grasp_type.to(device) == code
                collides[of_type] = sensed_collision(points, T[of_type], self.settings.volumes[name])
            return {"collides": collides}

        return self._kept("collisions", make)["collides"]

    def sense_if_needed(self) -> None:
        """Sense the object unless all that follows from the texlets is in the cache."""
        if not all(self.settings.cache.holds(step, self.keys[step]) for step in ("features", "collisions")):
            self.texlets  # noqa: B018

    def described(self) -> DescribedObject:
        """The object as the learner sees it, without outcomes."""
        asked, around = self.settings.constellations, None
        if asked.words:
            around = surroundings(self.features.T_object_feature, asked)
        return DescribedObject(
            self.features.relations(), self.pairs, self.collides, self.settings.grasp_types, around=around
        )

    def generator(self, stream: int) -> torch.Generator:
        """The object's own random stream: free of the order of objects."""
        name = f"{self.settings.seed}/{stream}/{self.obj.name}"
        return torch.Generator().manual_seed(zlib.crc32(name.encode()))

    def _kept(self, step: str, make: Callable[[], dict[str, Tensor]]) -> dict[str, Tensor]:
        """The tensors of a step on the settings' device, but for texlets, which are on the CPU."""

        def noted() -> dict[str, Tensor]:
            self.made.add(step)
            return self.given.pop(step) if step in self.given else make()

        tensors = self.settings.cache.tensors(step, self.keys[step], noted)
        device = "cpu" if step == "texlets" else self.settings.device
        return {name: tensor.to(device) for name, tensor in tensors.items()}


def _key(compute: Callable[..., Any], *parts: Any) -> str:
    """The key of what the function `compute` of another room makes of `parts`."""
    return fingerprint(code_fingerprint(compute.__module__), Path(__file__).read_bytes(), *parts)
