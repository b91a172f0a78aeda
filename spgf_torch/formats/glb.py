"""`grasps.glb`: hands, cloud and table as one glTF 2.0 file, for Blender and any other program that shows meshes.

glTF is in metres, and its +y is up. The root node `input` turns the input's frame so that its +z is glTF's +y:
(x, y, z) of the input is (x, z, -y) of glTF, which Blender turns back when it imports. So coordinates in Blender are
those of the input, and what stands upright there is +z of the input, also where that is not up, as in a camera's own
frame. Below the root everything is in the input's frame. Colours are linear, as glTF has them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from matplotlib.colors import to_rgb
from trimesh.exchange.gltf import export_glb
from trimesh.visual.material import PBRMaterial
from trimesh.visual.texture import TextureVisuals

from spgf_torch.drawing.style import MESH, OBSTACLE, TABLE, success_colours
from spgf_torch.errors import InputError
from spgf_torch.files.writing import write_bytes
from spgf_torch.geometry.tangents import tangents
from spgf_torch.hands.records import Grasp, Gripper, gripper_for

# Pose of the input's frame in glTF's: z up becomes y up.
T_GLTF_INPUT = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
ROOT = "input"
AROUND = 0.08  # m of a table that are shown around what stands on it


@dataclass(frozen=True)
class Surroundings:
    """What is shown beside the hands, in the grasps' frame.

    Attributes:
        positions, normals: (N, 3) of texlets, m and unit; drawn as squares in the surface, `spacing` (m) wide.
        obstacles: (M, 3) m, drawn as points.
        table: (4,) a, b, c, d, a x + b y + c z + d the height above it in m; None: none is known.
        colours: (N, 3) uint8, sRGB, of the texlets; None: grey.
    """

    positions: np.ndarray
    normals: np.ndarray
    spacing: float
    obstacles: np.ndarray
    table: np.ndarray | None = None
    colours: np.ndarray | None = None

    def __post_init__(self) -> None:
        shapes = [np.shape(part) for part in (self.positions, self.normals, self.colours) if part is not None]
        if len(set(shapes)) != 1 or shapes[0][1:] != (3,) or np.shape(self.obstacles)[1:] != (3,):
            got = ", ".join(map(str, (*shapes, np.shape(self.obstacles))))
            raise InputError(
                f"surroundings: expected positions, normals, colours (N, 3) and obstacles (M, 3), got {got}"
            )

    def transform(self, T: np.ndarray) -> Surroundings:
        """The same in another frame, by the rigid T (4, 4): p_other = T @ p; m."""
        rotation, shift = T[:3, :3], T[:3, 3]
        positions, obstacles = (points @ rotation.T + shift for points in (self.positions, self.obstacles))
        table = None if self.table is None else np.asarray(self.table) @ np.linalg.inv(T)
        return replace(self, positions=positions, normals=self.normals @ rotation.T, obstacles=obstacles, table=table)


def write_glb(
    path: Path, grasps: Sequence[Grasp], grippers: Mapping[str, Gripper], beside: Surroundings | None = None
) -> None:
    """Write the hands of all the grasps and all that is beside them; nothing is thinned.

    Nodes: `input`, and below it `cloud`, `obstacles`, `table` (what there is of them), and for each grasp
    `rank_1_NPG`: the open hand's collision shapes at the TCP's pose, coloured by probability, red 0 to green 1, with
    rank, type, probability, score and support as extras, which Blender shows as custom properties.

    Args:
        grasps: best first. grippers: `records.grippers_of` the hand.

    Raises:
        InputError: no gripper for a grasp's type.
    """
    scene = trimesh.Scene(base_frame="gltf")
    scene.graph.update(frame_from="gltf", frame_to=ROOT, matrix=T_GLTF_INPUT)
    for name, shape in ({} if beside is None else _shapes(beside)).items():
        _add(scene, name, shape)
    solids = {name: _joined(gripper) for name, gripper in grippers.items()}
    colours = success_colours(np.array([grasp.probability for grasp in grasps]))
    for rank, (grasp, colour) in enumerate(zip(grasps, colours, strict=True), start=1):
        gripper, name = gripper_for(grasp, grippers), f"rank_{rank}_{grasp.type}"
        hand = _coloured(solids[gripper.type], colour, name)
        said = {"rank": rank, "type": grasp.type, "probability": grasp.probability, "score": grasp.score}
        _add(scene, name, hand, grasp.T_input_tcp, {**said, "support": grasp.support})
    write_bytes(path, export_glb(scene, include_normals=False))


def _add(scene: trimesh.Scene, name: str, shape: Any, T: np.ndarray | None = None, said: Any = None) -> None:
    """A node below the root with a mesh of its own name."""
    pose = np.eye(4) if T is None else T
    scene.add_geometry(shape, node_name=name, geom_name=name, parent_node_name=ROOT, transform=pose, metadata=said)


def _shapes(beside: Surroundings) -> dict[str, Any]:
    """Name -> what is drawn of it, in the frame of the root."""
    found: dict[str, Any] = {}
    if len(beside.positions):
        corners = _squares(beside.positions, beside.normals, beside.spacing)
        found["cloud"] = _coloured(_quads(corners), to_rgb(MESH), "cloud", beside.colours)
    if len(beside.obstacles):
        colour = [*np.rint(255 * _linear(np.array(to_rgb(OBSTACLE)))).astype(np.uint8), 255]
        found["obstacles"] = trimesh.PointCloud(beside.obstacles, np.tile(colour, (len(beside.obstacles), 1)))
    everything = np.concatenate([beside.positions, beside.obstacles])
    if beside.table is not None and len(everything):
        found["table"] = _coloured(_quads(_table(everything, beside.table)[None]), to_rgb(TABLE[0]), "table")
    return found


def _squares(positions: np.ndarray, normals: np.ndarray, side: float) -> np.ndarray:
    """(N, 4, 3) corners in the surface, counted so that the front is where the normal points."""
    u, v = tangents(normals)
    around = np.stack([-u - v, u - v, u + v, v - u], axis=1)
    corners: np.ndarray = positions[:, None] + side / 2 * around
    return corners


def _table(points: np.ndarray, table: np.ndarray) -> np.ndarray:
    """(4, 3) the corners of the part of a table below points (N, 3) and `AROUND` them."""
    length = np.linalg.norm(table[:3])
    normal, offset = table[:3] / length, table[3] / length
    u, v = (direction[0] for direction in tangents(normal[None]))
    at = points @ np.stack([u, v], axis=1)
    low, high = at.min(axis=0) - AROUND, at.max(axis=0) + AROUND
    flat = [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])]
    return np.array([x * u + y * v - offset * normal for x, y in flat])


def _quads(corners: np.ndarray) -> trimesh.Trimesh:
    """Quadrilaterals (N, 4, 3), each with vertices of its own."""
    first = 4 * np.arange(len(corners))[:, None, None]
    faces = (first + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    return trimesh.Trimesh(corners.reshape(-1, 3), faces, process=False)


def _joined(gripper: Gripper) -> trimesh.Trimesh:
    """The open hand's shapes as one mesh in the TCP's frame."""
    starts = np.cumsum([0, *(len(shape.vertices) for shape in gripper.shapes)])
    vertices = np.concatenate([np.zeros((0, 3)), *(shape.vertices for shape in gripper.shapes)])
    faces = [shape.faces + start for shape, start in zip(gripper.shapes, starts[:-1], strict=True)]
    return trimesh.Trimesh(vertices, np.concatenate([np.zeros((0, 3), int), *faces]), process=False)


def _coloured(mesh: trimesh.Trimesh, colour: Any, name: str, of_quads: np.ndarray | None = None) -> trimesh.Trimesh:
    """A copy in one colour (3,), sRGB from 0 to 1, or with one (N, 3) uint8 of each of its quadrilaterals."""
    plain = np.ones(3) if of_quads is not None else _linear(np.asarray(colour))
    look = {"metallicFactor": 0.0, "roughnessFactor": 0.8, "doubleSided": True}
    visual = TextureVisuals(material=PBRMaterial(name=name, baseColorFactor=np.append(plain, 1.0), **look))
    if of_quads is not None:
        linear = np.rint(255 * _linear(np.repeat(of_quads, 4, axis=0) / 255)).astype(np.uint8)
        visual.vertex_attributes["color"] = np.insert(linear, 3, 255, axis=1)
    return trimesh.Trimesh(mesh.vertices, mesh.faces, visual=visual, process=False)


def _linear(colour: np.ndarray) -> np.ndarray:
    """sRGB from 0 to 1 as linear light (IEC 61966-2-1)."""
    light: np.ndarray = np.where(colour <= 0.04045, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4)
    return light
