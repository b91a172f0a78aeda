"""Whether a surface is what one camera sees, as RealSense, Zivid and Photoneo write it, or a thing from all sides."""

from __future__ import annotations

import numpy as np

from spgf_torch.scene.normals import sphere

# Of the faces' area, those that a camera has before it: noise turns a few at depth edges.
_SEEN = 0.95
# Cosine of the angle to the mean direction within which a camera sees nearly all: from inside of a thing all is around.
_IN_VIEW, _NEARLY = 0.5, 0.99
# Times the median edge: longer faces join what is apart in depth, along the rays, and say nothing of the camera.
_STRETCHED = 4.0
# Of the area of the faces about a corner, that of their sum where they lie in one plane.
_FLAT = 0.99
_DIRECTIONS = 256
# Extents of the surface to a camera of which only the direction is known.
_AWAY = 3.0
_FACES = 4000


def seen_from(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray | None:
    """(3,) a place from which all of an open surface is seen, the origin before others; None for any other surface.

    From far away in a direction, the place is several extents out: it tells the side, not the distance.

    Args:
        vertices: (V, 3), any unit. faces: (F, 3), turned one way throughout.
    """
    vertices, faces = _joined(vertices, faces)
    if not len(faces) or (not _open(faces) and _is_corner(vertices, faces)):
        return None
    faces = _measured(vertices, faces)
    if len(faces) < 2 or not _open(faces):
        return None
    corners = vertices[faces]
    edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    corners = corners[edges <= _STRETCHED * np.median(edges)]
    if len(corners) > _FACES:
        corners = corners[np.random.default_rng(0).choice(len(corners), _FACES, replace=False)]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    middle, size = corners.mean(axis=1), np.linalg.norm(area, axis=1)
    if not size.sum() > 0:
        return None
    extent = float(np.ptp(vertices[np.unique(faces)], axis=0).max())
    centre = middle.mean(axis=0)
    # Beyond the directions: the mean of the faces', of either sign.
    towards = area.sum(axis=0) / max(float(np.linalg.norm(area.sum(axis=0))), 1e-300)
    eyes = [centre + _AWAY * extent * d for d in (towards, -towards, *sphere(_DIRECTIONS))]

    def seen(eye: np.ndarray, sign: float) -> bool:
        ray = middle - eye
        faced = sign * (ray * area).sum(axis=1) > 0
        return float(size[faced].sum()) >= _SEEN * float(size.sum()) and _ahead(ray)

    if seen(np.zeros(3), -1) or seen(np.zeros(3), 1):
        return np.zeros(3)
    # The sign of faces that are turned outwards; a surface is rather seen from there than from inside, and from inside
    # only where its faces are turned there, as a camera's are that looks into a bin.
    outwards = 1.0 if float((area * (middle - centre)).sum()) >= 0 else -1.0
    for sign in (-outwards, *((-1.0,) if outwards < 0 else ())):
        for eye in eyes:
            if seen(eye, sign):
                return eye
    return None


def _joined(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Vertices in one place as one, and the faces that have three corners still, finite ones."""
    found, home = np.unique(vertices, axis=0, return_inverse=True)
    faces = home.reshape(-1)[faces]
    whole = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    return found, faces[whole & np.isfinite(found).all(axis=1)[faces].all(axis=1)]


def _is_corner(vertices: np.ndarray, faces: np.ndarray) -> bool:
    """Whether 0 0 0 is a corner of a closed thing, such as the middle of its base; else what has no reading lies there.

    A camera joins such pixels to measured ones by faces all around the view, along rays, long beside the pixels.
    """
    corners = vertices[faces[(vertices[faces] == 0).all(axis=2).any(axis=1)]]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat = float(np.linalg.norm(area.sum(axis=0))) >= _FLAT * float(np.linalg.norm(area, axis=1).sum())
    edges = np.linalg.norm(vertices[faces] - np.roll(vertices[faces], 1, axis=1), axis=2)
    out = np.linalg.norm(corners, axis=2)
    return flat or bool(out[out > 0].min(initial=np.inf) <= _STRETCHED * np.median(edges))


def _measured(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """The faces without a corner at 0 0 0, which is no reading of a camera."""
    return faces[(vertices != 0).any(axis=1)[faces].all(axis=1)]


def _open(faces: np.ndarray) -> bool:
    """Whether some edge has one face only."""
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1).astype(np.int64)
    return bool((np.unique(edges @ [edges.max() + 1, 1], return_counts=True)[1] == 1).any())


def _ahead(ray: np.ndarray) -> bool:
    """Whether nearly all rays (N, 3) lie in a camera's field of view."""
    length = np.linalg.norm(ray, axis=1)
    mean = ray.sum(axis=0)
    inside = ray @ mean > _IN_VIEW * length * np.linalg.norm(mean)
    return bool(inside.mean() >= _NEARLY)
