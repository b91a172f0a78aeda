"""What a robot does not know, drawn for each trial: how the object stands, mass, friction, where the hand really is.

The random stream of a trial follows from the object, the grasp's pose to the bit, and `draw` alone, so a trial repeats
in any order and process, and can be repeated from its row of a table: candidates follow from seed, object and index.
"""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

if TYPE_CHECKING:
    from spgf_torch.objects.grasp_object import GraspObject
    from spgf_torch.simulation.config import RobotConfig


@dataclass(frozen=True)
class StablePoses:
    """How an object can rest on a table.

    Attributes:
        up: (P, 3) the table's normal in the object's frame.
        height: (P,) m along it, of the table's top in the object's frame.
        share: (P,) probability of each where it is thrown, sum 1.
    """

    up: np.ndarray
    height: np.ndarray
    share: np.ndarray

    @staticmethod
    def upright(obj: GraspObject) -> StablePoses:
        """Its own z axis up, on its lowest point."""
        lowest = min(float(part[:, 2].min()) for part in obj.parts)
        return StablePoses(np.array([[0.0, 0.0, 1.0]]), np.array([lowest]), np.ones(1))

    @staticmethod
    def of(obj: GraspObject) -> StablePoses:
        """Of the hull of its collision pieces, by quasi-static toppling (trimesh: Goldberg et al., IJRR 1999).

        The same for all grasp types: found once for each of the last objects.
        """
        return _toppled(_Key(obj.digest, obj))


@dataclass(frozen=True)
class _Key:
    """`digest` stands for the object."""

    digest: str
    obj: GraspObject = field(compare=False)


@lru_cache(maxsize=8)
def _toppled(key: _Key) -> StablePoses:
    points = np.concatenate(key.obj.parts)
    hull = trimesh.convex.convex_hull(points)
    T_table_object, share = trimesh.poses.compute_stable_poses(hull, key.obj.com, sigma=0, n_samples=1, threshold=0)
    up = np.ascontiguousarray(T_table_object[:, 2, :3])
    return StablePoses(up, (points @ up.T).min(axis=0), share / share.sum())


@dataclass(frozen=True)
class Draw:
    """One trial's.

    Attributes:
        up: (3,) against gravity while the hand comes and closes, in the object's frame; the normal of the table.
        height: m along `up`, the table's top; None where the object floats.
        mass, friction: factors.
        T_object_tcp: (4, 4) where the hand really is.
    """

    up: np.ndarray
    height: float | None
    mass: float
    friction: float
    T_object_tcp: np.ndarray


def drawn(obj: GraspObject, poses: StablePoses, T_object_tcp: np.ndarray, config: RobotConfig, number: int) -> Draw:
    """Draw `number` of the trial at T_object_tcp (4, 4)."""
    pose = np.ascontiguousarray(T_object_tcp, dtype=np.float32)
    rng = np.random.default_rng([number, zlib.crc32(pose.tobytes()), zlib.crc32(obj.digest.encode())])
    floats, which, mass, friction, radius, angle = rng.random(6)
    shift, axis = (vector / np.linalg.norm(vector) for vector in rng.normal(size=(2, 3)))
    index = min(int(np.searchsorted(np.cumsum(poses.share), which, side="right")), len(poses.share) - 1)
    T = pose.astype(np.float64)
    T[:3, 3] += T[:3, :3] @ shift * config.pose_error * math.cbrt(radius)  # uniform in a ball
    T[:3, :3] = T[:3, :3] @ Rotation.from_rotvec(axis * math.radians(config.pose_error_deg) * angle).as_matrix()
    return Draw(
        up=poses.up[index],
        height=None if floats < config.floating else float(poses.height[index]),
        mass=1 + config.mass_spread * (2 * mass - 1),
        friction=1 + config.friction_spread * (2 * friction - 1),
        T_object_tcp=T,
    )
