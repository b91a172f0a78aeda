"""Contact-GraspNet (Sundermeyer 2021; Panda hand) with its trained weights, run in a Python environment of its own.

Its PyTorch port comes as a wheel with weights (cgn-pytorch, 30 MB), but wants versions of 2023. So it gets its own:

    python3.11 -m venv CGN
    CGN/bin/pip install torch==2.13.0 torch_geometric==2.4.0 numpy scipy numba trimesh pyyaml
    CGN/bin/pip install importlib_resources meshcat
    CGN/bin/pip install --no-deps cgn-pytorch==0.4.3

and `peers.py ... cgn=CGN/bin/python` calls it (`cgn_worker`), with files between the two. Its input is raw points of
the noisy depth images that ours sees, the table among them, cut to a cube of twice the object's size about it; contacts
are chosen on the object. Of the inputs that were tried it does best with this one.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import trimesh
from torch import Tensor

from spgf_torch.errors import InputError
from spgf_torch.judging.clouds import Cloud
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.sensing import sense
from spgf_torch.sensing.cameras import Camera, cast, surround
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.sensing.noise import measure
from spgf_torch.sensing.unseen import DepthView, whole_image

WORKER = Path(__file__).parent / "cgn_worker.py"
FURTHER = 0.1034  # m from the base of its hand to the TCP, along the approach
LEAST, MOST = 0.2, 0.6  # m; side of the cube that is cut out


@dataclass(frozen=True)
class Raw:
    """Sensed points (N, 3) f32, m, frame of the object; which of them are on it (N,) bool."""

    points: np.ndarray
    on_object: np.ndarray


@dataclass(frozen=True)
class Found:
    """T_tcp (G, 4, 4) f32 and confidence (G,) f32, the highest first; seconds of the processor for the cloud."""

    T: Tensor
    confidence: Tensor
    seconds: float


@dataclass(frozen=True)
class ContactGraspNet:
    """The network behind the interpreter `python`."""

    python: Path

    @staticmethod
    def of(python: str) -> ContactGraspNet:
        """Raises InputError where it does not run."""
        found = ContactGraspNet(Path(python).expanduser())
        found._called()
        return found

    def grasps(self, clouds: Sequence[Raw], seeds: Sequence[int]) -> list[Found]:
        """What it finds in each cloud; the network is loaded once and its first call is not counted."""
        with tempfile.TemporaryDirectory() as folder:
            given, got = Path(folder) / "clouds.npz", Path(folder) / "grasps.npz"
            write_clouds(given, clouds, seeds)
            self._called(given, got)
            return read_grasps(got)

    def _called(self, *files: Path) -> None:
        environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"} | {"OMP_NUM_THREADS": "1"}
        try:
            command = [str(self.python), str(WORKER), *map(str, files)]
            ran = subprocess.run(command, capture_output=True, text=True, env=environment)
        except OSError as error:
            raise self._refused(error.strerror or str(error)) from None
        if ran.returncode:
            raise self._refused((ran.stderr.strip().splitlines() or [f"exit status {ran.returncode}"])[-1])

    def _refused(self, got: str) -> InputError:
        return InputError(
            f"cgn={self.python}: expected a Python with cgn-pytorch, installed as {Path(__file__).name} says; got {got}"
        )


def write_clouds(path: Path, clouds: Sequence[Raw], seeds: Sequence[int]) -> None:
    """Points one after the other, how many each cloud has, and the seed of its sampling."""
    np.savez(
        path,
        points=np.concatenate([cloud.points for cloud in clouds]),
        on_object=np.concatenate([cloud.on_object for cloud in clouds]),
        counts=np.array([len(cloud.points) for cloud in clouds]),
        seeds=np.array(seeds),
    )


def read_grasps(path: Path) -> list[Found]:
    """What the worker wrote, as poses of the TCP."""
    with np.load(path) as found:
        T, confidence = torch.from_numpy(found["T_base"]).float(), torch.from_numpy(found["confidence"]).float()
        counts, seconds = found["counts"].tolist(), found["seconds"].tolist()
    return [Found(*its) for its in zip(tcp(T).split(counts), confidence.split(counts), seconds, strict=True)]


def tcp(T_base: Tensor) -> Tensor:
    """Poses (G, 4, 4) of the TCP from those of the hand's base; both have +z the approach and +x along closing."""
    T = T_base.clone()
    T[:, :3, 3] += FURTHER * T[:, :3, 2]
    return T


def raw_cloud(obj: GraspObject, sensing: SensingConfig, cloud: Cloud, seed: int) -> Raw:
    """The points behind `cloud`, which is `seen_as(obj, sensing, cloud.on_table, seed)`: rendered again, table and all.

    On a table what is higher than `sense.ABOVE` over it is the object's, as for ours; else everything is.
    Raises RuntimeError where the images are not those that ours saw.
    """
    images = _images(obj.mesh, sensing, cloud.on_table, np.random.default_rng([seed, zlib.crc32(obj.name.encode())]))
    whole = surround(sensing, obj.mesh.bounds.mean(axis=0))
    for (depth, part), camera, view in zip(images, whole, cloud.seen.views, strict=True):
        if not torch.equal(DepthView.of(whole_image(depth, part, camera), camera).depth, view.depth):
            raise RuntimeError(f"{obj.name}: the images rendered again are not those that were sensed")
    points = np.concatenate([back_projected(depth, camera) for depth, camera in images])
    level = float(obj.mesh.bounds[0, 2]) + sense.ABOVE
    on_object = points[:, 2] > level if cloud.on_table else np.ones(len(points), bool)
    near = in_cube(points, cloud.seen.texlets.positions.numpy())
    return Raw(points[near].astype(np.float32), on_object[near])


def _images(
    mesh: trimesh.Trimesh, sensing: SensingConfig, on_table: bool, rng: np.random.Generator
) -> list[tuple[np.ndarray, Camera]]:
    """Depth images (H, W), m, and cameras, as `sense.observe_on_table` and `observe_views` make them first of all."""
    cameras = surround(sensing, mesh.bounds.mean(axis=0))
    if not on_table:
        return sense._images(mesh, cameras, sensing, rng)
    both = trimesh.util.concatenate([mesh, sense._table(mesh)])
    return [(measure(*cast(both, camera), camera.K[0, 0], sensing, rng), camera) for camera in cameras]


def back_projected(depth: np.ndarray, camera: Camera) -> np.ndarray:
    """Points (N, 3) of the pixels with a return, m, in the frame in which the camera's pose is."""
    seen = depth > 0
    T = camera.T_object_camera
    return (camera.rays()[seen] * depth[seen, None]) @ T[:3, :3].T + T[:3, 3]


def in_cube(points: np.ndarray, of_object: np.ndarray) -> np.ndarray:
    """(N,) bool: which points (N, 3) are in a cube about the box of an object's (M, 3), twice as wide as it is."""
    low, high = of_object.min(axis=0), of_object.max(axis=0)
    side = np.clip(2 * (high - low).max(), LEAST, MOST)
    return (np.abs(points - (low + high) / 2) <= side / 2).all(axis=1)
