"""Shared by the scene tests: things with exact normals, and the cameras around them."""

import numpy as np
import pytest
import trimesh


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(7)


@pytest.fixture(scope="session")
def views() -> np.ndarray:
    """(4, 3) viewpoints around the origin, 0.7 m away and 35 deg above the horizon."""
    return 0.7 * np.array([[x, y, 1.0] for x in (-1, 1) for y in (-1, 1)]) / np.sqrt(3)


@pytest.fixture(scope="session")
def ball() -> tuple[np.ndarray, np.ndarray]:
    """4000 points evenly (Fibonacci) on a sphere of 50 mm about (0.1, 0, 0.2), and their normals."""
    i = np.arange(4000)
    z, turn = 1 - (2 * i + 1) / 4000, np.pi * (3 - np.sqrt(5)) * i
    normals = np.stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z], axis=1)
    return 0.05 * normals + [0.1, 0.0, 0.2], normals


@pytest.fixture(scope="session")
def tray() -> trimesh.Trimesh:
    """A box of 100 x 80 x 50 mm without a lid, its walls 3 mm thick."""
    walls = []
    for axis, half in ((0, 0.05), (1, 0.04)):
        for side in (-1, 1):
            size = np.array([0.1, 0.08, 0.05])
            size[axis] = 0.003
            centre = np.zeros(3)
            centre[axis] = side * (half - 0.0015)
            walls.append(trimesh.creation.box(size, transform=trimesh.transformations.translation_matrix(centre)))
    floor = trimesh.creation.box([0.1, 0.08, 0.003])
    floor.apply_translation([0, 0, -0.025 + 0.0015])
    return trimesh.util.concatenate([*walls, floor])


@pytest.fixture(scope="session")
def seen_tray(tray: trimesh.Trimesh, views: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points of the tray that four cameras above it see, and the normals of the faces that they lie on."""
    points, face = trimesh.sample.sample_surface(tray, 40000, seed=1)
    normals = tray.face_normals[face]
    seen = np.zeros(len(points), bool)
    for eye in views:
        ray = eye - points
        towards = (ray * normals).sum(axis=1) > 0.2 * np.linalg.norm(ray, axis=1)
        seen |= towards & ~tray.ray.intersects_any(points + 1e-5 * normals, ray)
    return points[seen], normals[seen]
