"""Coverage-guided fuzzing of everything that reads a file (`make fuzz`, outside the suite).

atheris (libFuzzer) changes bytes of small valid files and keeps what reaches new code of this package and of PyYAML.
The first byte chooses the reader. A reader may return or raise InputError in one line; whatever else it raises, or a
call of more than five seconds, is a finding: its bytes go to `outputs/fuzz/`, once a reader and place, and it goes on.

    python tests/fuzz/readers.py SECONDS            # exit status 1 where something was found
    python tests/fuzz/readers.py FILE               # one finding again
"""

from __future__ import annotations

import io
import json
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import atheris
import numpy as np
import omegaconf  # noqa: F401 - what is not fuzzed is imported before
import pyarrow.parquet
import pytorch_kinematics  # noqa: F401
import scipy.spatial  # noqa: F401
import torch
import trimesh
from PIL import Image
from safetensors.torch import save

with atheris.instrument_imports(include=["spgf_torch", "yaml"]):
    import yaml

    from spgf_torch.affordance.model import load_model, model_settings
    from spgf_torch.errors import InputError
    from spgf_torch.evaluation.results import read_results
    from spgf_torch.files.mesh_files import mesh_arrays
    from spgf_torch.formats.graspnet import read_graspnet
    from spgf_torch.formats.grasps_json import read_grasps
    from spgf_torch.formats.isaac import read_isaac
    from spgf_torch.hands.config import HandConfig
    from spgf_torch.hands.hand import load_hand
    from spgf_torch.objects.library import load_object
    from spgf_torch.objects.manifest import read_manifest
    from spgf_torch.scene.depth_files import read_depth_file
    from spgf_torch.scene.files import read_cloud
    from spgf_torch.scene.intrinsics import read_intrinsics
    from spgf_torch.scene.labels import read_mask
    from spgf_torch.scene.poses import read_poses
    from spgf_torch.settings import settings
    from spgf_torch.simulation.table import read_table

ROOT = Path(__file__).parents[2]
FOUND = Path("outputs/fuzz")
LIMIT = 100_000  # points
SLOW = 5.0  # s
POINTS = np.linspace(0, 0.1, 18).reshape(6, 3)

# A reader's name: the suffix of its file, what reads it, and what is sure to be read, to begin with.
Reader = tuple[str, Callable[[Path], Any], Callable[[], list[bytes]]]


def saved(*arrays: np.ndarray) -> list[bytes]:
    streams = [io.BytesIO() for _ in arrays]
    for stream, array in zip(streams, arrays, strict=True):
        np.save(stream, array)
    return [stream.getvalue() for stream in streams]


def zipped() -> list[bytes]:
    stream = io.BytesIO()
    np.savez_compressed(stream, points=POINTS, viewpoints=np.ones((1, 3)))
    return [stream.getvalue()]


def pcd() -> list[bytes]:
    head = "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 1\nPOINTS 2\nDATA {}\n"
    packed = b"\x06\x00\x00\x00\x18\x00\x00\x00\x00\x00\xe0\x0e\x00\x00"
    bodies = {"ascii": b"0 0 0\n1 1 1\n", "binary": bytes(24), "binary_compressed": packed}
    return [head.format(kind).encode() + body for kind, body in bodies.items()]


def meshes(kind: str) -> Callable[[], list[bytes]]:
    def make() -> list[bytes]:
        made = trimesh.creation.box().export(file_type=kind)
        return [made if isinstance(made, bytes) else made.encode()]

    return make


def ply_cloud() -> list[bytes]:
    return [trimesh.PointCloud(POINTS).export(file_type="ply")]


def files(*names: str) -> Callable[[], list[bytes]]:
    return lambda: [(ROOT / name).read_bytes()[:40_000] for name in names]


def of(*texts: str) -> Callable[[], list[bytes]]:
    return lambda: [text.encode() for text in texts]


def png() -> list[bytes]:
    stream = io.BytesIO()
    Image.fromarray(np.full((4, 5), 700, np.uint16)).save(stream, "PNG")
    return [stream.getvalue()]


def parquet() -> list[bytes]:
    whole = pyarrow.parquet.read_table(ROOT / "data/trials/apple.parquet")
    stream = io.BytesIO()
    pyarrow.parquet.write_table(whole.slice(0, 4), stream)
    return [stream.getvalue()]


def tensors() -> list[bytes]:
    names = {"centres": (2, 3), "calibration": (2, 5), "slice_start": (5,), "cell": (0,), "probability": (0,)}
    whole = ("slice_start", "cell")
    made = {n: torch.zeros(s, dtype=torch.int64 if n in whole else torch.float32) for n, s in names.items()}
    return [save({**made, "support": torch.zeros(0), "base_rate": torch.zeros(2)})]


def model(path: Path) -> Any:
    """The tensors beside settings that are sound."""
    beside = path.with_name("model.json")
    if not beside.exists():
        sys.path.insert(0, str(ROOT / "tests/hostile"))
        from hostile import model_document

        beside.write_text(json.dumps(model_document()))
    return load_model(path.parent)


def hand(path: Path) -> Any:
    values = yaml.safe_load((ROOT / "conf/hand/panda.yaml").read_text())
    return load_hand(settings(HandConfig, **{**values, "urdf": str(path)}))


def cloud(path: Path) -> Any:
    return read_cloud(path, LIMIT)


