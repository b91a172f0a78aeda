"""What the tool of docs/paper.md holds for true of a feature, on boxes, by hand; m."""

import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

from spgf_torch.objects.grasp_object import GraspObject

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "docs/tools"))

from prototype_names import distance, table, truths  # noqa: E402

UP = np.array([[0.0, 0.0, 1.0]])


def solid(mesh: trimesh.Trimesh, category: str = "boxes") -> GraspObject:
    return GraspObject("solid", category, mesh, (), 0.1, np.zeros(3), np.eye(3))


def true_of(mesh: trimesh.Trimesh, at: tuple[float, float, float], category: str = "boxes") -> set[str]:
    found = truths(solid(mesh, category), np.array([at]), UP, 0.03)
    return {word for word, holds in found.items() if holds[0]}


def test_distance_to_segments() -> None:
    """Beside a segment, beyond its end, and without any."""
    a, b = np.array([[0.0, 0, 0]]), np.array([[1.0, 0, 0]])
    points = np.array([[0.5, 0.2, 0], [1.3, 0.4, 0]])
    assert distance(points, a, b) == pytest.approx([0.2, 0.5])
    assert np.isinf(distance(points, a[:0], b[:0])).all()


def test_a_large_box() -> None:
    """Its upper face is 40 mm from the nearest edge in the middle; near a corner two sides fall away, not all."""
    box = trimesh.creation.box((0.12, 0.08, 0.07))
    assert true_of(box, (0, 0, 0.035)) == {"surface"}
    assert true_of(box, (0.05, 0.03, 0.035)) == {"edge"}
    assert true_of(box, (0, 0.015, 0.035)) == {"surface", "edge"}  # 25 mm: within the radius, not within two thirds
    assert true_of(box, (0.05, 0.03, 0.035), "containers") == {"edge", "rim"}


def test_a_small_cube_falls_away_all_around() -> None:
    assert true_of(trimesh.creation.box((0.02, 0.02, 0.02)), (0, 0, 0.01)) == {"cap", "edge", "wall"}


def test_the_foot_of_a_step_is_hollow() -> None:
    """A step 40 mm high, 10 mm beside the feature, is bounded by a hollow crease; its top is too far away to rise."""
    profile = [(-0.15, -0.05), (0.15, -0.05), (0.15, 0), (0, 0), (0, 0.04), (-0.15, 0.04)]
    corners = [(x, y, z) for y in (-0.15, 0.15) for x, z in profile]
    caps = [(3, 4, 5), (3, 5, 0), (3, 0, 1), (3, 1, 2)]  # a fan about the hollow corner
    sides = [side for i in range(6) for j in [(i + 1) % 6] for side in ((i, i + 6, j), (j, i + 6, j + 6))]
    step = trimesh.Trimesh(corners, [*caps, *((c + 6, b + 6, a + 6) for a, b, c in caps), *sides])
    step.fix_normals()
    assert step.is_watertight and true_of(step, (0.01, 0, 0)) == {"inner edge"}


def test_the_table_counts_names() -> None:
    rows = [("wall", {"wall": True, "cap": False}), ("wall", {"wall": False, "cap": True})] * 2 + [("mixed", {})]
    rows = [
        (name, dict.fromkeys(("surface", "inner surface", "inner wall", "rim", "edge", "inner edge"), False) | of)
        for name, of in rows
    ]
    rows[-1][1].update(wall=False, cap=False)
    lines = table(rows).splitlines()
    assert lines[2:] == ["| wall | 4 (80 %) | 50 % | 40 % |", "| mixed | 1 (20 %) | - | - |"]
