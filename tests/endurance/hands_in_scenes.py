"""Hands under the table, in obstacles or behind a mask, of the 20 best in each of many scenes: none is right.

    python tests/endurance/hands_in_scenes.py [MODEL]      a folder that train left; outputs/train/latest

Scenes: the depth image of ../shared/cases with its masks, and made ones: an object on a table among neighbours, beside
a wall or in a bin, seen by the noisy camera of conf/sensing; marked by a mask, a crop box or segments. What a hand
touches is asked of the corners of its shapes (table) and of every raw point that is not the target's (obstacles),
without anything of `proposing`. One pixel from the target's outline counts as its own: flying pixels are between both.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from scipy.ndimage import binary_dilation
from scipy.spatial import ConvexHull

import spgf_torch
from spgf_torch.objects.library import load_objects
from spgf_torch.paths import root
from spgf_torch.predictor import Predictor
from spgf_torch.scene.depth_files import read_depth_file
from spgf_torch.scene.labels import read_mask
from spgf_torch.sensing.cameras import Camera, cast, intrinsics, look_at
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.sensing.noise import measure
from spgf_torch.settings import settings

CASES = Path(__file__).parents[3] / "shared" / "cases"
SENSING = settings(SensingConfig)
# m; hands may touch the table's noise and a voxel's corner, not more.
TOUCH = 1e-3


@dataclass(frozen=True)
class Case:
    """A scene, the raw points (N, 3) that are no target, and the height of the table (None: not known), z up."""

    name: str
    scene: spgf_torch.Scene
    others: np.ndarray
    table: float | None


def points_of(depth: np.ndarray, camera: Camera, where: np.ndarray) -> np.ndarray:
    """(N, 3) the points of the pixels (H, W) bool that have a return."""
    T = camera.T_object_camera
    seen = where & np.isfinite(depth) & (depth > 0)
    return (depth[seen, None] * camera.rays()[seen]) @ T[:3, :3].T + T[:3, 3]


def made(rng: np.random.Generator, number: int) -> Iterator[Case]:
    """An object on a table, with neighbours or a wall, and the three ways to mark it."""
    objects = load_objects(root() / "data/objects")
    meshes = []
    for j, i in enumerate(rng.choice(len(objects), 3, replace=False)):
        mesh = objects[i].mesh.copy()
        turn = rng.uniform(0, 2 * np.pi)
        apart = 0.0 if j == 0 else rng.uniform(0.1, 0.16)
        mesh.apply_transform(trimesh.transformations.rotation_matrix(turn, [0, 0, 1]))
        place = apart * np.array([np.cos(turn * 7), np.sin(turn * 7), 0.0])
        mesh.apply_translation(place - [*mesh.bounds.mean(axis=0)[:2], mesh.bounds[0, 2]])
        meshes.append(mesh)
    wall = trimesh.creation.box([0.5, 0.02, 0.3])
    wall.apply_translation([0.0, meshes[0].bounds[1, 1] + 0.07 + 0.01, 0.15])
    board = trimesh.creation.box([0.7, 0.7, 0.02])
    board.apply_translation([0, 0, -0.01])
    beside = [wall] if number % 2 else meshes[1:]
    whole = trimesh.util.concatenate([meshes[0], *beside, board])
    azimuth, elevation = rng.uniform(-np.pi, 0), np.deg2rad(rng.uniform(30, 65))
    direction = np.array([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)])
    middle = np.array([0, 0, 0.04])
    camera = Camera(intrinsics(SENSING), look_at(middle + 0.65 * direction, middle), SENSING.width, SENSING.height)
    depth, cosine = cast(whole, camera)
    first, _ = cast(meshes[0], camera)
    own = (first > 0) & (np.abs(first - depth) < 1e-6)
    if own.sum() < 300:  # hidden by its neighbours
        return
    depth = measure(depth, cosine, camera.K[0, 0], SENSING, rng)
    away = ~binary_dilation(own, iterations=1)
    all_points = points_of(depth, camera, np.ones_like(own))
    others = points_of(depth, camera, away)
    others = others[others[:, 2] > 0.008]
    T = camera.T_object_camera
    args = (depth, camera.K, T)
    for table in ("find", None):
        known = 0.0 if table else None
        kept = others if table else points_of(depth, camera, away)
        yield Case(f"made {number} mask", spgf_torch.Scene.from_depth(*args, mask=own, table=table), kept, known)
    bounds = meshes[0].bounds + np.array([[-0.004], [0.004]])
    low, high = [*bounds[0][:2], -1.0], [*bounds[1][:2], 1.0]
    outside = ~((all_points >= low) & (all_points <= high)).all(axis=1) & (all_points[:, 2] > 0.008)
    cloud = spgf_torch.Scene.from_points(all_points, T[:3, 3], table="find", crop_low=low, crop_high=high)
    yield Case(f"made {number} crop", cloud, all_points[outside], 0.0)


def of_cases() -> Iterator[Case]:
    """The box and the mug of the shared cases, both, and each of what the mask marks."""
    if not CASES.is_dir():
        return
    K, T = np.loadtxt(CASES / "K.txt"), np.loadtxt(CASES / "pose_cam_to_world.txt")
    depth = read_depth_file(CASES / "depth_mm.png", 10**7).values * 0.001
    mask = read_mask(CASES / "mask.png", 10**7)
    camera = Camera(K, T, depth.shape[1], depth.shape[0])
    others = points_of(depth, camera, ~binary_dilation(mask, iterations=1))
    others = others[others[:, 2] > 0.008]
    yield Case("cases", spgf_torch.Scene.from_depth(depth, K, T, table="find"), others[:0], 0.0)
    yield Case("cases, mask", spgf_torch.Scene.from_depth(depth, K, T, mask=mask, table="find"), others, 0.0)
    yield Case("cases, mask, no table", spgf_torch.Scene.from_depth(depth, K, T, mask=mask), others, 0.0)


def touched(model: Predictor, case: Case) -> tuple[int, int, int]:
    """How many of the 20 best there are, have a part of the hand under the table, and have a point of others inside."""
    under = inside = 0
    grasps = model.predict(case.scene, top=10)
    for grasp in grasps:
        low, hit = np.inf, False
        for shape in model.grippers[grasp.type].shapes:
            corners = shape.vertices @ grasp.T_input_tcp[:3, :3].T + grasp.T_input_tcp[:3, 3]
            low = min(low, float(corners[:, 2].min()))
            if len(case.others):
                faces = ConvexHull(corners).equations
                hit |= bool((case.others @ faces[:, :3].T + faces[:, 3] < -TOUCH).all(axis=1).any())
        under += case.table is not None and low < case.table - TOUCH
        inside += hit
    return len(grasps), under, inside


def main(folder: str, scenes: int = 20) -> int:
    model, rng = spgf_torch.load(folder), np.random.default_rng(0)
    total = np.zeros(3, int)
    for cases in (of_cases(), *(made(rng, number) for number in range(scenes))):
        for case in cases:
            counts = touched(model, case)
            total += counts
            print(
                f"{case.name:24} {counts[0]:3d} hands, {counts[1]} under the table, {counts[2]} in obstacles",
                flush=True,
            )
    print(f"in all {total[0]} hands, {total[1]} under the table, {total[2]} in obstacles or behind a mask")
    return int(total[1:].any())


if __name__ == "__main__":
    sys.exit(main(sys.argv[1] if len(sys.argv) > 1 else "outputs/train/latest"))
