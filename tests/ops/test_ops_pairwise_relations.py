"""Eqs. 2-4 against hand-derived values and against acos in float64."""

import math

import numpy as np
import pytest
import torch

from spgf_torch.ops import pairwise_relations as loops
from spgf_torch.ops.pairwise_relations import Pairs, turned

unit = torch.nn.functional.normalize
SEEN = torch.eye(3, dtype=torch.float64)[None]  # a frame along the axes


def pairs_of(*given: torch.Tensor) -> Pairs[np.ndarray]:
    return loops.pairs_of(*(tensor.numpy() for tensor in given))


def relations(pairs: Pairs[np.ndarray], frames: torch.Tensor) -> torch.Tensor:
    return torch.from_numpy(loops.relations(pairs, frames.numpy()))


def reference_frames(normals: torch.Tensor, towards: torch.Tensor) -> torch.Tensor:
    return torch.from_numpy(loops.reference_frames(normals.numpy(), towards.numpy()))


def towards_of(*given: torch.Tensor) -> torch.Tensor:
    return torch.from_numpy(pairs_of(*given).towards)


def angles(local: torch.Tensor, normals: torch.Tensor, frame: torch.Tensor = SEEN) -> torch.Tensor:
    """The relations (3, P) of a centre at the origin with neighbours at local (P, 3), normals (P, 3)."""
    start, neighbour = torch.tensor([0, len(local)]), torch.arange(len(local), dtype=torch.int32)
    return relations(pairs_of(start, neighbour, local.new_zeros((1, 3)), local, normals), frame.to(local))


