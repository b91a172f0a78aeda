"""What stands between ours and Contact-GraspNet: files, its calls of torch_cluster, a process that serves."""

import sys

import numpy as np
import pytest
import torch

from spgf_torch.clearing import contact_graspnet, point_clusters
from spgf_torch.clearing.contact_graspnet import ContactGraspNet, Raw
from spgf_torch.errors import InputError


def points(count, seed=0):
    """On a coarse lattice, so that many distances are equal."""
    return torch.randint(0, 12, (count, 3), generator=torch.Generator().manual_seed(seed)).float() / 8


def test_furthest_points_are_those_of_a_slow_loop():
    cloud = points(300)
    chosen = [0]
    while len(chosen) < 64:
        nearest = ((cloud[:, None] - cloud[chosen]) ** 2).sum(2).amin(1).numpy()
        chosen.append(int(np.argmax(nearest)))  # the first of equals
    batch = torch.zeros(300, dtype=torch.int64)
    assert point_clusters.fps(cloud, batch, 64 / 300, random_start=False).tolist() == chosen


def test_the_network_gets_as_many_contacts_as_it_was_trained_with():
    assert len(point_clusters.fps(torch.zeros(20_000, 3), ratio=2048 / 20_000)) == 2048


def test_balls_hold_the_points_of_lowest_index_nearer_than_the_radius():
    x, y = points(200), points(50, seed=1)
    inside = ((y[:, None] - x) ** 2).sum(2) < 0.25  # 1/2 is a distance of the lattice: points at it are outside
    expected = [(i, j) for i in range(50) for j in inside[i].nonzero()[:8, 0].tolist()]
    assert (inside.sum(1) > 8).any() and (((y[:, None] - x) ** 2).sum(2) == 0.25).any()
    assert point_clusters.radius(x, y, 0.5, max_num_neighbors=8).T.tolist() == [list(pair) for pair in expected]


def test_neighbours_come_nearest_first():
    x, y = torch.rand(40, 3), torch.rand(9, 3)
    row, column = point_clusters.knn(x, y, 3)
    assert row.tolist() == [i for i in range(9) for _ in range(3)]
    assert torch.equal(column.view(9, 3), torch.cdist(y, x).topk(3, largest=False).indices)


def test_several_examples_are_refused():
    with pytest.raises(NotImplementedError, match="one example"):
        point_clusters.fps(points(4), torch.tensor([0, 0, 1, 1]), 0.5)


def test_clouds_and_grasps_go_through_files(tmp_path):
    clouds = [Raw(np.full((n, 3), n, np.float32), np.arange(n) < 2) for n in (3, 5)]
    contact_graspnet.write_clouds(tmp_path / "clouds.npz", clouds, [7, 8])
    with np.load(tmp_path / "clouds.npz") as written:
        assert written["counts"].tolist() == [3, 5] and written["seeds"].tolist() == [7, 8]
        assert written["points"][:, 0].tolist() == [3] * 3 + [5] * 5 and written["on_object"].sum() == 4
    T = np.tile(np.eye(4), (3, 1, 1))
    T[2, :3, :3] = [[0, 0, 1], [1, 0, 0], [0, 1, 0]]  # the approach along x
    numbers = {"confidence": np.array([0.9, 0.2, 0.5]), "counts": np.array([2, 0, 1]), "seconds": np.arange(3.0)}
    np.savez(tmp_path / "grasps.npz", T_base=T, **numbers)
    first, none, last = contact_graspnet.read_grasps(tmp_path / "grasps.npz")
    assert [len(its.T) for its in (first, none, last)] == [2, 0, 1] and last.seconds == 2
    assert first.T[0, :3, 3].tolist() == pytest.approx([0, 0, 0.1034])  # the TCP is further along the approach
    assert last.T[0, :3, 3].tolist() == pytest.approx([0.1034, 0, 0]) and last.confidence.tolist() == [0.5]


def test_a_python_without_the_network_is_told_in_one_line(tmp_path):
    for python, got in (
        (tmp_path / "none", "No such file"),
        (tmp_path, "Permission denied"),
        ("/bin/false", "status 1"),
    ):
        with pytest.raises(InputError, match=f"cgn-pytorch.*{got}") as error:
            ContactGraspNet.of(str(python))
        assert "\n" not in str(error.value)


def test_the_cube_is_twice_the_object_within_bounds():
    grid = np.linspace(-0.5, 0.5, 101)[:, None] * [1.0, 0.0, 0.0]
    for width, side in ((0.02, 0.2), (0.15, 0.3), (0.5, 0.6)):
        near = grid[contact_graspnet.in_cube(grid, np.array([[-width / 2, 0, 0], [width / 2, 0.01, 0.01]]))]
        assert np.ptp(near[:, 0]) == pytest.approx(side, abs=0.0101)


SERVES = """#!{python}
import shutil, sys
while sys.stdin.readline():
    got = sys.stdin.readline().strip()
    if {dies}:
        sys.exit(3)
    shutil.copy({answer!r}, got)
    print("answered", flush=True)
"""


@pytest.mark.parametrize("dies", [False, True])
def test_a_process_serves_one_cloud_after_the_other(dies, tmp_path):
    T = np.tile(np.eye(4), (2, 1, 1))
    numbers = {"confidence": np.array([0.9, 0.2]), "counts": np.array([2]), "seconds": np.array([0.5])}
    np.savez(tmp_path / "answer.npz", T_base=T, **numbers)
    python = tmp_path / "python"
    python.write_text(SERVES.format(python=sys.executable, dies=dies, answer=str(tmp_path / "answer.npz")))
    python.chmod(0o755)
    served = ContactGraspNet(python).serving()
    cloud = Raw(np.zeros((3, 3), np.float32), np.ones(3, bool))
    if dies:
        with pytest.raises(InputError, match=r"cgn-pytorch.*got exit status 3"):
            served.grasps(cloud, 0)
    else:
        found = [served.grasps(cloud, seed) for seed in (1, 2)]
        assert [its.confidence.tolist() for its in found] == [pytest.approx([0.9, 0.2])] * 2 and found[1].seconds == 0.5
    served.end()
