"""Lofted solids: a horizontal section that grows along a profile, as one closed surface and exact convex parts.

A section is a convex polygon given by its facets' outward angles; facet k lies at the distance
`base[k] + s * growth[k]` from the axis, where s is the first coordinate of a profile point (s, z). A corner then
moves along a straight line as s grows, so that every quad between two rings is flat, and a wall that is cut along
the corners' vertical planes falls into convex pieces: surface and parts are the same polyhedron. A circle, a
rounded rectangle and an oval are three such sections.

Metres; z along the loft. Rings run counter-clockwise seen from above.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial import ConvexHull

SEGMENTS = 20  # around a circle: 1.2 % of the radius between facet and corner; a trial costs by the number of parts
CORNER_STEP = np.deg2rad(30.0)  # facets of a rounded vertical edge

Triangles = np.ndarray  # (T, 3, 3) float64, counter-clockwise seen from outside


@dataclass(frozen=True)
class Solid:
    """A closed surface (T, 3, 3) and the convex pieces, each (V, 3), whose union it encloses."""

    triangles: Triangles
    parts: tuple[np.ndarray, ...]


@dataclass(frozen=True)
class Section:
    """Corners (n, 2) of the section at s = 0 and how they move, (n, 2), per metre of s; facet 0 faces +x."""

    corners: np.ndarray
    growth: np.ndarray

    def ring(self, s: float, z: float) -> np.ndarray:
        """(n, 3) corners of the section at the profile point (s, z)."""
        flat = self.corners + s * self.growth
        return np.column_stack([flat, np.full(len(flat), z)])

    def wedge(self, facet: int, cell: np.ndarray) -> np.ndarray:
        """(2 V, 3) corners of the wall piece behind one facet: the convex cell (V, 2) of profile points."""
        rings = np.stack([self.ring(s, z) for s, z in cell])
        return rings[:, [facet - 1, facet]].reshape(-1, 3)


def round_section() -> Section:
    """A regular polygon: s is the distance of its facets from the axis."""
    return oval_section(1.0)


def oval_section(aspect: float) -> Section:
    """An ellipse's polygon: s is half its width along x, `aspect` its depth over its width."""
    angles = np.arange(SEGMENTS) * 2 * np.pi / SEGMENTS
    return _section(angles, np.zeros(SEGMENTS), np.hypot(np.cos(angles), aspect * np.sin(angles)))


def rectangle_section(width: float, depth: float, corner: float) -> Section:
    """A rectangle with vertical edges of radius `corner`: s is how far it is grown outwards."""
    angles = np.arange(0.0, 2 * np.pi - 1e-9, CORNER_STEP if corner > 0 else np.pi / 2)
    reach = np.array([width / 2 - corner, depth / 2 - corner])
    base = np.abs(np.column_stack([np.cos(angles), np.sin(angles)])) @ reach + corner
    return _section(angles, base, np.ones(len(angles)))


def _section(angles: np.ndarray, base: np.ndarray, growth: np.ndarray) -> Section:
    """Corner k is where the facets k and k + 1 meet: two equations n . p = distance, linear in s."""
    normals = np.column_stack([np.cos(angles), np.sin(angles)])
    pairs = np.stack([normals, np.roll(normals, -1, axis=0)], axis=1)
    distances = np.stack([np.column_stack([b, np.roll(b, -1)]) for b in (base, growth)], axis=-1)
    meet = np.linalg.solve(pairs, distances)
    return Section(meet[..., 0], meet[..., 1])


def loft(section: Section, chain: np.ndarray, skip: frozenset[int] = frozenset()) -> Triangles:
    """The closed surface through the rings of a profile (M, 2), with a flat cap on either end.

    The chain runs up the outside (and down the inside of a vessel). `skip` names the steps of the chain whose
    facet 0 is left out: where a handle starts.
    """
    rings = np.stack([section.ring(s, z) for s, z in chain])
    quads = []
    for step, (low, high) in enumerate(pairwise(rings)):
        sides = np.stack([np.roll(low, 1, axis=0), low, high, np.roll(high, 1, axis=0)], axis=1)
        quads.append(sides[1:] if step in skip else sides)
    return np.concatenate([_fan(rings[0][::-1]), *(_split(quad) for quad in quads), _fan(rings[-1])])


