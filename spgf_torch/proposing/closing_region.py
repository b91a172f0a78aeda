"""Where a hand closes: the free space about the TCP between its opposing fingers, as a box, from its shapes alone.

Jaws, be it two or one against a fixed one, have a face on either side of the TCP on the closing axis: the box lies
between these faces. Of other hands, such as two fingers against a thumb beside the axis or three in a circle, the box
ends where the fingers do at the TCP's height: along closing where there are two groups, else along each group's own
direction, the nearest to either side.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.optimize import linprog
from scipy.spatial import HalfspaceIntersection
from torch import Tensor

from spgf_torch.affordance.sensed_collision import HandVolume
from spgf_torch.errors import InputError
from spgf_torch.hands.hand import PAD

# m behind a pad's face in which its extents are measured: a fingertip's thickness.
_SKIN = 0.005
# m; faces whose distances from the TCP differ by less are as far: the rest is rounding, or an opening's tolerance.
_EVEN = 1e-4
# m into a piece at which it is asked whether the closing axis enters it there.
_JUST = 1e-5


@dataclass(frozen=True)
class ClosingRegion:
    """The box that the fingers sweep, in the TCP frame: |x - middle| < half, |y| < height, low < z < high, m.

    Attributes:
        middle: 0 of hands whose fingers are as far from the TCP on either side.
        pads: whether faces bound it along closing, so that things may lie close to either one.
    """

    half: float
    height: float
    low: float
    high: float
    middle: float = 0.0
    pads: bool = True

    @property
    def length(self) -> float:
        """m along the approach."""
        return self.high - self.low

    def holds(self, x: Tensor, y: Tensor, z: Tensor) -> Tensor:
        """Bool in the shape of the coordinates: inside."""
        return ((x - self.middle).abs() < self.half) & (y.abs() < self.height) & (z > self.low) & (z < self.high)


def closing_region(volume: HandVolume) -> ClosingRegion:
    """The region between the opposing fingers of an open hand; between all its pieces, where groups are not known.

    As high across closing as the narrower group reaches to either side, and as long along the approach as the groups'
    faces, or bodies beside the TCP, have in common. Raises InputError where no piece bounds it.
    """
    pieces = [piece.double().cpu().numpy() for piece in volume.planes]
    groups = [[pieces[index] for index in group] for group in volume.groups]
    if empty := [index for index, group in enumerate(groups) if not group]:
        raise InputError(f"hand: expected collision shapes of each opposing group, got none of group {empty[0] + 1}")
    if len(groups) <= 2:
        on_axis = _reached([piece for group in groups for piece in group] or pieces)
        if len(on_axis) == 2 or (on_axis and not groups):
            return _between_faces(on_axis)
    if not groups:
        raise InputError("hand: expected pads on the closing axis through the TCP, got none")
    return _between_groups(groups)


def _reached(pieces: list[np.ndarray]) -> dict[float, tuple[float, list[np.ndarray]]]:
    """Of each side of the TCP on the closing axis, -1 and 1: m to the nearest piece, and all that reach the axis.

    A piece about the TCP itself bounds both sides where it ends.
    """
    reached: dict[float, list[tuple[float, np.ndarray]]] = {}
    for planes in pieces:
        slope, offset = planes[:, 0], planes[:, 3]
        if (offset[slope == 0] < 0).any():
            continue  # the axis passes beside this piece
        enters = float((offset[slope < 0] / slope[slope < 0]).max())
        leaves = float((offset[slope > 0] / slope[slope > 0]).min())
        if enters > leaves:
            continue
        for side, end in ((-1.0, leaves), (1.0, enters)):
            if side * end > 0:
                reached.setdefault(side, []).append((abs(end), planes))
        if enters <= 0 <= leaves:
            reached.setdefault(-1.0, []).append((-enters, planes))
            reached.setdefault(1.0, []).append((leaves, planes))
    return {side: (min(end for end, _ in its), [planes for _, planes in its]) for side, its in reached.items()}


def _between_faces(on_axis: dict[float, tuple[float, list[np.ndarray]]]) -> ClosingRegion:
    """The box between the faces on the axis; where only one side has any, as far to the other."""
    ends = {side: end for side, (end, _) in on_axis.items()}
    below, above = (ends.get(side, min(ends.values())) for side in (-1.0, 1.0))
    even = abs(above - below) < _EVEN
    half = min(above, below) if even else (above + below) / 2
    faces = []
    for side, (end, pieces) in on_axis.items():
        at = half if even else end
        for planes in pieces:
            slab = np.array([[side, 0, 0, at + _SKIN], [-side, 0, 0, -at]])
            if (planes[:, :3] @ [side * (at + _JUST), 0, 0] <= planes[:, 3]).all():
                faces.append(corners_of(np.concatenate([planes, slab])))
            elif (planes[:, 3] >= 0).all():  # it is about the TCP
                faces.append(corners_of(planes))
    return ClosingRegion(
        half,
        float(min(np.abs(face[:, 1]).max() for face in faces)),
        float(max(face[:, 2].min() for face in faces)),
        float(min(face[:, 2].max() for face in faces)),
        0.0 if even else (above - below) / 2,
    )


def _between_groups(groups: list[list[np.ndarray]]) -> ClosingRegion:
    """The box between groups of fingers beside the TCP, which no faces on the closing axis bound."""
    beside = [_beside(group) for group in groups]
    directions = [_direction(section, len(groups)) for section, _ in beside]
    ends = [float((section @ d).min()) for (section, _), d in zip(beside, directions, strict=True)]
    across = [np.array([-d[1], d[0], 0]) for d in directions]
    middle = (directions[0][0] * ends[0] + directions[1][0] * ends[1]) / 2 if len(groups) == 2 else 0.0
    half = sum(ends) / 2 if len(groups) == 2 else min(ends)
    if half <= 0 or (len(groups) == 2 and directions[0][0] == directions[1][0]):
        raise InputError("hand: expected opposing groups of fingers on different sides of the TCP, with room between")
    low, high = sorted(
        (float(max(body[:, 2].min() for _, body in beside)), float(min(body[:, 2].max() for _, body in beside)))
    )
    return ClosingRegion(
        half,
        min(float(np.abs(section @ t).max()) for (section, _), t in zip(beside, across, strict=True)),
        low,
        high,
        middle if abs(middle) >= _EVEN / 2 else 0.0,
        pads=False,
    )


def _beside(group: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Corners of what of a group is level with the TCP (within `PAD`), or as near as any is; and of those pieces."""
    whole = [corners_of(planes) for planes in group]
    ends = np.concatenate(whole)[:, 2]
    reach = PAD + max(0.0, float(ends.min()), -float(ends.max()))
    slab = np.array([[0, 0, 1, reach], [0, 0, -1, reach]])
    near = [corners for corners in whole if corners[:, 2].min() < reach and corners[:, 2].max() > -reach]
    cut = [np.concatenate([planes, slab]) for planes in group]
    sections = [corners_of(planes) for planes in cut if _inside(planes)[3] > 0]
    return np.concatenate(sections), np.concatenate(near)


