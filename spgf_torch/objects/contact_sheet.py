"""One picture of a set of objects, to look over: every mesh flat-shaded with its name and size.

Written with `python -m spgf_torch.objects.contact_sheet` from `data/objects`, into the same folder.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import ceil
from pathlib import Path

import numpy as np
import trimesh
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure

from spgf_torch.objects.config import CLASSES
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.objects.library import load_objects
from spgf_torch.paths import find

COLUMNS = 10
PATCH = 0.015  # m; largest edge that is drawn
COLOURS = dict(zip(CLASSES, ("#4c78a8", "#e0a458", "#72a276"), strict=True))
LIGHT = np.array([0.35, -0.55, 0.76])  # towards the lamp: front right, above
AZIMUTH, ELEVATION = np.deg2rad([-65.0, 32.0])  # of the camera: from the front, so that handles show


def contact_sheet(objects: Sequence[GraspObject], path: Path) -> None:
    """Draw all objects, by class and name, ten in a row, into one PNG. All share one scale but for the largest."""
    ordered = sorted(objects, key=lambda item: (CLASSES.index(item.category), item.name))
    rows = ceil(len(ordered) / COLUMNS)
    figure = Figure(figsize=(2.0 * COLUMNS, 2.2 * rows), dpi=85, layout="constrained")
    axes = np.atleast_1d(figure.subplots(rows, COLUMNS)).ravel()
    for axis in axes:
        axis.set_axis_off()
    for axis, item in zip(axes, ordered, strict=False):
        _draw(axis, item)
    figure.savefig(path)


def _draw(axis: Axes, item: GraspObject) -> None:
    """One object, parallel projection: far triangles first, each as bright as it faces the lamp."""
    view = _camera()
    # Large triangles cannot be sorted by depth.
    mesh: trimesh.Trimesh = item.mesh.subdivide_to_size(PATCH)  # type: ignore[assignment]
    corners = mesh.triangles @ view.T
    facing = mesh.face_normals @ view[2] > 0
    order = np.flatnonzero(facing)[np.argsort(corners[facing][..., 2].mean(axis=1))]
    shade = 0.45 + 0.55 * np.clip(mesh.face_normals[order] @ (LIGHT / np.linalg.norm(LIGHT)), 0.0, 1.0)
    colours = np.clip(shade[:, None] * to_rgb(COLOURS[item.category]), 0.0, 1.0)
    axis.add_collection(
        PolyCollection(list(corners[order][..., :2]), facecolors=colours, edgecolors=colours, linewidths=0.4)
    )
    middle = (corners[..., :2].min(axis=(0, 1)) + corners[..., :2].max(axis=(0, 1))) / 2
    half = max(0.085, np.ptp(corners[..., :2], axis=(0, 1)).max() / 2 * 1.02)
    axis.set(xlim=(middle[0] - half, middle[0] + half), ylim=(middle[1] - half, middle[1] + half), aspect="equal")
    x, y, z = np.round(item.mesh.extents * 1e3).astype(int)
    axis.set_title(f"{item.name}\n{x} x {y} x {z} mm, {item.mass * 1e3:.0f} g", fontsize=8)


def _camera() -> np.ndarray:
    """(3, 3): rows are the picture's right, up and the direction towards the camera, in the object's frame."""
    towards = np.array([np.cos(ELEVATION) * np.cos(AZIMUTH), np.cos(ELEVATION) * np.sin(AZIMUTH), np.sin(ELEVATION)])
    right = np.array([-np.sin(AZIMUTH), np.cos(AZIMUTH), 0.0])
    return np.stack([right, np.cross(towards, right), towards])


if __name__ == "__main__":
    folder = find("data/objects")
    contact_sheet(load_objects(folder), folder / "contact_sheet.png")