def solid_of(section: Section, chain: np.ndarray) -> Solid:
    """A filled loft: one hull for each stretch of the profile in which it bulges outwards."""
    hulls = (np.concatenate([section.ring(s, z) for s, z in stretch]) for stretch in convex_stretches(chain))
    return Solid(loft(section, chain), tuple(np.unique(np.round(hull, 12), axis=0) for hull in hulls))


def convex_stretches(chain: np.ndarray) -> Iterator[np.ndarray]:
    """The profile (M, 2), z never falling, cut at the points where it turns inwards."""
    first, last = chain[1:-1] - chain[:-2], chain[2:] - chain[1:-1]
    cross = first[:, 0] * last[:, 1] - first[:, 1] * last[:, 0]
    cuts = [0, *(np.flatnonzero(cross < -1e-12) + 1), len(chain) - 1]
    return (chain[start : stop + 1] for start, stop in pairwise(cuts))


def shell_of(section: Section, outer: np.ndarray, wall: float, base: float, handle: Handle | None = None) -> Solid:
    """An open vessel: a floor of height `base` and walls of thickness `wall` inside the profile (M, 2)."""
    inner = inner_profile(outer, wall, base)
    floor = np.concatenate([section.ring(*outer[0]), section.ring(*inner[0])])
    cells = [np.stack([outer[i], outer[i + 1], inner[i + 1], inner[i]]) for i in range(len(outer) - 1)]
    parts = (floor, *(section.wedge(k, cell) for cell in cells for k in range(len(section.corners))))
    if handle is None:
        return Solid(loft(section, np.concatenate([outer, inner[::-1]])), parts)
    cut, steps = handle.cut(outer)
    surface = loft(section, np.concatenate([cut, inner[::-1]]), frozenset(steps))
    bar = handle.solid(cut[steps[0] : steps[-1] + 2], section)
    return Solid(np.concatenate([surface, bar.triangles]), (*parts, *bar.parts))


