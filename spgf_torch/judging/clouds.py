"""What a judge learns to judge in: an object alone and on a table, seen from one side and from several."""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass, replace

import numpy as np

from spgf_torch.errors import InputError
from spgf_torch.judging.config import JudgeConfig
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.proposing.clearance import Plane, Surroundings
from spgf_torch.proposing.judge_features import Seen
from spgf_torch.sensing.cameras import surround
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.sensing.sense import observe_on_table, observe_views


@dataclass(frozen=True)
class Cloud:
    """One view, or several, of an object.

    Attributes:
        seen: what of it is known. around: the table, where it stands on one.
        views: how many cameras. on_table: whether it stands on one.
    """

    seen: Seen
    around: Surroundings
    views: int
    on_table: bool


def sensed_cloud(obj: GraspObject, sensing: SensingConfig, on_table: bool, rng: np.random.Generator) -> Cloud:
    """An object as the cameras around it see it; on a table it stands at its lowest point."""
    cameras = surround(sensing, obj.mesh.bounds.mean(axis=0))
    around = Surroundings()
    if on_table:
        texlets, views = observe_on_table(obj.mesh, cameras, sensing, rng)
        around = Surroundings(table=Plane.of((0.0, 0.0, 1.0), float(obj.mesh.bounds[0, 2])))
    else:
        texlets, views = observe_views(obj.mesh, cameras, sensing, rng)
    return Cloud(Seen(texlets, views), around, len(cameras), on_table)


def seen_as(obj: GraspObject, sensing: SensingConfig, on_table: bool, seed: int) -> Cloud:
    """The same from the seed and the object's name alone; the texlets of an object alone are those of `sensing.sense`.

    Raises InputError where nothing of it is seen.
    """
    cloud = sensed_cloud(obj, sensing, on_table, np.random.default_rng([seed, zlib.crc32(obj.name.encode())]))
    if not len(cloud.seen.texlets):
        raise InputError(f"{obj.name}: expected at least one texlet, got none; extents {obj.mesh.extents} m")
    return cloud


def training_clouds(obj: GraspObject, config: JudgeConfig) -> list[Cloud]:
    """The clouds of an object that teach, which follow from the seed and its name alone; none is without texlets.

    Azimuth and elevation are drawn for each.
    """
    rng = np.random.default_rng([config.seed, zlib.crc32(f"{obj.name}/clouds".encode())])
    counts = [1] * config.one_view + [config.sensing.cameras] * config.four_views
    clouds = []
    for on_table in (False, True):
        for count in counts:
            azimuth, elevation = math.degrees(rng.uniform(0, 2 * math.pi)), rng.uniform(*_range(config))
            sensing = replace(config.sensing, cameras=count, azimuth_deg=azimuth, elevation_deg=elevation)
            clouds.append(sensed_cloud(obj, sensing, on_table, rng))
    return [cloud for cloud in clouds if len(cloud.seen.texlets) > 0]


def further_clouds(obj: GraspObject, config: JudgeConfig) -> list[Cloud]:
    """`config.looks` clouds of one camera of the object on a table, other than `training_clouds`, by the same rule."""
    rng = np.random.default_rng([config.seed, zlib.crc32(f"{obj.name}/looks".encode())])
    clouds = []
    for _ in range(config.looks):
        azimuth, elevation = math.degrees(rng.uniform(0, 2 * math.pi)), rng.uniform(*_range(config))
        sensing = replace(config.sensing, cameras=1, azimuth_deg=azimuth, elevation_deg=elevation)
        clouds.append(sensed_cloud(obj, sensing, True, rng))
    return [cloud for cloud in clouds if len(cloud.seen.texlets) > 0]


def _range(config: JudgeConfig) -> tuple[float, float]:
    return min(config.lowest_deg, config.highest_deg), max(config.lowest_deg, config.highest_deg)
