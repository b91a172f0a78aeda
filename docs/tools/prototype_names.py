"""How many features are what the name of their prototype says, by the objects' meshes: the table of docs/paper.md.

    python docs/tools/prototype_names.py RUN [RUN ...]      # runs of train with fold_models=true

Each object is met by the prototypes of the fold that has not seen it. What is true of a feature is read off the exact
mesh within the features' radius of it, by words that do not look at the rings:

- surface: no crease (two faces that meet at 45 degrees or more) within two thirds of the radius;
- wall: something within the radius faces the other way (120 degrees or more);
- rim: the upper border of a container within half the radius;
- edge: a crease that bulges out, and inner edge: one that is hollow, within the radius;
- cap: in three quarters of the directions around the normal something within the radius is turned away by 45 degrees
  or more, and lies below the centre's plane;
- inner: a hollow crease, or something on the same side that rises a sixth of the radius above the centre's plane.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from spgf_torch.experiment.held_out import load_fold_models
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.objects.library import load_objects
from spgf_torch.paths import find
from spgf_torch.prototypes.kmeans import assign
from spgf_torch.prototypes.naming import ring_shape
from spgf_torch.reporting.data.runs import read_run
from spgf_torch.reporting.pages.pictured import Eyes

CREASE, TURNED = np.radians(45.0), np.cos(np.radians(45.0))
FACING_AWAY, SAME_SIDE = -0.5, 0.5  # cosines
SAMPLES, SECTORS = 20_000, 12
TOP = 1e-3  # m below the highest point; what belongs to a container's upper border
WORDS = ("surface", "inner surface", "wall", "inner wall", "rim", "edge", "inner edge", "cap")


def distance(points: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(N,) m from points (N, 3) to the nearest of the segments from a to b (S, 3); infinite without any."""
    if not len(a):
        return np.full(len(points), np.inf)
    along = b - a
    t = np.clip(((points[:, None] - a) * along).sum(2) / (along**2).sum(1), 0, 1)
    nearest: np.ndarray = np.linalg.norm(points[:, None] - a - t[..., None] * along, axis=2).min(axis=1)
    return nearest


def creases(obj: GraspObject) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Ends a and b (S, 3) of the mesh's creases, and which bulge out and which are a container's upper border (S,)."""
    mesh = obj.mesh.copy()
    mesh.merge_vertices()
    sharp = mesh.face_adjacency_angles >= CREASE
    a, b = mesh.vertices[mesh.face_adjacency_edges[sharp]].transpose(1, 0, 2)
    high = (np.minimum(a[:, 2], b[:, 2]) > mesh.bounds[1, 2] - TOP) & (obj.category == "containers")
    return a, b, mesh.face_adjacency_convex[sharp], high


def around(mesh: trimesh.Trimesh, points: np.ndarray, normals: np.ndarray, radius: float) -> Iterator[np.ndarray]:
    """Of each point what lies around it: whether something faces away, how high the same side rises (m), and the share
    of directions in which it falls away."""
    surface, face = trimesh.sample.sample_surface_even(mesh, SAMPLES, seed=0)
    turned, tree = mesh.face_normals[face], cKDTree(surface)
    for point, seen in zip(points, normals, strict=True):
        near = np.array(tree.query_ball_point(point, radius), dtype=int)
        near = near[np.argsort(np.linalg.norm(surface[near] - point, axis=1))]
        own = near[turned[near] @ seen > SAME_SIDE][:1]
        normal = turned[own[0]] if len(own) else seen  # the exact one, of the nearest face on that side
        step, cosine = surface[near] - point, turned[near] @ normal
        height = step @ normal
        across = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
        turn = np.arctan2(step @ np.cross(normal, across), step @ across)
        falls = (cosine > FACING_AWAY) & (cosine < TURNED) & (height < 0)
        sectors = np.unique((turn[falls] / (2 * np.pi) * SECTORS).astype(int) % SECTORS)
        rises = height[cosine > 0].max(initial=0.0)
        yield np.array([(cosine < FACING_AWAY).any(), rises, len(sectors) / SECTORS])


def truths(obj: GraspObject, points: np.ndarray, normals: np.ndarray, radius: float) -> dict[str, np.ndarray]:
    """Of each word whether it is true of features at points (N, 3) m with normals (N, 3): (N,) bool."""
    a, b, out, high = creases(obj)
    edge, hollow, rim = (distance(points, a[which], b[which]) for which in (out, ~out, high))
    wall, rises, falls = np.array(list(around(obj.mesh, points, normals, radius))).T
    inner, smooth = (rises > radius / 6) | (hollow < radius), np.minimum(edge, hollow) > radius / 1.5
    values = (smooth, smooth & inner, wall > 0, (wall > 0) & inner, rim < radius / 2, edge < radius, hollow < radius)
    return dict(zip(WORDS, (*values, falls >= 0.75), strict=True))


def told(run: Path) -> list[tuple[str, dict[str, bool]]]:
    """Of each feature of each object its prototype's name without number, and what is true."""
    eyes, kept = Eyes.of(read_run(run)), load_fold_models(run)
    rows = []
    for obj in load_objects(find(read_run(run).settings["objects"])):
        model = kept.models[kept.fold_of(obj)]
        names = [ring_shape(ring).name for ring in model.rings_deg()]
        texlets, found = eyes.see(obj)
        ids = assign(found.relations(), model.centres).tolist()
        points, normals = texlets.positions.double().numpy(), texlets.normals.double().numpy()
        true = truths(obj, points, normals, eyes.features.radius)
        rows += [(names[k], {word: bool(true[word][i]) for word in WORDS}) for i, k in enumerate(ids)]
    return rows


def table(rows: list[tuple[str, dict[str, bool]]]) -> str:
    """Markdown: of each name how many features have it, of how many it is true, and of how many of all."""
    lines = ["| name | features | it is true of | true of all features |", "|---|---|---|---|"]
    for word in (*WORDS, "mixed"):
        of = [true for name, true in rows if name == word]
        if not of:
            continue
        share = f"{100 * np.mean([true[word] for true in of]):.0f} %" if word in WORDS else "-"
        base = f"{100 * np.mean([true[word] for _, true in rows]):.0f} %" if word in WORDS else "-"
        lines.append(f"| {word} | {len(of)} ({100 * len(of) / len(rows):.0f} %) | {share} | {base} |")
    return "\n".join(lines)


if __name__ == "__main__":
    for path in map(Path, sys.argv[1:]):
        print(f"K = {read_run(path).K}\n\n{table(told(path))}\n")
