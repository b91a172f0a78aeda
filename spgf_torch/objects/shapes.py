"""The shapes that a description in `data/objects` can name: dimensions in metres, and the solid that they make.

Each shape is a dataclass of its dimensions with one method, `solid()`; `SHAPES` maps the word in the YAML to it.
`solid()` raises InputError naming the dimension where the numbers do not make a shape.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from omegaconf import MISSING

from spgf_torch.errors import InputError
from spgf_torch.objects.lofts import (
    Handle,
    Section,
    Solid,
    bent_of,
    inner_profile,
    oval_section,
    rectangle_section,
    round_section,
    shell_of,
    solid_of,
)
from spgf_torch.settings import bounded

LARGEST = 1.0  # m; a household object that a hand lifts
LATITUDES = 10  # bands of an ellipsoid, even so that the widest ring is there; 182 corners (PhysX takes 255)


class Shape(Protocol):
    """Dimensions that make a solid."""

    def solid(self) -> Solid: ...


@dataclass
class HandleSize:
    """A handle on the +x side: heights above the base where it starts and ends, how far it reaches, its thickness."""

    low: float = bounded(0.001, LARGEST)
    high: float = bounded(0.001, LARGEST)
    reach: float = bounded(0.001, LARGEST)
    thickness: float = bounded(0.001, 0.1)
    loop: bool = True


@dataclass
class RoundSolid:
    """A filled body: profile of [half width, height] points from the base up; `aspect` = depth over width."""

    profile: list[Any] = field(default=MISSING)
    aspect: float = field(default=1.0, metadata={"range": (0.1, 1.0)})

    def solid(self) -> Solid:
        return solid_of(oval_section(self.aspect), _profile(self.profile))


@dataclass
class RoundShell:
    """An open round vessel: outer profile of [radius, height] points from the base up."""

    profile: list[Any] = field(default=MISSING)
    wall: float = bounded(0.0005, 0.1)
    base: float = bounded(0.0005, 0.1)
    handle: HandleSize | None = None

    def solid(self) -> Solid:
        outer = _profile(self.profile, rising=True)
        handle = None if self.handle is None else _handle(self.handle, outer)
        _check_inside(round_section(), inner_profile(outer, self.wall, self.base), self.wall, self.base)
        return shell_of(round_section(), outer, self.wall, self.base, handle)


@dataclass
class Box:
    """A filled box: size [x, y, z]; `corner` rounds the vertical edges, `edge` bevels the others."""

    size: list[float] = field(default=MISSING)
    corner: float = field(default=0.0, metadata={"range": (0.0, 0.2)})
    edge: float = field(default=0.0, metadata={"range": (0.0, 0.1)})

    def solid(self) -> Solid:
        x, y, z = _size(self.size)
        _below("corner", self.corner, min(x, y) / 2)
        _below("edge", self.edge, min(x, y, z) / 2 if self.corner == 0 else min(self.corner, z / 2))
        chain = np.array([[-self.edge, 0.0], [0.0, self.edge], [0.0, z - self.edge], [-self.edge, z]])
        return solid_of(rectangle_section(x, y, self.corner), chain if self.edge else chain[[0, 2]])


@dataclass
class BoxShell:
    """An open rectangular vessel: outer size [x, y, z] at the rim; each side leans in by `taper` towards the base."""

    size: list[float] = field(default=MISSING)
    wall: float = bounded(0.0005, 0.1)
    base: float = bounded(0.0005, 0.1)
    corner: float = field(default=0.0, metadata={"range": (0.0, 0.2)})
    taper: float = field(default=0.0, metadata={"range": (0.0, 0.2)})

    def solid(self) -> Solid:
        x, y, z = _size(self.size)
        _below("corner", self.corner, min(x, y) / 2)
        inset = self.wall + self.taper
        _below("wall + taper", inset, min(x, y) / 2 if self.corner == 0 else self.corner)
        section = rectangle_section(x, y, self.corner)
        outer = np.array([[-self.taper, 0.0], [0.0, z]])
        _check_inside(section, inner_profile(outer, self.wall, self.base), self.wall, self.base)
        return shell_of(section, outer, self.wall, self.base)


@dataclass
class Ellipsoid:
    """A filled ellipsoid: size [x, y, z] of its three diameters."""

    size: list[float] = field(default=MISSING)

    def solid(self) -> Solid:
        x, y, z = _size(self.size)
        polar = np.linspace(0.0, np.pi, LATITUDES + 1)
        chain = np.column_stack([x / 2 * np.sin(polar), z / 2 * (1 - np.cos(polar))])
        chain[[0, -1], 0] = 0.0
        return solid_of(oval_section(y / x), chain)


@dataclass
class Bent:
    """A bent bar: radii along it, over `angle_deg` of a circle of radius `bend`, hanging down in the middle."""

    radii: list[float] = field(default=MISSING)
    bend: float = bounded(0.005, LARGEST)
    angle_deg: float = bounded(1.0, 180.0)

    def solid(self) -> Solid:
        radii = np.asarray(self.radii, dtype=np.float64)
        if len(radii) < 3 or radii.min() <= 0 or radii.max() >= self.bend:
            raise InputError(
                f"radii: expected 3 or more numbers above 0 and below bend {self.bend:g}, got {self.radii}"
            )
        return bent_of(radii, self.bend, float(np.deg2rad(self.angle_deg)))


SHAPES: dict[str, type[Shape]] = {
    "round_solid": RoundSolid,
    "round_shell": RoundShell,
    "box": Box,
    "box_shell": BoxShell,
    "ellipsoid": Ellipsoid,
    "bent": Bent,
}


def _profile(points: list[Any], rising: bool = False) -> np.ndarray:
    """(M, 2) checked: radii not negative, heights from 0 upwards (strictly, where `rising`)."""
    try:
        chain = np.array(points, dtype=np.float64)
    except (TypeError, ValueError):
        chain = np.empty(0)
    if chain.ndim != 2 or chain.shape[1] != 2 or len(chain) < 2:
        raise InputError(f"profile: expected 2 or more points [radius, height], got {points}")
    if not (np.isfinite(chain).all() and chain[:, 0].min() >= 0 and chain[:, 0].max() <= LARGEST / 2):
        raise InputError(f"profile: expected radii from 0 to {LARGEST / 2:g} m, got {chain[:, 0].tolist()}")
    steps = np.diff(chain[:, 1])
    if chain[0, 1] != 0 or (steps <= 0 if rising else steps < 0).any() or not 0 < chain[-1, 1] <= LARGEST:
        raise InputError(
            f"profile: expected heights that rise from 0 (at most {LARGEST:g} m), got {chain[:, 1].tolist()}"
        )
    return chain


def _size(size: list[float]) -> tuple[float, float, float]:
    if len(size) != 3 or not all(0 < length <= LARGEST for length in size):
        raise InputError(f"size: expected three lengths above 0 and up to {LARGEST:g} m, got {size}")
    return size[0], size[1], size[2]


def _below(key: str, value: float, limit: float) -> None:
    if value >= limit:
        raise InputError(f"{key}: expected less than {limit:g} m, got {value:g}")


def _check_inside(section: Section, inner: np.ndarray, wall: float, base: float) -> None:
    """The cavity must have room: rings that wind as they should, and a profile that rises."""
    floor_first = np.diff(inner[:, 1]) > 0
    widest = inner[:, 0].min() > 0 if not section.corners.any() else True
    if not (floor_first.all() and widest):
        raise InputError(
            f"wall, base: expected a wall and floor thinner than the profile leaves room for, got {wall:g}, {base:g}"
        )


def _handle(size: HandleSize, outer: np.ndarray) -> Handle:
    """The handle, checked: it needs a straight stretch of the wall and, for a loop, room for a finger."""
    breaks = outer[1:-1, 1]
    if not (size.low < size.high <= outer[-1, 1]) or ((breaks > size.low) & (breaks < size.high)).any():
        raise InputError(
            f"handle.low, handle.high: expected a straight stretch of the wall, got {size.low:g}, {size.high:g}"
        )
    if size.loop and (2 * size.thickness >= size.high - size.low or size.thickness >= size.reach):
        raise InputError(f"handle.thickness: expected room inside the loop, got {size.thickness:g}")
    return Handle(size.low, size.high, size.reach, size.thickness, size.loop)
