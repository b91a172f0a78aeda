"""Objects that stand packed or lie in a pile on a table, at rest: the scenes of clutter.

The protocol is VGN's and GIGA's (the simulation.py of either); its numbers are in conf/arrangement. A scene follows
from the objects, whatever their order, its seed and the settings alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import fcl
import numpy as np
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import Rotation

from spgf_torch.errors import InputError
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.simulation.clutter_config import PACKED, ArrangementConfig
from spgf_torch.simulation.tabletop import Known, Placed, Tabletop, surface

__all__ = ["Placed", "arranged", "fitting", "inside", "rested", "settled", "stands"]

FOOT = 0.001  # m above the lowest point of an object within which a table bears it: less than a scan's noise
ABOVE = 0.001  # m above what is below, from where objects are let go: no penetration to start with
WALL = 0.02  # m, half the thickness of the walls of the box


def arranged(objects: Sequence[GraspObject], count: int, seed: int, config: ArrangementConfig) -> tuple[Placed, ...]:
    """Put up to `count` of the objects on the table, each once while there are others, and let them come to rest.

    Fewer where there is no room (packed), or where some roll away. Raises InputError where no object fits the workspace
    or stands upright (packed), or for a bad `scale`.
    """
    rng = np.random.default_rng([seed, int(config.kind == PACKED)])
    low, high = _scale(config)
    draw = _Draw(fitting(objects, config), rng, low, high)
    return _packed(draw, count, config) if config.kind == PACKED else _piled(draw, count, config)


def fitting(objects: Sequence[GraspObject], config: ArrangementConfig) -> list[GraspObject]:
    """The objects that scenes are drawn from, by name: those that fit the workspace and stand upright (packed).

    Raises InputError where there are none, or for a bad `scale`.
    """
    _scale(config)
    found = [obj for obj in sorted(objects, key=lambda each: each.name) if _fits(obj, config)]
    if not found:
        sort = "that stand upright and fit" if config.kind == PACKED else "that fit"
        raise InputError(f"objects: expected some {sort} a workspace of {config.workspace:g} m, got none")
    return found


def settled(placed: Sequence[Placed], config: ArrangementConfig) -> tuple[Placed, ...]:
    """The same once they are at rest, in their order, without those that left the workspace or fell off the table."""
    return tuple(each for each in rested(placed, config) if inside(each, config))


def rested(placed: Sequence[Placed], config: ArrangementConfig) -> list[Placed]:
    """The same once they are at rest, wherever that is."""
    if not placed:
        return []
    tabletop = Tabletop(placed, config)
    _rest(tabletop, config, config.rest_time)
    return [Placed(each.obj, T) for each, T in zip(placed, tabletop.poses(), strict=True)]


def inside(placed: Placed, config: ArrangementConfig) -> bool:
    """Whether an object's centre of mass is still above the workspace, or not far out of it."""
    centre = placed.centre
    return bool(np.all(np.abs(centre[:2]) <= config.lost) and centre[2] > -FOOT)


def stands(obj: GraspObject, stance: float) -> bool:
    """Whether an object stands upright by itself: its centre of mass is `stance` m within its footprint."""
    points = np.concatenate(obj.parts)
    foot = points[points[:, 2] < points[:, 2].min() + FOOT, :2]
    try:
        lines = ConvexHull(foot).equations
    except (QhullError, ValueError):  # on a point or an edge
        return False
    return bool((lines[:, :2] @ obj.com[:2] + lines[:, 2]).max() <= -stance)


class _Draw:
    """Draws objects, each once while there are others, and their sizes."""

    def __init__(self, objects: Sequence[GraspObject], rng: np.random.Generator, low: float, high: float) -> None:
        self.objects, self.rng, self.low, self.high = objects, rng, low, high
        self.taken: set[str] = set()

    def next(self) -> GraspObject:
        rest = [obj for obj in self.objects if obj.name not in self.taken] or self.objects
        obj = rest[int(self.rng.integers(len(rest)))]
        return scaled(obj, self.rng.uniform(self.low, self.high))

    def keep(self, obj: GraspObject) -> None:
        """It is in the scene."""
        self.taken.add(obj.name)
        if len(self.taken) == len(self.objects):
            self.taken.clear()


def scaled(obj: GraspObject, scale: float) -> GraspObject:
    """An object of another size and the same density."""
    if scale == 1.0:
        return obj
    mesh = obj.mesh.copy().apply_scale(scale)
    parts = tuple(part * scale for part in obj.parts)
    mass, inertia = obj.mass * scale**3, obj.inertia * scale**5
    return replace(obj, mesh=mesh, parts=parts, mass=mass, com=obj.com * scale, inertia=inertia)


