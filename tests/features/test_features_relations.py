"""Eqs. 2-4 against hand-derived values and against acos in float64."""

import math

import pytest
import torch

from spgf_torch.features.relations import alpha1, alpha2, alpha3, in_frame, reference_frames, turned

unit = torch.nn.functional.normalize


def test_angles_of_one_neighbour():
    """Neighbour at (1, 1, -sqrt 2): 45 deg below the plane, half-way from R_x to R_y."""
    local = torch.tensor([[1.0], [1.0], [-math.sqrt(2)]])
    assert alpha1(local).item() == pytest.approx(math.pi / 4)
    assert alpha3(local).item() == pytest.approx(math.pi / 4)


def test_elevation_is_that_of_equation_2():
    """alpha1 = pi/2 - acos(d/|d| . n1), d = X1 - X2 = -local, n1 = z."""
    local = torch.randn((3, 100), generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    printed = math.pi / 2 - torch.acos(-local[2] / local.norm(dim=0))
    assert torch.allclose(alpha1(local), printed, atol=1e-12)


def test_normal_angle_is_that_of_equation_3():
    n = unit(torch.randn((2, 3, 100), generator=torch.Generator().manual_seed(0), dtype=torch.float64), dim=1)
    assert torch.allclose(alpha2(n[0], n[1]), torch.acos((n[0] * n[1]).sum(0)), atol=1e-7)


@pytest.mark.parametrize("angle", [0.0, 1e-4, 1.0, math.pi / 2, math.pi - 1e-4, math.pi])
def test_normal_angle_keeps_its_accuracy_in_float32(angle):
    """acos(n1 . n2) in float32 is off by sqrt(2 * 6e-8) = 3.5e-4 at 0 and pi; this form by 4e-7 everywhere."""
    n1, n2 = torch.tensor([[1.0], [0.0], [0.0]]), torch.tensor([[math.cos(angle)], [math.sin(angle)], [0.0]])
    assert alpha2(n1, n2).item() == pytest.approx(angle, abs=4e-7)


def test_on_a_sphere_both_angles_follow_from_the_chord():
    """Sphere of radius R, outward normals, chord c: the normals differ by 2 asin(c / 2R), and the tangent plane
    and the chord enclose half of that: alpha1 = alpha2 / 2 = asin(c / 2R), positive as a sphere is convex."""
    R = 0.05
    n = unit(torch.randn((200, 3), generator=torch.Generator().manual_seed(0), dtype=torch.float64), dim=1)
    centre, others = n[:1].expand(199, 3), n[1:]
    frames = reference_frames(centre, others).permute(2, 1, 0)
    local = in_frame(frames, R * (others - centre).T)
    half = torch.asin((others - centre).norm(dim=1) / 2)
    assert torch.allclose(alpha1(local), half, atol=1e-9)
    assert torch.allclose(alpha2(centre.T, others.T), 2 * half, atol=1e-9)
    assert torch.allclose(alpha1(-local), -half, atol=1e-9)  # seen from inside: concave


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
    frame, angle = reference_frames(torch.tensor([[0.0, 0.6, 0.8]]), torch.zeros(1, 3)), torch.tensor([0.4])
    d = frame[0] @ torch.tensor([[math.cos(1.0)], [math.sin(1.0)], [0.3]])
    local = in_frame(turned(frame, angle).permute(2, 1, 0), d)
    assert alpha3(local).item() == pytest.approx(0.6, abs=1e-6)
    assert local[2].item() == pytest.approx(0.3, abs=1e-6)
