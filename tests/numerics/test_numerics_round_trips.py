"""Whatever is written is read back: files and poses, for values that hypothesis picks."""

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import torch
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from spgf_torch.geometry import se3
from spgf_torch.scene.cloud import Cloud, voxel_means
from spgf_torch.scene.config import SceneConfig
from spgf_torch.scene.files import read_cloud
from spgf_torch.scene.intrinsics import read_intrinsics
from spgf_torch.scene.normals import neighbourhoods
from spgf_torch.scene.planes import height
from spgf_torch.scene.poses import read_poses
from spgf_torch.scene.support_plane import find_plane
from spgf_torch.settings import settings as room
from spgf_torch.simulation.table import KEY, Provenance, TrialTable, read_table, write_table

FEW = settings(max_examples=15, deadline=None, derandomize=True, database=None)
metres = st.floats(-5, 5, allow_subnormal=False)
points = st.integers(1, 12).flatmap(lambda n: arrays(np.float64, (n, 3), elements=metres))
quaternions = (
    arrays(np.float64, 4, elements=st.floats(-1, 1, allow_subnormal=False))
    .filter(lambda q: np.linalg.norm(q) > 0.1)
    .map(lambda q: q / np.linalg.norm(q))
)
positions = arrays(np.float64, 3, elements=metres)


def pose_of(position: np.ndarray, quaternion: np.ndarray) -> torch.Tensor:
    return se3.pose(torch.from_numpy(position), torch.from_numpy(quaternion))


def pcd(cloud: np.ndarray, kind: str) -> bytes:
    n = len(cloud)
    head = f"FIELDS x y z\nSIZE 8 8 8\nTYPE F F F\nWIDTH {n}\nHEIGHT 1\nPOINTS {n}\nDATA {kind}\n"
    rows = "\n".join(" ".join(map(repr, row)) for row in cloud.tolist()).encode()
    return head.encode() + (rows if kind == "ascii" else cloud.astype("<f8").tobytes())


@pytest.mark.parametrize("suffix", ["xyz", "csv", "npy", "npz", "ply", "pcd", "binary.pcd"])
@FEW
@given(cloud=points)
def test_clouds(suffix: str, cloud: np.ndarray) -> None:
    cloud = np.where((np.abs(cloud) < 1e-30).all(axis=1, keepdims=True), 1.0, cloud)  # 0 0 0 is no reading
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, f"a.{suffix}")
        if suffix in ("xyz", "csv"):
            np.savetxt(path, cloud, delimiter="," if suffix == "csv" else " ", fmt="%.17g")
        elif suffix == "npy":
            np.save(path, cloud)
        elif suffix == "npz":
            np.savez_compressed(path, points=cloud)
        elif suffix == "ply":
            trimesh.PointCloud(cloud).export(path)
        else:
            path.write_bytes(pcd(cloud, "binary" if "binary" in suffix else "ascii"))
        read = read_cloud(path, 100).points
    np.testing.assert_allclose(read, cloud, atol=1e-6 if suffix == "ply" else 0)


@FEW
@given(focal=st.tuples(*[st.floats(10, 5000)] * 2), middle=st.tuples(*[st.floats(0, 4000)] * 2))
def test_intrinsics(focal: tuple[float, float], middle: tuple[float, float]) -> None:
    K = np.array([[focal[0], 0, middle[0]], [0, focal[1], middle[1]], [0, 0, 1]])
    numbers = ", ".join(map(repr, K.ravel().tolist()))
    ros = f"camera_matrix: {{rows: 3, cols: 3, data: [{numbers}]}}\n"
    texts = {"a.json": f'{{"K": [{numbers}]}}', "a.yaml": ros, "a.txt": numbers.replace(", ", " ")}
    with tempfile.TemporaryDirectory() as folder:
        for name, text in texts.items():
            Path(folder, name).write_text(text)
            np.testing.assert_array_equal(read_intrinsics(Path(folder, name)).K, K)


@FEW
@given(position=positions, quaternion=quaternions)
def test_poses(position: np.ndarray, quaternion: np.ndarray) -> None:
    """Position and quaternion come back; the inverse of the inverse is itself; files hold them to the last digit."""
    T = pose_of(position, quaternion)
    sign = np.sign(quaternion[np.abs(quaternion) > 1e-9][0]) if abs(quaternion[0]) < 1e-9 else np.sign(quaternion[0])
    np.testing.assert_allclose(se3.position_of(T), position)
    back = se3.quaternion_of(T).numpy()
    assert min(np.abs(back - s * quaternion).max() for s in (sign, -sign)) < 1e-7
    np.testing.assert_allclose(se3.inverse(se3.inverse(T)), T, atol=1e-12)
    np.testing.assert_allclose(T @ se3.inverse(T), np.eye(4), atol=1e-12)
    with tempfile.TemporaryDirectory() as folder:
        np.save(Path(folder, "T.npy"), T.numpy())
        Path(folder, "T.json").write_text(repr(T.tolist()))
        for name in ("T.npy", "T.json"):
            np.testing.assert_array_equal(read_poses([Path(folder, name)])[0][0], T.numpy())


