"""Which grasps would start in collision, as far as the sensed points tell.

A sensed point inside the open hand's volume is a sure sign; no such point proves nothing, since views leave holes.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import accumulate

import numpy as np
import torch
import trimesh
from torch import Tensor

from spgf_torch.hands.hand import Hand
from spgf_torch.ops.points_in_volume import points_in_volume


@dataclass(frozen=True)
class HandVolume:
    """The open hand as a union of convex pieces in the TCP frame.

    Attributes:
        planes: of each piece (F, 4) f32; p is inside where planes[:, :3] @ p <= planes[:, 3] for all of them.
        low (3,), high (3,) f32: bounding box of all pieces, m.
        groups: the pieces of each group of fingers that oppose one another, by index; () where that is not known.
        symmetry: turns about the approach that make the same grasp: 2 of two jaws, 1 where there is no other.
    """

    planes: tuple[Tensor, ...]
    low: Tensor
    high: Tensor
    groups: tuple[tuple[int, ...], ...] = ()
    symmetry: int = 2


def hand_volumes(hand: Hand) -> dict[str, HandVolume]:
    """Grasp type -> the volume of the hand in its preshape, in the TCP frame."""
    body_of, volumes = hand.robot.bodies(), {}
    for name, preshape in hand.preshapes.items():
        bodies = [body_of[link] for link in preshape.shape_links]
        groups = [{body_of[link] for link in group} for group in preshape.groups]
        volumes[name] = hand_volume(preshape.shapes, bodies, groups, preshape.symmetry)
    return volumes


def hand_volume(
    shapes: Sequence[trimesh.Trimesh],
    links: Sequence[str] = (),
    groups: Sequence[Collection[str]] = (),
    symmetry: int = 2,
) -> HandVolume:
    """The volume of convex meshes in the TCP frame, m.

    Args:
        links: whose shape each is. groups: the links of each opposing group of fingers; () where they are not known.
        symmetry: turns about the approach that make the same grasp.
    """
    planes = []
    for mesh in shapes:
        offset = (mesh.face_normals * mesh.triangles[:, 0]).sum(axis=1, keepdims=True)
        planes.append(np.unique(np.round(np.hstack([mesh.face_normals, offset]), 9), axis=0))
    bounds = np.stack([mesh.bounds for mesh in shapes])
    return HandVolume(
        tuple(torch.from_numpy(p).float() for p in planes),
        torch.from_numpy(bounds[:, 0].min(axis=0)).float(),
        torch.from_numpy(bounds[:, 1].max(axis=0)).float(),
        tuple(tuple(index for index, link in enumerate(links) if link in group) for group in groups),
        symmetry,
    )


def sensed_collision(points: Tensor, T_object_tcp: Tensor, volume: HandVolume) -> Tensor:
    """Whether any of the points (N, 3) lies inside the open hand at each of the grasps (G, 4, 4) -> (G,) bool."""
    planes, bounds = torch.cat(volume.planes).to(points.device), torch.stack([volume.low, volume.high])
    ends = list(accumulate(len(piece) for piece in volume.planes))
    return points_in_volume(points, T_object_tcp, planes, ends, bounds.to(points.device))
