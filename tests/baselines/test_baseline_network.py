"""The network, its loss and its augmentation: hand-derived values, symmetries, a slow loop."""

import math

import pytest
import torch
from tiny import AUGMENT, NETWORK, RADIUS

from spgf_torch.baselines.config import AugmentConfig, NetworkConfig, check_network
from spgf_torch.baselines.pointnet import PointNet, augmented, balance, balanced_loss, fourier, grasp_logits
from spgf_torch.errors import InputError

EACH = torch.ones(7, dtype=torch.bool)  # all hands are symmetric
STILL = AugmentConfig(points=100, mirror=False, rotation_deg=0.0, shift=0.0, jitter=0.0)


def generator(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


@pytest.fixture
def network() -> PointNet:
    return PointNet(NETWORK, 2, RADIUS, generator())


def cloud(count: int = 7, seed: int = 1) -> torch.Tensor:
    return 0.05 * torch.randn(count, 12, 3, generator=generator(seed))


def test_a_cloud_is_a_set(network: PointNet) -> None:
    """Neither order nor repetition of points matters: exports repeat the points of sparse clouds."""
    kind, points = torch.zeros(7, dtype=torch.int64), cloud()
    expected = network(points, kind)
    shuffled = points[:, torch.randperm(12, generator=generator(2))]
    torch.testing.assert_close(network(shuffled, kind), expected)
    torch.testing.assert_close(network(torch.cat([points, points[:, :5]], 1), kind), expected)


def test_the_type_is_told(network: PointNet) -> None:
    points = cloud()
    assert not torch.allclose(network(points, torch.zeros(7).long()), network(points, torch.ones(7).long()))


def test_three_types_are_told_apart() -> None:
    network, points = PointNet(NETWORK, 3, RADIUS, generator()), cloud()
    told = [network(points, torch.full((7,), kind)) for kind in range(3)]
    assert not torch.allclose(told[0], told[2]) and not torch.allclose(told[1], told[2])
    assert network.points[0].in_features == PointNet(NETWORK, 2, RADIUS, generator()).points[0].in_features + 1


def test_the_network_is_a_loop_over_points(network: PointNet) -> None:
    """Point by point, layer by layer, in float64."""
    kinds, points = torch.tensor([0, 1, 1, 0, 1, 0, 0]), cloud()
    layers = [m for m in network.double().modules() if isinstance(m, torch.nn.Linear)]
    expected = []
    for one, kind in zip(points.double(), kinds.tolist(), strict=True):
        best = torch.full((16,), -math.inf, dtype=torch.float64)
        for point in one:
            waves = [wave(math.pi * x / RADIUS) for wave in (math.sin, math.cos) for x in point.tolist()]
            x = torch.cat([point / RADIUS, torch.tensor(waves).double(), torch.eye(2, dtype=torch.float64)[kind]])
            for layer in layers[:2]:
                x = (layer.weight @ x + layer.bias).clamp(min=0)
            best = torch.maximum(best, x)
        hidden = (layers[2].weight @ best + layers[2].bias).clamp(min=0)
        expected.append((layers[3].weight @ hidden + layers[3].bias).item())
    got = network(points.double(), kinds)
    torch.testing.assert_close(got, torch.tensor(expected, dtype=torch.float64), rtol=1e-6, atol=1e-6)  # radius: f32


def test_waves_by_hand() -> None:
    """x = 1/4: sin and cos of pi/4 are 1/sqrt 2, of pi/2 they are 1 and 0; x = 0 has sines 0 and cosines 1."""
    half = math.sqrt(0.5)
    expected = torch.tensor([0.25, 0.0, half, 1.0, 0.0, 0.0, half, 0.0, 1.0, 1.0], dtype=torch.float64)
    torch.testing.assert_close(fourier(torch.tensor([0.25, 0.0], dtype=torch.float64), 2), expected)
    assert torch.equal(fourier(torch.tensor([0.25, 0.0]), 0), torch.tensor([0.25, 0.0]))


def test_in_parts_is_at_once(network: PointNet, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("spgf_torch.baselines.pointnet.CHUNK", 3)
    kinds, points = torch.tensor([0, 1, 1, 0, 1, 0, 0]), cloud()
    torch.testing.assert_close(grasp_logits(network, points.half(), kinds), network(points.half().float(), kinds))


def test_every_type_and_outcome_weighs_the_same() -> None:
    """Three failures and one success of NPG, two failures of WPG: three kinds, a third each, shared by its trials."""
    kind = torch.tensor([0, 0, 0, 0, 1, 1])
    success = torch.tensor([False, False, False, True, False, False])
    expected = torch.tensor([1 / 9, 1 / 9, 1 / 9, 1 / 3, 1 / 6, 1 / 6], dtype=torch.float64)
    torch.testing.assert_close(balance(kind, success), expected)


def test_balanced_loss_by_hand() -> None:
    """A logit of 0 costs log 2 whatever the outcome; log 3, p = 3/4, costs log(4/3) where it held and log 4 else."""
    kind, success = torch.tensor([0, 0, 0]), torch.tensor([True, False, False])
    loss = balanced_loss(torch.tensor([math.log(3), 0.0, math.log(3)]), kind, success)
    assert loss.item() == pytest.approx((math.log(4 / 3) + (math.log(2) + math.log(4)) / 2) / 2, rel=1e-6)


def test_augmentation_keeps_what_it_should() -> None:
    points = cloud()
    torch.testing.assert_close(augmented(points, EACH, STILL, generator()).sort(1).values, points.sort(1).values)
    fewer = augmented(points, EACH, AugmentConfig(5, False, 0.0, 0.0, 0.0), generator())
    assert fewer.shape == (7, 5, 3) and all(any((p == q).all() for q in points[0]) for p in fewer[0])
    mirrored = augmented(points, EACH, AugmentConfig(100, True, 0.0, 0.0, 0.0), generator(3))
    torch.testing.assert_close(mirrored.abs().sort(1).values, points.abs().sort(1).values)
    flipped = (mirrored[..., 0].sort(1).values - points[..., 0].sort(1).values).abs().amax(1) > 1e-6
    assert 0 < flipped.sum() < 7  # some, not all
    symmetric = torch.arange(7) < 4
    mirrored = augmented(points, symmetric, AugmentConfig(100, True, 0.0, 0.0, 0.0), generator(3))
    again = (mirrored[..., 0].sort(1).values - points[..., 0].sort(1).values).abs().amax(1) > 1e-6
    assert torch.equal(again, flipped & symmetric) and not torch.equal(again, flipped)  # only hands that allow it
    turned = augmented(points, EACH, AugmentConfig(100, False, 20.0, 0.0, 0.0), generator(4))
    torch.testing.assert_close(turned.norm(dim=2).sort(1).values, points.norm(dim=2).sort(1).values)
    assert torch.equal(augmented(points, EACH, AUGMENT, generator(5)), augmented(points, EACH, AUGMENT, generator(5)))


def test_noise_is_as_large_as_the_settings_say() -> None:
    """2 mm of the whole cloud and 1 mm of each point, over 4000 clouds: the sample's deviations are within 5 %."""
    moved = augmented(
        torch.zeros(4000, 10, 3), torch.ones(4000).bool(), AugmentConfig(10, False, 0.0, 0.002, 0.001), generator(6)
    )
    assert moved.mean(1).std().item() == pytest.approx(math.hypot(0.002, 0.001 / math.sqrt(10)), rel=0.05)
    assert (moved - moved.mean(1, keepdim=True)).std().item() == pytest.approx(0.001 * math.sqrt(0.9), rel=0.05)


@pytest.mark.parametrize(("key", "layers"), [("widths", []), ("widths", [0]), ("head", [9999]), ("head", [8] * 17)])
def test_layers_that_are_none_are_refused(key: str, layers: list[int]) -> None:
    with pytest.raises(InputError, match=rf"network\.{key}: expected .* got \["):
        check_network(NetworkConfig(**{"frequencies": 0, "widths": [4], "head": [], key: layers}))