def _direction(section: np.ndarray, groups: int) -> np.ndarray:
    """Unit vector (3,) across the approach from the TCP to a group: along closing, where two oppose each other."""
    towards = section.mean(axis=0) * [1, 1, 0]
    if groups == 2:
        return np.array([math.copysign(1.0, towards[0]), 0, 0])
    return towards / max(float(np.linalg.norm(towards)), 1e-12)


def corners_of(planes: np.ndarray) -> np.ndarray:
    """Corners (C, 3) of the polytope planes[:, :3] @ p <= planes[:, 3], unit normals; not to be written to."""
    return _corners(np.asarray(planes, np.float64).tobytes())


def _inside(planes: np.ndarray) -> np.ndarray:
    """The point (3,) farthest inside of a polytope (Chebyshev centre), and how far, m; below 0 of an empty one."""
    return _centre(np.asarray(planes, np.float64).tobytes())


@lru_cache(1024)
def _corners(planes: bytes) -> np.ndarray:
    """`corners_of` the bytes of planes: a hand's pieces are asked for by several, and again by each search."""
    sides = np.frombuffer(planes).reshape(-1, 4)
    halves = np.hstack([sides[:, :3], -sides[:, 3:]])
    corners: np.ndarray = HalfspaceIntersection(halves, _centre(planes)[:3]).intersections
    corners.setflags(write=False)
    return corners


@lru_cache(1024)
def _centre(planes: bytes) -> np.ndarray:
    """`_inside` of the bytes of planes."""
    sides = np.frombuffer(planes).reshape(-1, 4)
    # Maximise r with normal @ p + r <= offset for every plane.
    rows = np.hstack([sides[:, :3], np.ones((len(sides), 1))])
    found: np.ndarray = linprog([0, 0, 0, -1], A_ub=rows, b_ub=sides[:, 3], bounds=[(None, None)] * 4).x
    found.setflags(write=False)
    return found
