"""Contact-GraspNet (Sundermeyer 2021; Panda hand) with its trained weights, run in a Python environment of its own.

Its PyTorch port comes as a wheel with weights (cgn-pytorch, 30 MB), but wants versions of 2023. So it gets its own:

    python3.11 -m venv CGN
    CGN/bin/pip install torch==2.13.0 torch_geometric==2.4.0 numpy scipy numba trimesh pyyaml
    CGN/bin/pip install importlib_resources meshcat
    CGN/bin/pip install --no-deps cgn-pytorch==0.4.3

and `cgn=CGN/bin/python` names it (`cgn_worker` runs there), with files between the two. Its input is raw points of the
noisy depth images that ours sees, the table among them, cut to a cube about what may be grasped of twice its size;
contacts are chosen on that. Of the inputs that were tried it does best with this one.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from spgf_torch.errors import InputError
from spgf_torch.sensing.cameras import Camera

WORKER = Path(__file__).parent / "cgn_worker.py"
FURTHER = 0.1034  # m from the base of its hand to the TCP, along the approach
LEAST, MOST = 0.2, 0.6  # m; side of the cube that is cut out


@dataclass(frozen=True)
class Raw:
    """Sensed points (N, 3) f32, m, in any frame; which of them are on what may be grasped (N,) bool."""

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

    def serving(self) -> Served:
        """A process that keeps the network, for one cloud after the other; it starts at the first."""
        return Served(self)

    def _called(self, *files: Path) -> None:
        try:
            ran = subprocess.run(self._command(*map(str, files)), capture_output=True, text=True, env=_environment())
        except OSError as error:
            raise self._refused(error.strerror or str(error)) from None
        if ran.returncode:
            raise self._refused((ran.stderr.strip().splitlines() or [f"exit status {ran.returncode}"])[-1])

    def _command(self, *arguments: str) -> list[str]:
        return [str(self.python), str(WORKER), *arguments]

    def _refused(self, got: str) -> InputError:
        return InputError(
            f"cgn={self.python}: expected a Python with cgn-pytorch, installed as {Path(__file__).name} says; got {got}"
        )


class Served:
    """The network in a process of its own, which is loaded once; it ends with this one."""

    def __init__(self, network: ContactGraspNet) -> None:
        self.network = network
        self._process: subprocess.Popen[str] | None = None

    def grasps(self, cloud: Raw, seed: int) -> Found:
        """What it finds in a cloud. Raises InputError where the process does not answer."""
        if self._process is None:
            pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
            command = self.network._command("serve")
            self._process = subprocess.Popen(command, text=True, env=_environment(), **pipes)  # type: ignore[call-overload]
        process = self._process
        assert process is not None and process.stdin is not None and process.stdout is not None
        with tempfile.TemporaryDirectory() as folder:
            given, got = Path(folder) / "clouds.npz", Path(folder) / "grasps.npz"
            write_clouds(given, [cloud], [seed])
            try:
                process.stdin.write(f"{given}\n{got}\n")
                process.stdin.flush()
                answered = process.stdout.readline()
            except BrokenPipeError:
                answered = ""
            if not answered:
                raise self.network._refused(f"exit status {process.wait()}")
            return read_grasps(got)[0]

    def end(self) -> None:
        """End the process, where there is one; it ends by itself when this one does."""
        if self._process is not None:
            self._process.communicate()
            self._process = None


def _environment() -> dict[str, str]:
    """Without our package, and on one thread."""
    return {k: v for k, v in os.environ.items() if k != "PYTHONPATH"} | {"OMP_NUM_THREADS": "1"}


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
