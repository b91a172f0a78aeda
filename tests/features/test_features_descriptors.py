"""Every descriptor through the one interface that prototypes, particles and voting know."""

import pytest
import torch

from spgf_torch.errors import InputError
from spgf_torch.features import fpfh as fpfh_module
from spgf_torch.features.config import DESCRIPTORS, FeatureConfig
from spgf_torch.features.descriptors import descriptor, library, width
from spgf_torch.features.interface import LocalFeatures
from spgf_torch.geometry import se3
from spgf_torch.settings import settings


def generator() -> torch.Generator:
    return torch.Generator().manual_seed(0)


def cup(N: int = 300) -> tuple[torch.Tensor, torch.Tensor]:
    """Texlets of a bent sheet seen from both sides, and one far from all others."""
    where = torch.rand(N, 2, generator=generator(), dtype=torch.float64) * torch.tensor([2.5, 0.06])
    out = torch.stack([where[:, 0].cos(), where[:, 0].sin(), torch.zeros(N)], dim=1)
    side = torch.where(torch.arange(N) % 3 == 0, -1.0, 1.0)[:, None]
    positions = 0.04 * out + 0.001 * side * out + torch.tensor([0.0, 0.0, 1.0]) * where[:, 1:]
    lonely = torch.tensor([[0.5, 0.0, 0.0]])
    return torch.cat([positions, lonely]), torch.cat([side * out, torch.tensor([[0.0, 0.0, 1.0]])])


def described(name: str, positions: torch.Tensor, normals: torch.Tensor) -> LocalFeatures:
    if name == "fpfh":
        pytest.importorskip("open3d")
    config = settings(FeatureConfig, descriptor=name)
    return descriptor(config)(positions, normals, config, generator())


@pytest.mark.parametrize("name", DESCRIPTORS)
def test_shapes_frames_and_the_lonely_one(name: str) -> None:
    positions, normals = cup()
    found = described(name, positions, normals)
    N, T = len(positions), found.T_object_feature
    assert T.shape == (N, 4, 4) and found.valid.dtype == torch.bool
    assert found.relations().shape == (N, width(settings(FeatureConfig, descriptor=name)))
    assert found.relations().dtype == torch.float32
    assert found.relations().isfinite().all()
    assert torch.equal(T[:, :3, 3], positions) and torch.allclose(T[:, :3, 2], normals)
    assert torch.allclose(T[:, :3, :3] @ T[:, :3, :3].mT, torch.eye(3, dtype=T.dtype).expand(N, 3, 3), atol=1e-9)
    assert found.valid[:-1].all() and not found.valid[-1]


@pytest.mark.parametrize("name", DESCRIPTORS)
@pytest.mark.parametrize("N", [0, 1, 3])
def test_too_few_texlets_describe_nothing(name: str, N: int) -> None:
    """None, one, and three at one place."""
    found = described(name, torch.zeros(N, 3), torch.eye(3)[:N])
    assert len(found.relations()) == len(found.valid) == len(found.T_object_feature) == N
    assert not found.valid.any() and found.relations().isfinite().all()


@pytest.mark.parametrize("name", DESCRIPTORS)
def test_features_turn_with_the_object(name: str) -> None:
    """A share may differ: whatever a descriptor sorts into cells or bins may fall to the other side by rounding."""
    positions, normals = cup()
    T = se3.random_poses(1, generator()).double()[0]
    still, turned = (
        described(name, positions, normals),
        described(name, se3.transform_points(T, positions), normals @ T[:3, :3].mT),
    )
    same = (still.relations() - turned.relations()).abs().amax(dim=1) < 1e-3
    moved = (T @ still.T_object_feature - turned.T_object_feature).abs().amax(dim=(1, 2)) < 1e-6
    assert same.double().mean() > 0.95 and moved[still.valid].double().mean() > 0.95


@pytest.mark.parametrize("name", DESCRIPTORS)
def test_relations_tell_a_plane_from_an_edge(name: str) -> None:
    """A sheet of 100 mm that turns down by 90 deg at x = 0."""
    along = 0.005 * torch.arange(20.0)
    x, y = torch.meshgrid(along, along, indexing="ij")
    flat = torch.stack([x, y, 0 * x], dim=-1).view(-1, 3)
    down = torch.stack([0 * x, y, -0.005 - x], dim=-1).view(-1, 3)
    normals = torch.tensor([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]]).repeat_interleave(len(flat), dim=0)
    found = described(name, torch.cat([flat, down]), normals).relations()[: len(flat)]
    middle = (flat[:, 1] > 0.03) & (flat[:, 1] < 0.065)
    at_edge, inside = found[middle & (flat[:, 0] == 0)], found[middle & (flat[:, 0] > 0.03) & (flat[:, 0] < 0.065)]
    assert ((at_edge.mean(0) - inside.mean(0)).abs() > 0.05 + 2 * inside.std(0)).any()


def test_without_open3d_fpfh_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(name: str) -> str:
        raise fpfh_module.PackageNotFoundError(name)

    monkeypatch.setattr(fpfh_module, "version", missing)
    config = settings(FeatureConfig, descriptor="fpfh")
    for refused in (lambda: library(config), lambda: descriptor(config)(*cup(), config, generator())):
        with pytest.raises(InputError, match=r"spgf-torch\[baselines\]"):
            refused()
    assert library(settings(FeatureConfig)) == ""
