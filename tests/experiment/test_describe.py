"""Describing objects with and without a cache: the same bits, nothing made twice, nothing stale."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
import trimesh

from spgf_torch.affordance.config import AffordanceConfig
from spgf_torch.affordance.sensed_collision import hand_volume
from spgf_torch.cache import Cache
from spgf_torch.experiment import describe as module
from spgf_torch.experiment.describe import CachedSteps, Describer, Grasps
from spgf_torch.experiment.described_object import DescribedObject
from spgf_torch.features.config import FeatureConfig
from spgf_torch.features.descriptors import descriptor
from spgf_torch.geometry import se3
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.progress import ProgressReporter
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.settings import settings


def block(name: str, size: tuple[float, float, float]) -> GraspObject:
    mesh = trimesh.creation.box(size)
    mesh.apply_translation((0, 0, size[2] / 2))
    return GraspObject(name, "boxes", mesh, (mesh.vertices,), 0.2, mesh.center_mass, mesh.moment_inertia)


def random_grasps(seed: int) -> Grasps:
    """Forty poses within 10 cm of the origin, half of each type."""
    generator = torch.Generator().manual_seed(seed)
    T = se3.random_poses(40, generator)
    T[:, :3, 3] = 0.1 * torch.rand(40, 3, generator=generator)
    return Grasps(T, torch.arange(2).repeat_interleave(20))


OBJECTS = [block("brick", (0.05, 0.06, 0.08)), block("slab", (0.1, 0.06, 0.02))]
GRASPS = [random_grasps(1), random_grasps(2)]
VOLUME = {kind: hand_volume([trimesh.creation.box((side, 0.03, 0.03))]) for kind, side in (("NPG", 0.05), ("WPG", 0.1))}


def describer(cache: Cache | None = None, **changes: Any) -> Describer:
    sensing = settings(SensingConfig, width=160, height=120, focal=144)
    made = Describer(sensing, settings(FeatureConfig), settings(AffordanceConfig, features_per_object=30), VOLUME, 0)
    return replace(made, cache=cache or Cache(None), **changes)


def described(settings_: Describer) -> list[DescribedObject]:
    return settings_.describe(OBJECTS, GRASPS, ProgressReporter())


def same(first: list[DescribedObject], second: list[DescribedObject]) -> bool:
    """Equal to the bit, types included."""

    def tensors(obj: DescribedObject) -> list[torch.Tensor]:
        return [obj.relations, obj.collides, *vars(obj.pairs.listed()).values()]

    both = [(a, b) for x, y in zip(first, second, strict=True) for a, b in zip(tensors(x), tensors(y), strict=True)]
    return all(a.dtype == b.dtype and torch.equal(a, b) for a, b in both)


def test_objects_described_one_after_the_other_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    together = described(describer())
    monkeypatch.setattr(module, "TOGETHER", 1)
    assert same(described(describer()), together)


def test_a_cache_changes_no_bit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    without = described(describer())
    assert all(len(obj.pairs.listed().feature) and obj.collides.any() and not obj.collides.all() for obj in without)
    cold = described(describer(Cache(tmp_path)))
    assert "cache" not in capsys.readouterr().err
    for step in ("sense", "sensed_collision"):
        monkeypatch.setattr(module, step, forbidden(getattr(module, step)))
    monkeypatch.setattr(module, "descriptor", lambda config: forbidden(descriptor(config)))
    warm = described(describer(Cache(tmp_path)))
    assert same(without, cold) and same(without, warm)
    assert capsys.readouterr().err.count(", 2 from the cache") == 3


def forbidden(step: Any) -> Any:
    """A stand-in for `step` that must not be called; its key is that of `step`."""

    def call(*arguments: Any) -> None:
        raise AssertionError(f"{step.__name__} was called")

    call.__module__ = step.__module__
    return call


def test_other_features_need_no_sensing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    other = settings(FeatureConfig, radius=0.02)
    without = described(describer(features=other))
    described(describer(Cache(tmp_path)))
    monkeypatch.setattr(module, "sense", forbidden(module.sense))
    assert same(described(describer(Cache(tmp_path), features=other)), without)


def test_damaged_entries_change_no_bit(tmp_path: Path) -> None:
    cold = described(describer(Cache(tmp_path)))
    for path in tmp_path.iterdir():
        path.write_bytes(path.read_bytes()[:-5])
    assert same(described(describer(Cache(tmp_path))), cold)
    assert same(described(describer(Cache(tmp_path))), cold)


def test_objects_are_found_one_by_one(tmp_path: Path) -> None:
    both = described(describer(Cache(tmp_path)))
    files = sorted(tmp_path.iterdir())
    turned = describer(Cache(tmp_path)).describe(OBJECTS[::-1], GRASPS[::-1], ProgressReporter())
    assert same(turned[::-1], both) and sorted(tmp_path.iterdir()) == files


ALL = {"texlets", "features", "collisions"}


@pytest.mark.parametrize(
    ("changes", "anew"),
    [
        ({}, set()),
        ({"seed": 1}, ALL),
        ({"sensing": settings(SensingConfig, cameras=3, width=160, height=120, focal=144)}, ALL),
        ({"features": settings(FeatureConfig, layers=1)}, {"features"}),
        ({"features": settings(FeatureConfig, descriptor="patch_pairs")}, {"features"}),
        ({"affordance": settings(AffordanceConfig, features_per_object=30, reach=0.08)}, set()),
        ({"affordance": settings(AffordanceConfig, features_per_object=30, kernel=0.01, min_support=9)}, set()),
        ({"volumes": {**VOLUME, "WPG": VOLUME["NPG"]}}, {"collisions"}),
    ],
)
def test_what_a_setting_makes_anew(changes: dict[str, Any], anew: set[str]) -> None:
    before = CachedSteps(describer(), OBJECTS[0], GRASPS[0]).keys
    after = CachedSteps(describer(**changes), OBJECTS[0], GRASPS[0]).keys
    assert {kind for kind in ALL if before[kind] != after[kind]} == anew


def test_what_an_input_makes_anew() -> None:
    def keys(obj: GraspObject, grasps: Grasps) -> dict[str, str]:
        return CachedSteps(describer(), obj, grasps).keys

    first = keys(OBJECTS[0], GRASPS[0])
    tried = keys(OBJECTS[0], GRASPS[1])
    assert {kind for kind in ALL if first[kind] != tried[kind]} == {"collisions"}
    for obj in (block("brick", (0.05, 0.06, 0.0800001)), block("block", (0.05, 0.06, 0.08))):
        assert all(first[kind] != keys(obj, GRASPS[0])[kind] for kind in ALL)
    heavier = replace(OBJECTS[0], mass=2.0)  # is not seen
    assert keys(heavier, GRASPS[0]) == first
