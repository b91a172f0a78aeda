"""What the open hand would touch: sensed points, and a table; and whether there is anything to close on."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import torch
from scipy.spatial import ConvexHull
from torch import Tensor

from spgf_torch.affordance.sensed_collision import HandVolume, sensed_collision
from spgf_torch.errors import InputError
from spgf_torch.geometry import se3
from spgf_torch.proposing.borders import Borders
from spgf_torch.proposing.closing_region import ClosingRegion, closing_region, corners_of
from spgf_torch.proposing.config import ProposingConfig


@dataclass(frozen=True)
class Plane:
    """A table: nothing of the hand may be where normal @ p < offset.

    Attributes:
        normal (3,) f32: unit, to the free side, in the frame of the texlets.
        offset: m.
    """

    normal: Tensor
    offset: float

    @staticmethod
    def of(normal: Tensor | tuple[float, float, float], offset: float) -> Plane:
        """Raises InputError for a normal that is not a unit vector."""
        vector = torch.as_tensor(normal, dtype=torch.float32)
        if vector.shape != (3,) or not abs(float(vector.norm()) - 1) < 1e-3:
            raise InputError(f"plane: expected a unit normal of three numbers, got {vector.tolist()}")
        return Plane(vector, float(offset))


@dataclass(frozen=True)
class Surroundings:
    """What a hand must not touch beside the texlets, in their frame.

    Attributes:
        obstacles: (M, 3) f32, sensed points of other things, m.
        table: no hand reaches below it, neither at the grasp nor on its way; None: none is known.
        up: (3,) f32 unit, against gravity, and the component of an approach along it from which on the hand comes from
            below, which is left to where nothing else is possible; None: hands may come from anywhere.
        retreat: m back along the approach, where the way to the grasp begins.
        borders: where what was looked at ends, but the thing does not; None: nowhere.
        hidden: (K, 3) f32, places that no camera saw free and where something may be, m.
        failed: (A, 3) f32, places where grasps failed before, m: no TCP comes within `failed_radius` (m) of one.
    """

    obstacles: Tensor = field(default_factory=lambda: torch.zeros(0, 3))
    table: Plane | None = None
    up: tuple[Tensor, float] | None = None
    retreat: float = 0.0
    borders: Borders | None = None
    hidden: Tensor = field(default_factory=lambda: torch.zeros(0, 3))
    failed: Tensor = field(default_factory=lambda: torch.zeros(0, 3))
    failed_radius: float = 0.0

    def near(self, points: Tensor, reach: float) -> Surroundings:
        """The same with only the obstacles within `reach` (m) of the box around the points (N, 3)."""
        if not len(self.obstacles) or not len(points):
            return self
        obstacles = self.obstacles.to(points)
        low, high = points.amin(0) - reach, points.amax(0) + reach
        return replace(self, obstacles=obstacles[((obstacles >= low) & (obstacles <= high)).all(1)])

    def sparse(self, cell: float) -> Tensor:
        """(M', 3) one obstacle a cell of this side, m: enough to discard most of what collides."""
        if not len(self.obstacles):
            return self.obstacles
        cells = (self.obstacles / cell).floor().long()
        _, home = torch.unique(cells, dim=0, return_inverse=True)
        first = torch.full((int(home.max()) + 1,), len(home), dtype=torch.int64, device=home.device)
        first.scatter_reduce_(0, home, torch.arange(len(home), device=home.device), "amin")
        return self.obstacles[first]

    def from_below(self, T_object_tcp: Tensor) -> Tensor:
        """(G,) bool: the hand comes from below at the grasps (G, 4, 4)."""
        if self.up is None:
            return torch.zeros(len(T_object_tcp), dtype=torch.bool, device=T_object_tcp.device)
        direction, steepest = self.up
        return T_object_tcp[:, :3, 2] @ direction.to(T_object_tcp) > steepest

    def relaxed(self) -> Iterator[Surroundings]:
        """The same; then, for where nothing is left, without failed places; then with ways from below."""
        around = self
        yield around
        if len(around.failed):
            yield (around := replace(around, failed=around.failed[:0]))
        if around.up is not None:
            yield replace(around, up=None)

    def failed_at(self, places: Tensor) -> Tensor:
        """(G,) bool: grasps failed near the places (G, 3) before."""
        return (torch.cdist(places.float(), self.failed.to(places.device).float()) < self.failed_radius).any(1)


@dataclass(frozen=True)
class Clearance:
    """The open hand of each grasp type, how far it stays from things, and where it looks for something to close on.

    Attributes:
        volumes: grasp type -> volume of the open hand in the TCP frame.
        plane_clearance: m, from a table. obstacle_clearance: m, from obstacles.
        between: m about the TCP, across closing and approach, as far as a point counts as between the fingers at least;
            across closing, fingers that are broader count as far as they reach. Those of the SDH-2's pinches (12 mm to
            either side) and of the Panda (9 mm) are not, so for both hands it is the number of conf/proposing.
        way: m back along the approach that the hand comes from: all that it sweeps counts as the hand.
        unseen_on_way: whether that goes for unseen space as well.
    """

    volumes: Mapping[str, HandVolume]
    plane_clearance: float
    between: float
    obstacle_clearance: float = 0.0
    way: float = 0.0
    unseen_on_way: bool = False

    @staticmethod
    def of(volumes: Mapping[str, HandVolume], config: ProposingConfig) -> Clearance:
        """As the settings say."""
        clearance = Clearance(volumes, config.plane_clearance, config.between, config.obstacle_clearance)
        if config.neighbours is None:
            return clearance
        return replace(clearance, way=config.neighbours.way, unseen_on_way=config.neighbours.unseen_on_way)

    @cached_property
    def grasp_types(self) -> tuple[str, ...]:
        """Names of the grasp types, sorted: the codes of types count in this order, whatever that of the volumes."""
        return tuple(sorted(self.volumes))

    @cached_property
    def regions(self) -> tuple[ClosingRegion, ...]:
        """What the fingers of each grasp type sweep."""
        return tuple(closing_region(self.volumes[name]) for name in self.grasp_types)

    def symmetry(self, grasp_type: Tensor) -> Tensor:
        """(G,) int64: turns about the approach that make the same grasp, of grasps of types (G,)."""
        turns = [self.volumes[name].symmetry for name in self.grasp_types]
        return torch.tensor(turns, device=grasp_type.device)[grasp_type]

    @cached_property
    def reach(self) -> float:
        """m from the TCP to the farthest point of an open hand, at the grasp or on its way."""
        back = torch.tensor([0.0, 0.0, self.way])
        ends = [torch.stack([corners, corners - back]) for corners in self.corners.values()]
        return max(float(corners.norm(dim=2).max()) for corners in ends)

    @cached_property
    def swept(self) -> Mapping[str, HandVolume]:
        """Grasp type -> what the open hand takes up on its way to the grasp."""
        if not self.way:
            return self.volumes
        return {grasp_type: _swept(volume, self.way) for grasp_type, volume in self.volumes.items()}

    @cached_property
    def swollen(self) -> dict[str, HandVolume]:
        """The same, each piece larger by the clearance from obstacles on every side."""
        return {grasp_type: _swollen(volume, self.obstacle_clearance) for grasp_type, volume in self.swept.items()}

    @property
    def seen(self) -> Mapping[str, HandVolume]:
        """Grasp type -> what of the open hand must be in space that was seen free."""
        return self.swept if self.unseen_on_way else self.volumes

    @cached_property
    def corners(self) -> dict[str, Tensor]:
        """Grasp type -> corners (C, 3) f32 of the open hand's convex hull, in the TCP frame."""
        return {grasp_type: hull_corners(volume) for grasp_type, volume in self.volumes.items()}

    @cached_property
    def gaps(self) -> dict[str, HandVolume]:
        """Grasp type -> the space about the TCP between the fingers, as a box in the TCP frame."""
        return {name: _box(region, self.between) for name, region in zip(self.grasp_types, self.regions, strict=True)}

    def closes_on_points(self, points: Tensor, T_object_tcp: Tensor, grasp_type: Tensor) -> Tensor:
        """(G,) bool: a point (N, 3) lies between the fingers at the grasps (G, 4, 4) of types (G,).

        Without any points nothing is known of what there is, and all may.
        """
        closes = torch.ones(len(grasp_type), dtype=torch.bool, device=grasp_type.device)
        if not len(points):
            return closes
        for code, name in enumerate(self.grasp_types):
            of_type = grasp_type == code
            closes[of_type] = sensed_collision(points.float(), T_object_tcp[of_type].float(), self.gaps[name])
        return closes

    def free_of_points(self, points: Tensor, T_object_tcp: Tensor, grasp_type: Tensor) -> Tensor:
        """(G,) bool: no point (N, 3) lies inside the open hand at the grasps (G, 4, 4) of types (G,), or on its way."""
        return self._free(points, T_object_tcp, grasp_type, self.swept)

    def free_of_obstacles(self, obstacles: Tensor, T_object_tcp: Tensor, grasp_type: Tensor) -> Tensor:
        """The same with the clearance from obstacles (M, 3)."""
        return self._free(obstacles, T_object_tcp, grasp_type, self.swollen)

    def free_of_hidden(self, hidden: Tensor, T_object_tcp: Tensor, grasp_type: Tensor) -> Tensor:
        """The same of places (K, 3) that no camera saw free."""
        return self._free(hidden, T_object_tcp, grasp_type, self.seen)

    def _free(
        self, points: Tensor, T_object_tcp: Tensor, grasp_type: Tensor, volumes: Mapping[str, HandVolume]
    ) -> Tensor:
        free = torch.ones(len(grasp_type), dtype=torch.bool, device=grasp_type.device)
        if not len(points):
            return free
        for code, name in enumerate(self.grasp_types):
            of_type = grasp_type == code
            free[of_type] = ~sensed_collision(points.float(), T_object_tcp[of_type].float(), volumes[name])
        return free

    def free_of_plane(self, plane: Plane, T_object_tcp: Tensor, grasp_type: Tensor, retreat: float = 0.0) -> Tensor:
        """(G,) bool: the whole open hand at the grasps (G, 4, 4) of types (G,) is above the plane, with clearance.

        So it is on the straight way from `retreat` (m) back along the approach.
        """
        free = torch.ones(len(grasp_type), dtype=torch.bool, device=grasp_type.device)
        for code, name in enumerate(self.grasp_types):
            of_type = grasp_type == code
            normal = plane.normal.to(T_object_tcp)
            corners = self.corners[name].to(T_object_tcp)
            lowest = (normal @ se3.rotation_of(T_object_tcp[of_type]) @ corners.T).amin(1)  # below the TCP, m
            rise = (T_object_tcp[of_type, :3, 2] @ normal).clamp(min=0.0)  # of the way to the grasp
            height = se3.position_of(T_object_tcp[of_type]) @ normal - plane.offset - retreat * rise
            free[of_type] = height + lowest >= self.plane_clearance
        return free

    def least_height(self, plane: Plane, T_object_tcp: Tensor, grasp_type: str, retreat: float = 0.0) -> Tensor:
        """(G,) m along the plane's normal at which a TCP is just high enough, of hands turned as T (G, 4, 4).

        As in `free_of_plane`, for hands that stand at many places.
        """
        normal, corners = plane.normal.to(T_object_tcp), self.corners[grasp_type].to(T_object_tcp)
        lowest = (normal @ se3.rotation_of(T_object_tcp) @ corners.T).amin(1)
        rise = (T_object_tcp[:, :3, 2] @ normal).clamp(min=0.0)
        return self.plane_clearance + plane.offset + retreat * rise - lowest


def _swollen(volume: HandVolume, by: float) -> HandVolume:
    """Every piece with its faces moved outwards, m."""
    planes = tuple(torch.cat([piece[:, :3], piece[:, 3:] + by], dim=1) for piece in volume.planes)
    return HandVolume(planes, volume.low - by, volume.high + by)


def _swept(volume: HandVolume, way: float) -> HandVolume:
    """All that each piece passes on the last `way` m of its approach, which is convex as the piece is."""
    pieces = []
    for planes in volume.planes:
        there = corners_of(planes.double().cpu().numpy())
        sides = ConvexHull(np.concatenate([there, there - [0.0, 0.0, way]])).equations
        sides[:, 3] *= -1
        pieces.append(torch.from_numpy(np.unique(np.round(sides, 9), axis=0)).float())
    low = torch.minimum(volume.low, volume.low - torch.tensor([0.0, 0.0, way]))
    return replace(volume, planes=tuple(pieces), low=low)


def _box(region: ClosingRegion, least: float) -> HandVolume:
    """What lies between the fingers `least` (m) about the TCP, or as far across as they are broad."""
    half = torch.tensor([region.half, max(least, region.height), least])
    middle = torch.tensor([region.middle, 0.0, 0.0])
    planes = torch.cat([torch.eye(3), -torch.eye(3)])
    offsets = half.repeat(2) + torch.cat([middle, -middle])
    return HandVolume((torch.cat([planes, offsets[:, None]], dim=1),), middle - half, middle + half)


def hull_corners(volume: HandVolume) -> Tensor:
    """Corners (C, 3) f32 of the convex hull of all pieces of a hand, in the TCP frame."""
    corners = np.concatenate([corners_of(planes.double().cpu().numpy()) for planes in volume.planes])
    return torch.from_numpy(corners[ConvexHull(corners).vertices]).float()
