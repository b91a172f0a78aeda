"""What noisy depth cameras see of objects on a table. World frame: the table is z = 0, z up; m."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import trimesh

from spgf_torch.scene.assembly import scene_of_views
from spgf_torch.scene.config import SceneConfig
from spgf_torch.scene.scene import Scene
from spgf_torch.scene.views import View
from spgf_torch.sensing.cameras import Camera, cast, surround
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.sensing.noise import measure
from spgf_torch.settings import settings
from spgf_torch.simulation.arrangements import Placed

AIM = np.array([0.0, 0.0, 0.05])  # m; what cameras look at: the middle of things of usual height
TABLE = 1.2  # m; side of the table
# m; lowest and highest corner of what may be grasped: a workspace of 30 cm, what leans out of it, and tall things.
BOX = np.array([[-0.25, -0.25, -0.05], [0.25, 0.25, 0.45]])


def cameras_of(sensing: SensingConfig, views: int) -> list[Camera]:
    """`views` cameras around the middle of the table."""
    return surround(replace(sensing, cameras=views), AIM)


def depth_images(
    placed: Sequence[Placed], cameras: Sequence[Camera], sensing: SensingConfig, rng: np.random.Generator
) -> list[View]:
    """The noisy depth image of each camera, table included."""
    half = TABLE / 2
    corners = [[-half, -half, 0.0], [half, -half, 0.0], [half, half, 0.0], [-half, half, 0.0]]
    meshes = [trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)]
    meshes += [each.obj.mesh.copy().apply_transform(each.T_world_object) for each in placed]
    everything: trimesh.Trimesh = trimesh.util.concatenate(meshes)  # type: ignore[assignment]
    views = []
    for number, camera in enumerate(cameras):
        depth = measure(*cast(everything, camera), camera.K[0, 0], sensing, rng)
        views.append(View(depth, camera, name=f"camera {number}"))
    return views


def scene_config(find_table: bool) -> SceneConfig:
    """How images become a scene; everything above the table is one target."""
    table = "find" if find_table else [0.0, 0.0, 1.0, 0.0]
    return settings(SceneConfig, table=table, crop_low=BOX[0].tolist(), crop_high=BOX[1].tolist())


def seen(views: Sequence[View], config: SceneConfig, sensing: SensingConfig, seed: Sequence[int]) -> Scene:
    """The scene that images show. Raises InputError where they show nothing above the table."""
    return scene_of_views(views, config, sensing, np.random.default_rng(list(seed)))