def inner_profile(outer: np.ndarray, wall: float, base: float) -> np.ndarray:
    """(M, 2): the outer profile moved inwards by `wall`, mitred at its corners, from the floor to the rim."""
    along = np.diff(outer, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    inwards = np.column_stack([-along[:, 1], along[:, 0]])
    start = outer[:-1] + wall * inwards
    bisector = (inwards[:-1] + inwards[1:]) / (1 + np.sum(inwards[:-1] * inwards[1:], axis=1, keepdims=True))
    rim = start[-1] + along[-1] * (outer[-1, 1] - start[-1, 1]) / along[-1, 1]
    floor = start[0] + along[0] * (base - start[0, 1]) / along[0, 1]
    return np.vstack([floor, outer[1:-1] + wall * bisector, rim])


@dataclass(frozen=True)
class Handle:
    """A bar as wide as a vessel's facet 0, growing out of it between the heights `low` and `high`.

    A loop returns to the facet; a stick (`loop` False) ends `reach` away from it. `thickness` is the bar's height
    where it leaves the wall. All of it lies along one straight stretch of the profile, whose facets are one plane:
    the bar's two flat sides then are planes too.
    """

    low: float
    high: float
    reach: float
    thickness: float
    loop: bool

    def cut(self, outer: np.ndarray) -> tuple[np.ndarray, list[int]]:
        """The profile with points where the bar starts and ends, and the steps that it grows from."""
        heights = [self.low, self.low + self.thickness, self.high - self.thickness, self.high]
        heights = heights if self.loop else [self.low, self.high]
        added = np.column_stack([np.interp(heights, outer[:, 1], outer[:, 0]), heights])
        merged = np.vstack([outer, added])
        merged = merged[np.argsort(merged[:, 1], kind="stable")]
        merged = merged[np.append(True, np.diff(merged[:, 1]) > 1e-9)]
        steps = [int(np.argmin(np.abs(merged[:, 1] - height))) for height in heights[::2]]
        return merged, steps

    def solid(self, facet: np.ndarray, section: Section) -> Solid:
        """The bar without its ends in the wall; `facet` (M, 2) is the straight profile from `low` to `high`."""
        (s_low, _), (s_high, _) = facet[0], facet[-1]
        slope = (s_high - s_low) / (self.high - self.low)
        sides = [self._across(line, s_low, slope, section.growth[0]) for line in self._outline(s_low, slope)]
        ends = [] if self.loop else [_split(sides[-1][None])]
        tube = [
            _split(np.stack([a, np.roll(a, -1, axis=0), np.roll(b, -1, axis=0), b], axis=1)) for a, b in pairwise(sides)
        ]
        return Solid(np.concatenate([*tube, *ends]), tuple(np.concatenate(pair) for pair in pairwise(sides)))

    def _outline(self, s_low: float, slope: float) -> list[np.ndarray]:
        """Cuts through the bar in the plane y = 0: (2, 2) of the (x, z) outside (above) and inside (below)."""

        def wall(z: float) -> list[float]:
            return [s_low + slope * (z - self.low), z]

        if not self.loop:
            end = s_low + self.reach
            return [np.array([wall(self.high), wall(self.low)]), np.array([[end, self.high], [end, self.low]])]
        middle, half = (self.low + self.high) / 2, (self.high - self.low) / 2
        axis = wall(middle)[0]
        cuts = [np.array([wall(self.high), wall(self.high - self.thickness)])]
        for angle in np.deg2rad([60.0, 30.0, 0.0, -30.0, -60.0]):
            reach = np.array([self.reach, half])
            direction = np.array([np.cos(angle), np.sin(angle)])
            cuts.append(
                np.array([[axis, middle] + reach * direction, [axis, middle] + (reach - self.thickness) * direction])
            )
        return [*cuts, np.array([wall(self.low), wall(self.low + self.thickness)])]

    def _across(self, line: np.ndarray, s_low: float, slope: float, growth: np.ndarray) -> np.ndarray:
        """(4, 3): a cut of the outline given the wall facet's width at its height."""
        half = (s_low + slope * (line[:, 1] - self.low)) * growth[1]
        (top_x, top_z), (bottom_x, bottom_z) = line
        top, bottom = half
        return np.array(
            [[top_x, top, top_z], [top_x, -top, top_z], [bottom_x, -bottom, bottom_z], [bottom_x, bottom, bottom_z]]
        )


def bent_of(radii: np.ndarray, bend: float, angle: float, sides: int = 12) -> Solid:
    """A bent bar: rings of the given radii, evenly spaced over `angle` (rad) of a circle of radius `bend`.

    Lowest at z = 0. Between two rings of different size the quads are not flat: the surface is that of the hulls of
    neighbouring rings, which meet in the rings' planes.
    """
    angles = np.linspace(-angle / 2, angle / 2, len(radii))
    around = np.arange(sides) * 2 * np.pi / sides
    rings = []
    for radius, angle_at in zip(radii, angles, strict=True):
        reach = bend + radius * np.cos(around)
        rings.append(np.column_stack([reach * np.sin(angle_at), radius * np.sin(around), -reach * np.cos(angle_at)]))
    lowest = min(ring[:, 2].min() for ring in rings)
    parts = [np.concatenate(pair) - [0.0, 0.0, lowest] for pair in pairwise(rings)]
    skins = [_hull_surface(part, sides, i == 0, i == len(parts) - 1) for i, part in enumerate(parts)]
    return Solid(np.concatenate(skins), tuple(parts))


def _hull_surface(points: np.ndarray, sides: int, keep_first: bool, keep_last: bool) -> Triangles:
    """The hull of two rings, without the caps that it shares with its neighbours."""
    hull = ConvexHull(points)
    first = (hull.simplices < sides).all(axis=1)
    last = (hull.simplices >= sides).all(axis=1)
    kept = ~((first & (not keep_first)) | (last & (not keep_last)))
    triangles = points[hull.simplices[kept]]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    inwards = np.sum(normals * hull.equations[kept, :3], axis=1) < 0
    triangles[inwards] = triangles[inwards][:, ::-1]
    return triangles


def _fan(ring: np.ndarray) -> Triangles:
    """A flat convex polygon (n, 3) as n - 2 triangles."""
    return np.stack([np.broadcast_to(ring[0], ring[1:-1].shape), ring[1:-1], ring[2:]], axis=1)


def _split(quads: np.ndarray) -> Triangles:
    """(Q, 4, 3) flat quads as (2 Q, 3, 3) triangles."""
    return np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
