"""A cloud with grasps as shapes in space, ready to be drawn: patches, outlines of hands, a place to look from.

The targets are patches in their surface; obstacles are patches that face the eye, and the table is tiles, each in a
colour of its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from matplotlib.colors import to_rgb
from scipy.spatial import cKDTree

from spgf_torch.drawing.judge_words import WeighedNumber
from spgf_torch.drawing.outline import outline
from spgf_torch.drawing.style import MESH, OBSTACLE, TABLE, camera, success_colours
from spgf_torch.errors import InputError
from spgf_torch.hands.records import Grasp, Gripper, gripper_for
from spgf_torch.scene.sensed import Sensed

PATCHES = 8000  # points that are drawn at most: what a browser turns smoothly and a page of some MB holds
CORNERS = 6  # of a patch
NEIGHBOURS, PATCH = 6, 0.75  # radius of a patch as a share of the distance to the sixth neighbour: they overlap
FINGER, HANDLE = 0.045, 0.03  # m; what is drawn of a hand behind its TCP: fingers, then the axis of approach
ELEVATION = 32.0  # deg above the horizon that a scene is looked at from
AZIMUTHS = (-60.0, 30.0, 120.0, 210.0)  # deg; the first that shows most is taken
AS_GOOD = 0.9  # of the most that any place shows
DARKEST = 0.45  # brightness of a patch that faces away from the lamp
OBSTACLES = 6000  # points of obstacles that are drawn at most
DOT = 0.0022  # m; radius of an obstacle's patch: obstacles are means of voxels of 2 mm
NEAR = 0.08  # m about the targets within which obstacles and table are drawn
TILE, TILES = 0.02, 60  # m of a table's tile, and tiles along a side at most


@dataclass(frozen=True)
class Eye:
    """Where a scene is looked at from: unit vectors in the input's frame; `towards` is from the cloud to the eye."""

    towards: np.ndarray
    up: np.ndarray

    @property
    def axes(self) -> np.ndarray:
        """(3, 3): rows are the picture's right, up, and the direction towards the eye."""
        right = np.cross(self.up, self.towards)
        right /= np.linalg.norm(right)
        return np.stack([right, np.cross(self.towards, right), self.towards])


@dataclass(frozen=True)
class Told:
    """What a page says in words beside its grasps.

    Attributes:
        head: name and value of what is said of the page as a whole: file, hand, model.
        lines: of plain text, on how the grasps came about. doubts: why there is none, or none that is sure.
        notes: on the input.
    """

    head: tuple[tuple[str, str], ...] = ()
    lines: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Beside:
    """What is drawn and written beside targets and grasps.

    Attributes:
        obstacles: (K, 3) m, what else was sensed. table: (4,) a, b, c, d, a x + b y + c z + d the height above it, m.
        sensed: all that was sensed, with its colours, in the place of the targets' points and the obstacles; None: they
            are all that is known.
        cameras: of each its place (3,), m; its axes (3, 3), columns right, down and ahead; and two corners (2, 2) of
            its image 1 m ahead, left top and right bottom, m. None for the last two: not known.
        told: what is said in words.
        weighed: of each grasp what a judge weighed; () where none ranked.
        pictures: SVG of prototypes, by number.
        closing: grasp type -> (F, shapes, 4, 4) of `hands.hand.closing_poses` at `page_hands.fractions`; of types that
            are not in it hands are shown open alone.
    """

    obstacles: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    table: np.ndarray | None = None
    sensed: Sensed | None = None
    cameras: tuple[tuple[np.ndarray, np.ndarray | None, np.ndarray | None], ...] = ()
    told: Told = field(default_factory=Told)
    weighed: tuple[tuple[WeighedNumber, ...], ...] = ()
    pictures: Mapping[int, str] = field(default_factory=dict)
    closing: Mapping[str, np.ndarray] = field(default_factory=dict)