def _packed(draw: _Draw, count: int, config: ArrangementConfig) -> tuple[Placed, ...]:
    """Upright at random places, turned about z; places that touch another object are refused."""
    placed: list[Placed] = []
    solids: list[_Solid] = []
    for _ in range(config.tries):
        if len(placed) == count:
            break
        obj, rng = draw.next(), draw.rng
        T = np.eye(4)
        T[:3, :3] = Rotation.from_euler("z", rng.uniform(0, 2 * np.pi)).as_matrix()
        T[:2, 3] = rng.uniform(-config.middle / 2, config.middle / 2, 2) - (T[:3, :3] @ obj.com)[:2]
        T[2, 3] = ABOVE - min(float(part[:, 2].min()) for part in obj.parts)
        solid = _Solid(Placed(obj, T))
        if not any(solid.near(other, config.gap) for other in solids):
            placed.append(solid.placed)
            solids.append(solid)
            draw.keep(obj)
    return settled(placed, config)


def _piled(draw: _Draw, count: int, config: ArrangementConfig) -> tuple[Placed, ...]:
    """Dropped one after the other into a box, in any orientation, each from above what lies there."""
    falling: list[Placed] = []
    for _ in range(count):
        obj, rng = draw.next(), draw.rng
        T = np.eye(4)
        T[:3, :3] = Rotation.random(random_state=rng).as_matrix()
        low = float((np.concatenate(obj.parts) @ T[2, :3]).min())
        top = max((float(each.points[:, 2].max()) for each in falling), default=0.0)
        T[:3, 3] = np.append(rng.uniform(-config.drop_spread / 2, config.drop_spread / 2, 2), 0.0) - T[:3, :3] @ obj.com
        T[2, 3] = max(config.drop + T[2, 3], top + ABOVE - low, ABOVE - low)
        draw.keep(obj)
        falling = _fallen([*falling, Placed(obj, T)], config)
    return settled(falling, config)


def _fallen(placed: Sequence[Placed], config: ArrangementConfig) -> list[Placed]:
    """Where the objects are after a while in the box."""
    tabletop = Tabletop(placed, config)
    side, half = config.workspace / 2, config.wall / 2
    for axis in (0, 1):
        for sign in (-1, 1):
            size, centre = np.array([side + 2 * WALL, side + 2 * WALL, half]), np.array([0.0, 0.0, half])
            size[axis], centre[axis] = WALL, sign * (side + WALL)
            tabletop.add_box(size, centre)
    _rest(tabletop, config, config.drop_time)
    return [Placed(each.obj, T) for each, T in zip(placed, tabletop.poses(), strict=True)]


def _rest(tabletop: Tabletop, config: ArrangementConfig, time: float) -> None:
    """Let objects come to rest, for so many seconds at most."""
    for body in tabletop.bodies:
        body.linear_damping, body.angular_damping = config.linear_damping, config.angular_damping
    for _ in range(round(time / config.rest_window)):
        tabletop.step(config.rest_window)
        speeds = [(np.linalg.norm(b.linear_velocity), np.linalg.norm(b.angular_velocity)) for b in tabletop.bodies]
        if all(speed < config.rest_speed and spin < config.rest_spin for speed, spin in speeds):
            return


def _fits(obj: GraspObject, config: ArrangementConfig) -> bool:
    """Whether an object fits the box of a pile however it turns, or stands upright within a packed workspace.

    Of every size that may be drawn: the largest must have room, and the smallest has the smallest footprint.
    """
    low, high = config.scale
    if config.kind == PACKED:
        room = max(obj.mesh.extents[:2]) * high <= config.workspace
        return bool(room) and all(stands(scaled(obj, scale), config.stance) for scale in {low, high})
    return bool(np.linalg.norm(obj.mesh.extents) * high <= config.workspace)


def _scale(config: ArrangementConfig) -> tuple[float, float]:
    scale = config.scale
    if len(scale) != 2 or not 0 < scale[0] <= scale[1] <= 10:
        raise InputError(f"arrangement.scale: expected two numbers above 0, the smaller first; got {scale}")
    return scale[0], scale[1]


class _Solid:
    """The surface of an object where it is, for distances."""

    def __init__(self, placed: Placed) -> None:
        self.placed, points, T = placed, placed.points, placed.T_world_object
        self.low, self.high = points.min(axis=0), points.max(axis=0)
        where = fcl.Transform(np.ascontiguousarray(T[:3, :3]), np.ascontiguousarray(T[:3, 3]))
        self.surface = fcl.CollisionObject(surface(Known.of(placed.obj)), where)

    def near(self, other: _Solid, gap: float) -> bool:
        """Whether the two are at most `gap` m apart, or cut each other."""
        if np.any(np.maximum(self.low - other.high, other.low - self.high) > gap):
            return False
        pair = self.surface, other.surface
        if fcl.collide(*pair, fcl.CollisionRequest(num_max_contacts=1), fcl.CollisionResult()):
            return True
        return gap > 0 and float(fcl.distance(*pair, fcl.DistanceRequest(), fcl.DistanceResult())) <= gap
