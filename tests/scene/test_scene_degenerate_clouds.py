"""Lines and lone planes give no grasp, in words; a small thing on a wide table does."""

import numpy as np
import pytest

from spgf_torch.scene.assembly import scene_of_clouds
from spgf_torch.scene.cloud import Cloud
from spgf_torch.scene.config import SceneConfig
from spgf_torch.scene.scene import Scene
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.settings import settings

RNG = np.random.default_rng(0)
SENSING = settings(SensingConfig)
LINE = np.linspace(0, 0.3, 600)[:, None] * [1, 0.2, 0]


def scene(points: np.ndarray) -> Scene:
    cloud = Cloud(points, None, np.array([[0.2, -0.3, 0.7]]))
    return scene_of_clouds([cloud], settings(SceneConfig), SENSING, np.random.default_rng(0))


def plane(noise: float, count: int = 8000) -> np.ndarray:
    return np.column_stack([(RNG.random((count, 2)) - 0.5) * [0.4, 0.3], RNG.normal(0, noise, count)])


def dome(radius: float, count: int) -> np.ndarray:
    up = RNG.normal(size=(count, 3))
    up[:, 2] = np.abs(up[:, 2])
    return radius * up / np.linalg.norm(up, axis=1, keepdims=True)


@pytest.mark.parametrize(
    ("points", "why"),
    [
        (LINE, "on one line"),
        (LINE + RNG.normal(0, 0.002, (600, 3)), "on one line"),
        (np.concatenate([LINE + np.array([0, 0.02 * k, 0]) for k in range(8)]), "along lines"),
        (LINE[:3] * 50, "on one line"),
        (np.repeat([[0, 0, 0], [0.05, 0, 0]], 500, axis=0) + RNG.normal(0, 0.0005, (1000, 3)), "on one line"),
        (0.1 * np.column_stack([f(np.linspace(0, 6.28, 800)) for f in (np.cos, np.sin, np.zeros_like)]), "along lines"),
        (plane(0.0), "in one plane"),
        (plane(0.002), "in one plane"),
        (plane(0.004, 20000), "in one plane"),
        (plane(0.001) @ np.linalg.qr(RNG.normal(size=(3, 3)))[0] * 0.4, "in one plane"),
    ],
    ids=["line", "noisy-line", "lines", "three-points", "two-places", "circle", "clean", "noisy", "far", "tilted"],
)
def test_no_surface_to_close_on(points: np.ndarray, why: str) -> None:
    found = scene(points).no_grasp
    assert found is not None and why in found


@pytest.mark.parametrize(
    "points",
    [dome(0.05, 8000)[:, [0, 2, 1]] * [1, -1, 1], np.concatenate([plane(0.001, 40000), dome(0.025, 400)])],
    ids=["patch", "small-thing-on-a-table"],
)
def test_surfaces(points: np.ndarray) -> None:
    assert scene(points).no_grasp is None