@dataclass(frozen=True)
class Scene:
    """A cloud with grasps, in the input's frame, m.

    Attributes:
        patches: (P, CORNERS, 3) polygons in the surface. colours: (P, 3), lit.
        outlines: (S, 2, 3) line segments of each grasp's open hand. probability: (G,). grasps: (G,), best first.
        eye: where to look from.
    """

    patches: np.ndarray
    colours: np.ndarray
    outlines: list[np.ndarray]
    probability: np.ndarray
    grasps: list[Grasp]
    eye: Eye

    @property
    def grasp_colours(self) -> np.ndarray:
        """(G, 3) red (probability 0) to green (1)."""
        return success_colours(self.probability)


def scene_of(
    points: np.ndarray,
    normals: np.ndarray,
    grasps: Sequence[Grasp],
    grippers: Mapping[str, Gripper],
    beside: Beside | None = None,
) -> Scene:
    """What there is to draw.

    Args:
        points, normals: (M, 3), m and unit, input's frame, normals on the side that was seen. Of more than `PATCHES`
            points so many are drawn, chosen at random.
        grasps: best first. grippers: `records.grippers_of` the hand.
        beside: obstacles and table, in the same frame.

    Raises:
        InputError: no points, or points and normals of different shapes.
    """
    points, normals = np.asarray(points, dtype=np.float64), np.asarray(normals, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or not len(points) or points.shape != normals.shape:
        raise InputError(f"scene: expected points and normals (M, 3), M > 0; got {points.shape} and {normals.shape}")
    beside = beside or Beside()
    eye = look(normals, None if beside.table is None else beside.table[:3] / np.linalg.norm(beside.table[:3]))
    shown = np.random.default_rng(0).permutation(len(points))[:PATCHES]
    points, normals = points[shown], normals[shown]
    drawn = [(_patches(points, normals), _lit(normals, eye)), *_surroundings(points, beside, eye)]
    patches, colours = (np.concatenate(parts) for parts in zip(*drawn, strict=True))
    outlines = {gripper.type: outline(gripper, FINGER, HANDLE) for gripper in grippers.values()}
    return Scene(
        patches=patches,
        colours=colours,
        outlines=[_placed(outlines[gripper_for(grasp, grippers).type], grasp.T_input_tcp) for grasp in grasps],
        probability=np.array([grasp.probability for grasp in grasps]),
        grasps=list(grasps),
        eye=eye,
    )


def look(normals: np.ndarray, up: np.ndarray | None = None) -> Eye:
    """The place that the surface faces: obliquely above if the input's z is up, else in front of a camera's frame.

    Surfaces were seen from where their normals point. A scene in a camera's own frame (z forwards, y down) faces -z.

    Args:
        up: (3,), unit: what a table says; None: to be found.
    """
    level = np.eye(3) if up is None else _upright(up)
    eyes = [Eye(level.T @ camera((azimuth, ELEVATION))[2], level[2]) for azimuth in AZIMUTHS]
    if up is None:
        eyes.append(Eye(np.array([0.0, 0.0, -1.0]), np.array([0.0, -1.0, 0.0])))
    shown = np.array([np.clip(normals @ eye.towards, 0, None).sum() for eye in eyes])
    return eyes[int(np.argmax(shown >= AS_GOOD * shown.max()))]


def _upright(up: np.ndarray) -> np.ndarray:
    """(3, 3): rows are the axes x, y, z turned the shortest way so that z is `up` (3,), unit."""
    if up[2] < -1 + 1e-9:
        return np.diag([1.0, -1.0, -1.0])
    x, y = -up[1], up[0]  # the axis of the turn: z x up
    skew = np.array([[0.0, 0.0, y], [0.0, 0.0, -x], [-y, x, 0.0]])
    turn: np.ndarray = np.eye(3) + skew + skew @ skew / (1 + up[2])
    return turn.T


def pieces(segments: np.ndarray, longest: float) -> list[np.ndarray]:
    """Each segment (S, 2, 3) as points (n, 3) along it, none farther than `longest` from the next."""
    counts = np.ceil(np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1) / longest).astype(int)
    return [np.linspace(a, b, max(count, 1) + 1) for (a, b), count in zip(segments, counts, strict=True)]