def random(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def test_angles_of_one_neighbour():
    """Neighbour at (1, 1, -sqrt 2): 45 deg below the plane, half-way from R_x to R_y; its normal along x."""
    found = angles(torch.tensor([[1.0, 1.0, -math.sqrt(2)]]), torch.tensor([[1.0, 0.0, 0.0]]))
    assert found.flatten().tolist() == pytest.approx([math.pi / 4, math.pi / 2, math.pi / 4])


@pytest.mark.parametrize("local", [(0.0, 0.0, 1.0), (0.0, 0.0, -0.01), (0.0009, 0.0, 1.0), (0.0, 0.0, 0.0)])
def test_a_neighbour_along_the_normal_or_at_the_centre_has_no_direction(local):
    found = angles(torch.tensor([local, (0.0011, 0.0, 1.0)]), torch.eye(3)[:2])
    assert found[2].isnan().tolist() == [True, False]


def test_elevation_is_that_of_equation_2():
    """alpha1 = pi/2 - acos(d/|d| . n1), d = X1 - X2 = -local, n1 = z."""
    local = random(100, 3)
    printed = math.pi / 2 - torch.acos(-local[:, 2] / local.norm(dim=1))
    assert torch.allclose(angles(local, unit(local, dim=1))[0], printed, atol=1e-12)


def test_normal_angle_is_that_of_equation_3():
    n = unit(random(100, 3), dim=1)
    assert torch.allclose(angles(random(100, 3, seed=1), n)[1], torch.acos(n[:, 2]), atol=1e-7)


@pytest.mark.parametrize("angle", [0.0, 1e-4, 1.0, math.pi / 2, math.pi - 1e-4, math.pi])
def test_normal_angle_keeps_its_accuracy_in_float32(angle):
    """acos(n1 . n2) in float32 is off by sqrt(2 * 6e-8) = 3.5e-4 at 0 and pi; this form by 4e-7 everywhere."""
    found = angles(torch.tensor([[1.0, 0, 0]]), torch.tensor([[math.sin(angle), 0.0, math.cos(angle)]]))
    assert found.dtype == torch.float32
    assert found[1].item() == pytest.approx(angle, abs=4e-7)


def test_on_a_sphere_both_angles_follow_from_the_chord():
    """Sphere of radius R, outward normals, chord c: the normals differ by 2 asin(c / 2R), and the tangent plane
    and the chord enclose half of that: alpha1 = alpha2 / 2 = asin(c / 2R), positive as a sphere is convex."""
    R, n = 0.05, unit(random(200, 3), dim=1)
    frame = reference_frames(n[:1], n[1:2])
    steps = R * (n[1:] - n[0])
    half = torch.asin((n[1:] - n[0]).norm(dim=1) / 2)
    outside = angles(steps, n[1:], frame)
    assert torch.allclose(outside[0], half, atol=1e-9)
    assert torch.allclose(outside[1], 2 * half, atol=1e-9)
    assert torch.allclose(angles(-steps, n[1:], frame)[0], -half, atol=1e-9)  # seen from inside: concave


def test_pairs_of_several_centres_equal_pairs_of_one():
    cloud, n = random(20, 3), unit(random(20, 3, seed=1), dim=1)
    frames = reference_frames(n, random(20, 3, seed=2))
    neighbour = torch.tensor([3, 5, 7, 1, 19, 0], dtype=torch.int32)
    start = torch.tensor([0, 2, 2, 6])  # centres 4, 5, 6; the second has none
    found = relations(pairs_of(start, neighbour, cloud[4:7], cloud, n), frames[4:7])
    for pair, (i, j) in enumerate([(4, 3), (4, 5), (6, 7), (6, 1), (6, 19), (6, 0)]):
        alone = angles((cloud[j] - cloud[i])[None], n[j : j + 1], frames[i : i + 1])
        assert torch.allclose(found[:, pair : pair + 1], alone, atol=1e-12)


def test_the_reference_axis_points_to_the_mean_of_the_neighbours():
    """Neighbours of the origin at x = 1 and 3 cm and y = 1 cm, their mean at (4/3, 1/3); the second has none."""
    cloud = torch.tensor([[0, 0, 0], [0.01, 0, 0], [0.03, 0, 0], [0, 0.01, 0], [1, 1, 1]], dtype=torch.float64)
    neighbour = torch.tensor([1, 2, 3], dtype=torch.int32)
    towards = towards_of(torch.tensor([0, 3, 3]), neighbour, cloud[[0, 4]], cloud, cloud)
    assert torch.allclose(towards[0], torch.tensor([0.04 / 3, 0.01 / 3, 0], dtype=torch.float64))
    assert torch.equal(towards[1], torch.zeros(3, dtype=torch.float64))
    R_x = reference_frames(torch.tensor([[0.0, 0, 1]] * 2, dtype=torch.float64), towards)[:, :, 0]
    assert torch.allclose(R_x[0], torch.tensor([4.0, 1, 0], dtype=torch.float64) / math.sqrt(17))
    assert torch.allclose(R_x[1].abs(), torch.tensor([1.0, 0, 0], dtype=torch.float64))


def test_far_from_the_origin_the_axis_is_as_exact_as_the_points():
    """The mean of float32 positions would be off by 1e-7 of 10 m; steps between points are exact."""
    near = torch.tensor([[0.0, 0, 0], [2**-7, 0, 0], [0, 2**-8, 0]])
    start, neighbour = torch.tensor([0, 2]), torch.tensor([1, 2], dtype=torch.int32)
    there, here = (towards_of(start, neighbour, cloud[:1], cloud, cloud) for cloud in (near + 16, near))
    assert torch.equal(there, here)


def test_reference_frames_are_right_handed_with_the_normal_last():
    n = torch.cat([torch.eye(3), -torch.eye(3), torch.randn((50, 3), generator=torch.Generator().manual_seed(0))])
    towards = torch.randn((56, 3), generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    towards[::5] = n.double()[::5]  # no direction in the plane
    frames = reference_frames(unit(n.double(), dim=1), towards)
    aligned = (frames[:, :, 0] * towards).sum(dim=1) / (
        towards - (towards * frames[:, :, 2]).sum(1, True) * frames[:, :, 2]
    ).norm(dim=1)
    assert torch.allclose(aligned[1:5], torch.ones(4, dtype=torch.float64))
    identity = torch.eye(3, dtype=torch.float64).expand_as(frames)
    assert torch.allclose(frames.mT @ frames, identity, atol=1e-12)
    assert torch.allclose(torch.linalg.det(frames), torch.ones(56, dtype=torch.float64))
    assert torch.equal(frames[:, :, 2], unit(n.double(), dim=1))


def test_turning_the_frame_lowers_alpha3_by_the_angle():
    frame = reference_frames(torch.tensor([[0.0, 0.6, 0.8]]), torch.zeros(1, 3))
    d = (frame[0] @ torch.tensor([math.cos(1.0), math.sin(1.0), 0.3]))[None]
    before, after = (angles(d, torch.eye(3)[:1], f) for f in (frame, turned(frame, torch.tensor([0.4]))))
    assert before[2].item() == pytest.approx(1.0, abs=1e-6)
    assert after[2].item() == pytest.approx(0.6, abs=1e-6)
    assert torch.allclose(after[:2], before[:2], atol=1e-6)