@FEW
@given(position=positions, quaternion=quaternions, cloud=points)
def test_float32_poses_move_points_as_float64_does(
    position: np.ndarray, quaternion: np.ndarray, cloud: np.ndarray
) -> None:
    """Within a few roundings of the largest number: 10 m is 1e-6 m."""
    T, p = pose_of(position, quaternion), torch.from_numpy(cloud)
    single = se3.transform_points(T.float(), p.float())
    torch.testing.assert_close(single.double(), se3.transform_points(T, p), atol=2e-5, rtol=0)


@FEW
@given(
    rows=st.integers(1, 6),
    seed=st.integers(0, 2**31 - 1),
    name=st.text("abcXYZ019_-", min_size=1, max_size=20),
)
def test_trial_tables(rows: int, seed: int, name: str) -> None:
    """Bits in, bits out; and what is read and written again is the same table."""
    generator = torch.Generator().manual_seed(seed)
    T = se3.random_poses(2 * rows, generator)
    provenance = Provenance(name, "0" * 64, "1" * 64, {"jitter": 0.1}, {"dt": 0.002}, rows, seed)
    outcome = torch.randint(6, (2 * rows,), generator=generator)
    poses, types = (se3.position_of(T), se3.quaternion_of(T)), torch.arange(2 * rows) % 2
    made = TrialTable(provenance, *poses, types, outcome, {"sapien": "3"}, ("NPG", "WPG"))
    with tempfile.TemporaryDirectory() as folder:
        first, second = Path(folder, "a.parquet"), Path(folder, "b.parquet")
        write_table(first, made)
        read = read_table(first)
        write_table(second, read)
        assert pq.read_table(first).equals(pq.read_table(second), check_metadata=True)
    assert read.provenance == provenance and read.versions == made.versions
    for field in ("position", "quaternion", "grasp_type", "outcome"):
        assert torch.equal(getattr(read, field), getattr(made, field)), field


@FEW
@given(cloud=points, position=positions, quaternion=quaternions, seed=st.integers(0, 1000))
def test_voxels_hold_all_points(cloud: np.ndarray, position: np.ndarray, quaternion: np.ndarray, seed: int) -> None:
    """Means lie within the points' bounds, are no more than points, and do not depend on the points' order."""
    means = voxel_means(Cloud(cloud), 0.5).points
    assert 1 <= len(means) <= len(cloud)
    assert (means >= cloud.min(0) - 1e-9).all() and (means <= cloud.max(0) + 1e-9).all()
    other = voxel_means(Cloud(cloud[np.random.default_rng(seed).permutation(len(cloud))]), 0.5).points
    assert len(other) == len(means)


@FEW
@given(position=positions, quaternion=quaternions)
def test_the_table_is_found_in_any_frame(position: np.ndarray, quaternion: np.ndarray) -> None:
    """A square of 0.5 m with a pile on it: the same plane, turned, the pile above."""
    rng = np.random.default_rng(0)
    flat = np.column_stack([rng.uniform(-0.25, 0.25, (300, 2)), rng.normal(0, 0.001, 300)])
    pile = rng.uniform(-0.04, 0.04, (60, 3)) + np.array([0, 0, 0.08])
    T = pose_of(position, quaternion).numpy()
    scene = np.concatenate([flat, pile]) @ T[:3, :3].T + T[:3, 3]
    plane = find_plane(scene, None, room(SceneConfig), np.random.default_rng(0))
    np.testing.assert_allclose(plane[:3], T[:3, 2], atol=0.02)
    assert (height(scene[300:], plane) > 0.03).all()


@FEW
@given(cloud=points)
def test_neighbours_of_few_points(cloud: np.ndarray) -> None:
    """Everyone's own index stands in for neighbours that are not there."""
    index, pitch = neighbourhoods(cloud, 6, 1.0)
    assert index.shape == (len(cloud), 6) and (index >= 0).all() and (index < len(cloud)).all() and 0 <= pitch <= 1.0


def test_a_table_in_other_columns_order_is_the_same(tmp_path: Path) -> None:
    T = se3.random_poses(4, torch.Generator().manual_seed(0))
    provenance = Provenance("a", "0", "1", {}, {}, 2, 0)
    made = TrialTable(
        provenance, se3.position_of(T), se3.quaternion_of(T), torch.arange(4) % 2, torch.arange(4), {}, ("NPG", "WPG")
    )
    write_table(tmp_path / "a.parquet", made)
    table = pq.read_table(tmp_path / "a.parquet")
    unsealed = {KEY: table.schema.metadata[KEY]}
    turned = table.select(table.column_names[::-1]).replace_schema_metadata(unsealed)
    pq.write_table(turned, tmp_path / "b.parquet")
    read = read_table(tmp_path / "b.parquet")
    assert torch.equal(read.T_object_tcp, made.T_object_tcp) and torch.equal(read.outcome, replace(made).outcome)
