"""The things of a cluttered table as surfaces in one colour each, for the page and for the film."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import trimesh

from spgf_torch.drawing.rendered import Solid, camera_at
from spgf_torch.drawing.style import TABLE
from spgf_torch.hands.hand import Hand
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.sensing.cameras import Camera

# Okabe and Ito's without red and green, which are outcomes; lighter, so that the cloud is seen on them.
OBJECTS = ("#7db8de", "#f0bf5c", "#d7a5c4", "#efe68c", "#a9b7e8", "#c9ad8c", "#9fd3d0")
HAND = "#74879a"  # of a hand whose outcome is not known yet
FACES = 600  # of an object that are drawn at most: a page of five rounds stays below 1.5 MB
CELLS = (96, 64, 48, 36, 27, 20, 15, 11, 8, 6)  # along the longest side, finest first
HALF, TILES = 0.2, 10  # m, half a side of the table that is drawn, and tiles along a side
TOWARDS = np.array([0.75, -1.15, 0.8])  # from the table's middle to the eye, as the page's side view
TARGET = np.array([0.0, 0.0, 0.12])  # m, what the eye looks at
DISTANCE, WIDE = 1.2, 0.8  # m from eye to target, and across the picture there: room for a hand above the things


def overview(size: tuple[int, int]) -> Camera:
    """A camera of (width, height) pixels that sees the table and the hand above it."""
    return camera_at(TARGET + DISTANCE * TOWARDS / np.linalg.norm(TOWARDS), TARGET, size, WIDE)


def object_solids(objects: Sequence[GraspObject]) -> list[Solid]:
    """Each object in its own frame, with few faces, in the colour of its place in the list."""
    return [
        Solid(*coarse(np.asarray(each.mesh.vertices), np.asarray(each.mesh.faces), FACES), OBJECTS[i % len(OBJECTS)])
        for i, each in enumerate(objects)
    ]


def table_solids() -> list[Solid]:
    """The table's tiles, a solid each of their two colours; world frame."""
    low = np.linspace(-HALF, HALF, TILES, endpoint=False)
    i, j = (grid.ravel() for grid in np.meshgrid(range(TILES), range(TILES), indexing="ij"))
    side = 2 * HALF / TILES
    steps = np.array([[0, 0, 0], [side, 0, 0], [side, side, 0], [0, side, 0]])
    corners = np.stack([low[i], low[j], np.zeros(len(i))], axis=1)[:, None] + steps
    faces = 4 * np.arange(len(i))[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])
    return [
        Solid(corners[kind].reshape(-1, 3), faces[: int(kind.sum())].reshape(-1, 3), colour)
        for kind, colour in (((i + j) % 2 == odd, TABLE[odd]) for odd in (0, 1))
    ]


def open_hand(hand: Hand, grasp_type: str, colour: str) -> Solid:
    """The open hand's collision shapes in the TCP frame."""
    return joined(hand.preshapes[grasp_type].shapes, colour)


def link_solids(hand: Hand, links: Sequence[str]) -> list[Solid | None]:
    """The collision shapes that move with each of `links`, in its frame; None where there are none.

    What is fixed to a link that is not in the list moves with its rigid body; what is not simulated is left out.
    """
    bodies, poses = hand.robot.bodies(), next(iter(hand.preshapes.values())).T_base_link
    shapes: dict[str, list[trimesh.Trimesh]] = {link: [] for link in links}
    for piece in hand.robot.collisions:
        carrier = piece.link if piece.link in shapes else bodies[piece.link]
        if carrier in shapes:
            T = np.linalg.inv(poses[carrier]) @ poses[piece.link] @ piece.T_link_shape
            shapes[carrier].append(piece.mesh.copy().apply_transform(T))
    return [joined(shapes[link], HAND) if shapes[link] else None for link in links]


def joined(shapes: Sequence[trimesh.Trimesh], colour: str) -> Solid:
    """Meshes as one solid."""
    starts = np.cumsum([0, *(len(shape.vertices) for shape in shapes)])
    faces = [np.asarray(shape.faces) + start for shape, start in zip(shapes, starts, strict=False)]
    return Solid(np.concatenate([np.asarray(shape.vertices) for shape in shapes]), np.concatenate(faces), colour)


def coarse(vertices: np.ndarray, faces: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """A surface with at most so many faces, where the coarsest cells allow: vertices of a cell become their mean.

    Args:
        vertices: (V, 3). faces: (F, 3).
    """
    low = vertices.min(axis=0)
    size = float((vertices.max(axis=0) - low).max())
    found, kept = vertices, faces
    for cells in CELLS:
        if len(kept) <= most:
            break
        cell = np.minimum((vertices - low) / size * cells, cells - 1).astype(int)
        _, where = np.unique(cell, axis=0, return_inverse=True)
        count = np.bincount(where)
        found = np.stack([np.bincount(where, vertices[:, axis]) / count for axis in range(3)], axis=1)
        kept = where[faces]
        kept = kept[(kept != np.roll(kept, 1, axis=1)).all(axis=1)]
        kept = kept[np.unique(np.sort(kept, axis=1), axis=0, return_index=True)[1]]
    return found, kept
