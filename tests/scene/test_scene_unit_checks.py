"""Numbers that are no metres are refused or told; true depths never."""

from collections.abc import Callable

import numpy as np
import pytest
import trimesh

from spgf_torch.errors import InputError
from spgf_torch.scene.config import SceneConfig
from spgf_torch.scene.depth import pixel_points
from spgf_torch.scene.planes import LargestPlane
from spgf_torch.scene.unit_checks import check_depth_image, size_notes
from spgf_torch.scene.views import View
from spgf_torch.sensing.cameras import Camera, cast, intrinsics, look_at
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.sensing.noise import measure
from spgf_torch.settings import settings

SENSING = settings(SensingConfig)
EYE = np.array([0.3, -0.4, 0.5])
CAMERA = Camera(intrinsics(SENSING), look_at(EYE, np.zeros(3)), SENSING.width, SENSING.height)
LENGTH = np.linalg.norm(CAMERA.rays(), axis=2)


@pytest.fixture(scope="module")
def ideal() -> tuple[np.ndarray, np.ndarray]:
    """Depth and cosine of a box and a ball on a table."""
    box = trimesh.creation.box([0.1, 0.06, 0.12]).apply_translation([0, 0, 0.06])
    ball = trimesh.creation.icosphere(3, 0.04).apply_translation([0.15, 0.05, 0.04])
    table = trimesh.creation.box([0.9, 0.8, 0.02]).apply_translation([0, 0, -0.01])
    return cast(trimesh.util.concatenate([box, ball, table]), CAMERA)


def view(depth: np.ndarray, scale: float | None = 0.001) -> View:
    return View(depth, CAMERA, None, "depth.npy", scale=scale)


@pytest.mark.parametrize("kind", ["clean", "rounded", "kinect"])
def test_true_depths(kind: str, ideal: tuple[np.ndarray, np.ndarray]) -> None:
    depth, cosine = ideal
    if kind == "rounded":
        depth = np.round(depth, 3)
    if kind == "kinect":
        depth = measure(depth, cosine, SENSING.focal, SENSING, np.random.default_rng(0))
    check_depth_image(view(depth))


@pytest.mark.parametrize(
    ("reading", "what"),
    [
        (lambda z: (10 / 9.9) * (1 - 0.1 / z), "depth buffer"),
        (lambda z: 1 - (10 / 9.9) * (1 - 0.1 / z), "depth buffer"),
        (lambda z: 0.05 / z, "disparities"),
        (lambda z: z * LENGTH[z_seen(z)], "along the rays"),
        (lambda z: (1 / z) / (1 / z).max(), "exactly 1"),
        (lambda z: (z - z.min()) / np.ptp(z), "exactly 1"),
    ],
    ids=["buffer", "reversed", "disparity", "range", "relative", "normalised"],
)
def test_other_numbers(
    reading: Callable[[np.ndarray], np.ndarray], what: str, ideal: tuple[np.ndarray, np.ndarray]
) -> None:
    depth = ideal[0].copy()
    seen = depth > 0
    z_seen.mask = seen
    depth[seen] = reading(depth[seen])
    with pytest.raises(InputError, match=f"depth.npy: expected depths z in m, got .*{what}"):
        check_depth_image(view(depth))


class _Seen:
    """Which pixels have a depth, for readings that need their rays."""

    mask: np.ndarray

    def __call__(self, z: np.ndarray) -> np.ndarray:
        assert len(z) == self.mask.sum()
        return self.mask


z_seen = _Seen()


@pytest.mark.parametrize("alone", [True, False])
@pytest.mark.parametrize("factor", [1, 4, 5, 10, 0.25, 0.2, 0.1])
def test_another_depth_scale_is_told(factor: float, alone: bool, ideal: tuple[np.ndarray, np.ndarray]) -> None:
    depth = factor * ideal[0]
    points = pixel_points(depth, CAMERA)[depth > 0]
    chosen = points[points[:, 2] - EYE[2] * (1 - factor) > 0.008 * factor] if alone else points
    moved = chosen - EYE
    notes = size_notes(LargestPlane(moved, settings(SceneConfig)), [view(depth)], alone)
    assert "median" in notes[0]
    assert any("depth_scale" in note for note in notes[1:]) == (factor != 1), notes


@pytest.mark.parametrize(
    ("stated", "factor", "remedy"), [(0.01, 10, "0.001 (millimetres)"), (0.0002, 0.2, "0.001 (mil")]
)
def test_a_depth_scale_that_was_stated_is_what_others_are_told_against(
    stated: float, factor: float, remedy: str, ideal: tuple[np.ndarray, np.ndarray]
) -> None:
    """Millimetres that were read as something else: the scale that is right is offered, not one ten times off."""
    depth = factor * ideal[0]
    points, config = pixel_points(depth, CAMERA)[depth > 0], settings(SceneConfig)
    chosen = points[points[:, 2] - EYE[2] * (1 - factor) > 0.008 * factor]
    largest = LargestPlane(chosen - EYE, config)
    lines = size_notes(largest, [view(depth, stated)], True)
    (line,) = [note for note in lines if "depth_scale" in note]
    assert remedy in line and f"{stated:g} (" not in line
    (line,) = [note for note in size_notes(largest, [view(depth, None)], True) if "warn" in note]
    assert "depth_scale" not in line and "unit=m" in line  # of lengths, which no depth_scale is taken with


@pytest.mark.parametrize(("factor", "odd"), [(1, False), (10, True), (100, True), (0.1, True)])
def test_another_unit_of_a_cloud_is_told(factor: float, odd: bool) -> None:
    up = np.random.default_rng(0).normal(size=(4000, 3))
    ball = factor * 0.05 * up / np.linalg.norm(up, axis=1, keepdims=True)
    notes = size_notes(LargestPlane(ball, settings(SceneConfig)), None, True)
    assert any("unit=m" in note for note in notes[1:]) == odd
