"""What was looked at, by depth images or by clouds and the places they were seen from; how that is known, in words."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spgf_torch.geometry.principal import principal_axes
from spgf_torch.scene.cloud import Cloud
from spgf_torch.scene.depth import pixel_points
from spgf_torch.scene.outline import straight_borders
from spgf_torch.scene.target_selection import is_target, viewpoints_of
from spgf_torch.scene.views import View
from spgf_torch.sensing.cloud_view import seen_by, view_of_points
from spgf_torch.sensing.unseen import DepthView

NOT_KNOWN = "without unseen space, which depth images tell, or a cloud's viewpoint"
_REMEDY = "viewpoints=[[x,y,z],...]"
_NO_BORDERS = np.zeros((0, 4))


@dataclass(frozen=True)
class Looked:
    """What was looked at.

    Attributes:
        views: depth images, those that clouds make included; None: unseen space is not known.
        planes: (L, 4) through the straight borders of all that was seen, a x + b y + c z + d > 0 beyond, m.
        words: how unseen space is known, or why it is not.
    """

    views: tuple[DepthView, ...] | None
    planes: np.ndarray
    words: str


def looked_by_nobody(why: str) -> Looked:
    """Nothing is known of it."""
    return Looked(None, _NO_BORDERS, f"{NOT_KNOWN}: {why}")


def looked_by_cameras(images: tuple[DepthView, ...]) -> Looked:
    """Of whole depth images around a thing."""
    return Looked(images, _NO_BORDERS, f"unseen space from {counted(len(images), 'depth image')}")


def looked_by_images(views: Sequence[View]) -> Looked:
    """Of depth images; with one alone the outline of what returned is a border as well as the image's."""
    planes = _NO_BORDERS
    if len(views) == 1:
        depth, camera = views[0].depth, views[0].camera
        returned = np.isfinite(depth) & (depth > 0)
        points = pixel_points(np.where(returned, depth, 0.0), camera)[returned]
        planes = straight_borders(points, camera.T_object_camera[:3, 3], camera.T_object_camera[:3, 2])
    images = tuple(DepthView.of(view.depth, view.camera) for view in views)
    return Looked(images, planes, f"unseen space from {counted(len(images), 'depth image')}")


def looked_by_clouds(clouds: Sequence[Cloud], up: np.ndarray | None) -> Looked:
    """Of clouds in one frame, m, each with its viewpoints where they are known.

    Args:
        up: (3,) the direction along which clouds of no viewpoint, or of several, have an outline; None: the one in
            which they extend least.
    """
    points = np.concatenate([cloud.points for cloud in clouds])
    up = principal_axes(points)[-1] if up is None else up
    eyes = viewpoints_of(clouds)
    one = eyes is not None and len(eyes) == 1 and all(cloud.viewpoints is not None for cloud in clouds)
    planes = straight_borders(points, eyes[0] if one and eyes is not None else None, up)
    if (why := _why_not(clouds)) or eyes is None:
        return Looked(None, planes, f"{NOT_KNOWN}: {why}")
    target = np.concatenate([cloud.points[is_target(cloud)] for cloud in clouds])
    apart = all(cloud.viewpoints is not None and len(cloud.viewpoints) == 1 for cloud in clouds)
    views = []
    for eye in eyes:
        own = [c.points for c in clouds if not apart or (c.viewpoints is not None and (c.viewpoints[0] == eye).all())]
        seen = np.concatenate(own)
        views.append(view_of_points(seen, eye, target, planes if one else straight_borders(seen, eye, up)))
    known = tuple(view for view in views if view is not None)
    if len(known) < len(views):
        return Looked(None, planes, f"{NOT_KNOWN}: a viewpoint lies among the points")
    if not seen_by(target, known):
        why = f"many points lie hidden from the {counted(len(known), 'viewpoint')} given; all places ({_REMEDY})?"
        return Looked(None, planes, f"{NOT_KNOWN}: {why}")
    words = f"unseen space from {counted(len(known), 'viewpoint')}, behind the points; where there are none all is seen"
    return Looked(known, planes, words)


def _why_not(clouds: Sequence[Cloud]) -> str:
    """Why clouds tell no unseen space; empty where they may."""
    for cloud in clouds:
        if cloud.viewpoints is None:
            return f"{cloud.name} does not say where it was seen from ({_REMEDY})"
        if cloud.guessed:
            return f"of {cloud.name} the side is known, not the place it was seen from ({_REMEDY})"
    return ""


def counted(count: int, what: str) -> str:
    """`1 viewpoint`, `2 viewpoints`."""
    return f"{count} {what}{'' if count == 1 else 's'}"