GRASP = json.dumps({"schema": 1, "frame": "input", "base_link": "palm", "grasps": []})
ISAAC = """format: isaac_grasp
format_version: 1.0
object_frame_link: object
gripper_frame_link: palm
grasps:
  grasp_0:
    confidence: 0.5
    position: [0.0, 0.1, 0.2]
    orientation: {w: 1.0, xyz: [0.0, 0.0, 0.0]}
    cspace_position: {a: 0.1}
    pregrasp_cspace_position: {a: 0.2}
"""
K = ("[[50, 0, 25], [0, 50, 20], [0, 0, 1]]", '{"fx": 5, "fy": 5, "cx": 2, "cy": 2, "width": 5, "height": 4}')
ROS = "image_width: 5\nimage_height: 4\ncamera_matrix: {rows: 3, cols: 3, data: [5, 0, 2, 0, 5, 2, 0, 0, 1]}\n"
POSE = "[[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]"
RUN = json.dumps({"schema": 1, "K": 5, "success_rate": {"boxes": {"CG": 0.5}}})

READERS: dict[str, Reader] = {
    "ply": ("a.ply", cloud, ply_cloud),
    "pcd": ("a.pcd", cloud, pcd),
    "xyz": ("a.xyz", cloud, of("0 0 0\n1 1 1\n", "x,y,z,nx,ny,nz\n0,0,0,1,0,0\n")),
    "npy": ("a.npy", cloud, lambda: saved(POINTS, POINTS.reshape(2, 3, 3))),
    "npz": ("a.npz", cloud, zipped),
    **{kind: (f"a.{kind}", mesh_arrays, meshes(kind)) for kind in ("obj", "stl", "off", "glb")},
    "ply_mesh": ("a.ply", mesh_arrays, meshes("ply")),
    "depth": ("a.png", lambda path: read_depth_file(path, LIMIT), png),
    "mask": ("a.png", lambda path: read_mask(path, LIMIT), png),
    "k_json": ("a.json", read_intrinsics, of(*K)),
    "k_yaml": ("a.yaml", read_intrinsics, of(ROS)),
    "k_text": ("a.txt", read_intrinsics, of("50 0 25\n0 50 20\n0 0 1\n")),
    "poses": ("a.json", lambda path: read_poses([path]), of(POSE)),
    "object": ("a.yaml", load_object, files("data/objects/egg.yaml", "data/objects/mug_coffee.yaml")),
    "manifest": ("manifest.csv", read_manifest, of("name,class,mass\nbox,box,0.2\n")),
    "urdf": ("a.urdf", hand, files("data/hands/panda.urdf")),
    "table": ("a.parquet", read_table, parquet),
    "model_json": ("model.json", lambda path: model_settings(path.parent), of('{"format": "spgf_torch model"}')),
    "tensors": ("model.safetensors", model, tensors),
    "results": ("a.json", read_results, of(RUN)),
    "grasps": ("a.json", read_grasps, of(GRASP)),
    "isaac": ("a.yaml", read_isaac, of(ISAAC)),
    "graspnet": ("a.npy", read_graspnet, lambda: saved(np.zeros((2, 17)))),
}


NAMES = list(READERS)


def call(name: str, content: bytes, folder: Path) -> str | None:
    """One reader on some bytes: None, or the place of what it should not have raised."""
    file, read, _ = READERS[name]
    path = folder / name / file
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(content)
    start = time.perf_counter()
    try:
        read(path)
    except InputError as error:
        if not str(error).isprintable() or len(str(error)) > 1000:
            return "line"
    except Exception as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        return f"{type(error).__name__}-{Path(last.filename).stem}-{last.lineno}"
    return "slow" if time.perf_counter() - start > SLOW else None


def fuzz(seconds: int) -> None:
    """Fuzz in this process, which libFuzzer ends."""
    folder = Path(tempfile.mkdtemp())
    corpus = folder / "corpus"
    corpus.mkdir()
    for number, (name, (_, _, seeds)) in enumerate(READERS.items()):
        for i, content in enumerate(seeds()):
            call(name, content, folder)  # what it imports is not its time
            (corpus / f"{name}-{i}").write_bytes(bytes([number]) + content)
    warnings.simplefilter("ignore")  # numbers that overflow are no findings

    def one(content: bytes) -> None:
        if not content:
            return
        name = NAMES[content[0] % len(NAMES)]
        found = call(name, content[1:], folder)
        kept = FOUND / f"{name}-{found}"
        if found and not kept.exists():
            print(f"finding: {kept}", file=sys.stderr, flush=True)
            kept.write_bytes(content)

    bounds = ["-timeout=60", "-rss_limit_mb=4000", "-max_len=20000", f"-artifact_prefix={FOUND}/"]
    atheris.Setup([sys.argv[0], str(corpus), f"-max_total_time={seconds}", *bounds], one)
    atheris.Fuzz()


def main(given: str) -> int:
    """Fuzz for some seconds in a process of its own, or try one finding again; 1 where something was found."""
    FOUND.mkdir(parents=True, exist_ok=True)
    if not given.isdecimal():
        content = Path(given).read_bytes()
        found = call(NAMES[content[0] % len(NAMES)], content[1:], Path(tempfile.mkdtemp()))
        print(found or "nothing found")
        return int(found is not None)
    before = set(FOUND.iterdir())
    done = subprocess.run([sys.executable, __file__, "--child", given])
    found_now = sorted(set(FOUND.iterdir()) - before)
    print(f"{len(NAMES)} readers, {given} s: {', '.join(map(str, found_now)) or 'nothing found'}")
    return int(bool(found_now) or done.returncode != 0)


if __name__ == "__main__":
    if sys.argv[1] == "--child":
        fuzz(int(sys.argv[2]))
    sys.exit(main(sys.argv[1]))