def _placed(points: np.ndarray, T: np.ndarray) -> np.ndarray:
    return points @ T[:3, :3].T + T[:3, 3]


def _surroundings(points: np.ndarray, beside: Beside, eye: Eye) -> list[tuple[np.ndarray, np.ndarray]]:
    """Patches (P, CORNERS, 3) and colours (P, 3) of obstacles and of the table near the points (M, 3) of targets."""
    drawn = []
    low, high = points.min(axis=0) - NEAR, points.max(axis=0) + NEAR
    near = beside.obstacles[((beside.obstacles >= low) & (beside.obstacles <= high)).all(axis=1)]
    if len(near):
        near = near[np.random.default_rng(0).permutation(len(near))[:OBSTACLES]]
        facing = np.broadcast_to(eye.towards, near.shape)
        drawn.append((_hexagons(near, facing, DOT), np.tile(to_rgb(OBSTACLE), (len(near), 1))))
    if beside.table is not None:
        drawn.append(_tiles(points, beside.table))
    return drawn


def _tiles(points: np.ndarray, table: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The table under points (M, 3) and `NEAR` around them as squares (P, CORNERS, 3) of two colours (P, 3) in turn."""
    normal = table[:3] / np.linalg.norm(table[:3])
    u, v = across(normal[None])
    u, v = u[0], v[0]
    foot = points - (points @ table[:3] + table[3])[:, None] * table[:3]
    flat = np.stack([foot @ u, foot @ v], axis=1)
    low, high = flat.min(axis=0) - NEAR, flat.max(axis=0) + NEAR
    size = max(TILE, float((high - low).max()) / TILES)
    count = np.ceil((high - low) / size).astype(int)
    i, j = (grid.ravel() for grid in np.meshgrid(*map(np.arange, count), indexing="ij"))
    corners = np.array([[0, 0], [1, 0], [1, 1], [1, 1], [0, 1], [0, 1]])  # six of a square: two twice
    at = low + size * (np.stack([i, j], axis=1)[:, None] + corners)
    origin = foot[0] - flat[0, 0] * u - flat[0, 1] * v
    shades = np.array([to_rgb(colour) for colour in TABLE])
    return origin + at[..., :1] * u + at[..., 1:] * v, shades[(i + j) % 2]


def _patches(points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    nearest = cKDTree(points).query(points, k=min(NEIGHBOURS + 1, len(points)))[0].reshape(len(points), -1)
    radius = PATCH * float(np.median(nearest[:, -1])) or FINGER / 10  # a single point has no neighbour
    return _hexagons(points, normals, radius)


def across(normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two directions (N, 3) across normals (N, 3)."""
    helper = np.where(np.abs(normals[:, :1]) < 0.8, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    u = np.cross(normals, helper)
    u /= np.linalg.norm(u, axis=1, keepdims=True).clip(1e-12)
    return u, np.cross(normals, u)


def _hexagons(points: np.ndarray, normals: np.ndarray, radius: float) -> np.ndarray:
    """(N, CORNERS, 3) about points (N, 3), across normals (N, 3), of a radius in m."""
    u, v = across(normals)
    angle = np.arange(CORNERS) * 2 * np.pi / CORNERS
    around = u[:, None] * np.cos(angle)[:, None] + v[:, None] * np.sin(angle)[:, None]
    return points[:, None] + radius * around


def _lit(normals: np.ndarray, eye: Eye) -> np.ndarray:
    """(P, 3) colours: the lamp stands above the eye's left shoulder."""
    right, up, towards = eye.axes
    lamp = towards + 0.9 * up - 0.6 * right
    shade = DARKEST + (1 - DARKEST) * (0.5 + 0.5 * normals @ (lamp / np.linalg.norm(lamp)))
    return shade[:, None] * to_rgb(MESH)
