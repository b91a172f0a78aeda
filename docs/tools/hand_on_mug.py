"""The picture of the README: a hand on a mug, from the committed objects, hands and trials.

    python docs/tools/hand_on_mug.py [docs/images/hand_on_mug.png]

The pose is a trial of data/trials that held. What is drawn is what the trial was made with: the mesh of the object and
the collision shapes of the hand, with its fingers closed until the pads meet the wall. Rays are cast by embree.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from PIL import Image

from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import load_hand
from spgf_torch.objects.library import load_objects
from spgf_torch.paths import root
from spgf_torch.sensing.cameras import Camera, look_at
from spgf_torch.settings import settings
from spgf_torch.simulation.table import read_table

OBJECT, TYPE = "mug_coffee", "NPG"
WIDTH, HEIGHT, SAMPLES = 640, 600, 2  # px of the picture; rays a pixel along each side
AZIMUTH, ELEVATION, DISTANCE, FOCAL = -62.0, 24.0, 1.1, 2150.0  # deg, deg, m, px
LAMP = np.array([0.15, -0.75, 1.0])  # towards the light, world
CLEARANCE = 1e-4  # m that a ray starts above the surface
RAYS = 40  # of each point towards the sky: soft shadows
REACH = 0.12  # m within which another surface darkens
MUG, HAND, FLOOR = (0.91, 0.90, 0.87), (0.17, 0.38, 0.45), (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class Solid:
    """A mesh (world frame, m) and the colour (F, 3) of each face, linear, 0 to 1."""

    mesh: trimesh.Trimesh
    colours: np.ndarray


def upright_grasp(poses: np.ndarray) -> np.ndarray:
    """Of poses (M, 4, 4), one from above at the rim, left in the picture, where both fingers are seen."""
    sight = np.array([np.cos(np.deg2rad(AZIMUTH)), np.sin(np.deg2rad(AZIMUTH))])
    left = np.array([sight[1], -sight[0]])
    hidden = np.abs(poses[:, :2, 0] @ sight)  # one finger behind the other
    return poses[int(np.argmax(-poses[:, 2, 2] - hidden + 20.0 * (poses[:, :2, 3] @ left)))]


def hand_shapes(opening: float, T_world_tcp: np.ndarray) -> trimesh.Trimesh:
    """The SDH-2's collision shapes with its pads `opening` (m) apart, world frame."""
    config = settings(HandConfig)
    for preshape in config.preshapes.values():
        preshape.opening = opening
    shapes = load_hand(config).preshapes[TYPE].shapes
    return trimesh.util.concatenate([shape.copy().apply_transform(T_world_tcp) for shape in shapes])


def joined(mug: trimesh.Trimesh, hand: trimesh.Trimesh) -> Solid:
    """Mug, hand and a floor that the mug stands on."""
    low = mug.bounds[0, 2]
    floor = trimesh.creation.box((4.0, 4.0, 0.01), trimesh.transformations.translation_matrix((0, 0, low - 0.005)))
    parts = [(mug, MUG), (hand, HAND), (floor, FLOOR)]
    colours = np.concatenate([np.tile(colour, (len(mesh.faces), 1)) for mesh, colour in parts])
    return Solid(trimesh.util.concatenate([mesh for mesh, _ in parts]), colours)


def shaded(solid: Solid, camera: Camera) -> np.ndarray:
    """(H, W, 3) in [0, 1]: diffuse light of a lamp and of the sky, each where nothing is in its way."""
    rays = camera.rays().reshape(-1, 3) @ camera.T_object_camera[:3, :3].T
    eyes = np.broadcast_to(camera.T_object_camera[:3, 3], rays.shape)
    face, ray, points = solid.mesh.ray.intersects_id(eyes, rays, multiple_hits=False, return_locations=True)
    normals = solid.mesh.face_normals[face]
    normals = normals * -np.sign((normals * rays[ray]).sum(axis=1, keepdims=True))
    start = points + CLEARANCE * normals
    lamp = LAMP / np.linalg.norm(LAMP)
    lit = ~solid.mesh.ray.intersects_any(start, np.tile(lamp, (len(start), 1)))
    light = 0.45 * lit * np.clip(normals @ lamp, 0, None) + 0.75 * sky(solid, start, normals)
    image = np.ones((len(rays), 3))
    image[ray] = np.clip(solid.colours[face] * light[:, None], 0, 1) ** (1 / 1.6)
    return image.reshape(camera.height, camera.width, 3)


def sky(solid: Solid, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """(P,) share of the rays over each point's half space that meet nothing within `REACH`."""
    generator, open_share = np.random.default_rng(0), np.zeros(len(points))
    for _ in range(RAYS):
        towards = normals + (sphere := generator.normal(size=normals.shape)) / np.linalg.norm(sphere, axis=1)[:, None]
        towards /= np.linalg.norm(towards, axis=1, keepdims=True)
        _, ray, at = solid.mesh.ray.intersects_id(points, towards, multiple_hits=False, return_locations=True)
        near = np.linalg.norm(at - points[ray], axis=1) < REACH
        blocked = np.zeros(len(points), dtype=bool)
        blocked[ray[near]] = True
        open_share += ~blocked
    return open_share / RAYS


def main(path: Path) -> None:
    mug = next(each for each in load_objects(root() / "data/objects") if each.name == OBJECT).mesh
    table = read_table(root() / f"data/trials/{OBJECT}.parquet")
    held = (table.success & (table.grasp_type == 0)).numpy()
    T_world_tcp = upright_grasp(table.T_object_tcp.numpy()[held].astype(np.float64))
    solid = joined(mug, hand_shapes(0.006, T_world_tcp))
    centre = np.array([*mug.bounds.mean(axis=0)[:2], mug.bounds[0, 2] + 0.115])
    azimuth, elevation = np.deg2rad([AZIMUTH, ELEVATION])
    towards = [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    width, height = WIDTH * SAMPLES, HEIGHT * SAMPLES
    focal = FOCAL * SAMPLES
    K = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1.0]])
    image = shaded(solid, Camera(K, look_at(centre + DISTANCE * np.array(towards), centre), width, height))
    image = image.reshape(HEIGHT, SAMPLES, WIDTH, SAMPLES, 3).mean(axis=(1, 3))
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray((image * 255).round().astype(np.uint8)).quantize(256).save(path, optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "docs/images/hand_on_mug.png"))
