"""Contact-GraspNet on clouds from a file, in the Python environment that has it; `contact_graspnet` starts it.

    PYTHON cgn_worker.py                    # whether it runs here
    PYTHON cgn_worker.py CLOUDS.npz GRASPS.npz
    PYTHON cgn_worker.py serve              # CLOUDS.npz and GRASPS.npz, a line each, again and again; answers a line

It imports nothing of ours but `point_clusters`, which takes the place of torch_cluster. The network is called directly:
the wheel's own `inference` clamps its widths to half the hand's and builds its poses in a loop in Python.
"""

import sys
import time

import numpy as np
import point_clusters
import torch

sys.modules["torch_cluster"] = point_clusters

import cgn_pytorch  # noqa: E402  # finds torch_cluster when it is imported
from torch_geometric.nn import fps  # noqa: E402

POINTS, CONTACTS = 20_000, 2048  # what the network was trained with
DEPTH = 0.1034  # m from the hand's base to its TCP
WIDTH = 0.16  # the network clamps widths to half of it: 80 mm, the whole stroke


def network() -> torch.nn.Module:
    """With the weights that come with the wheel; they are a pickle, so as trusted as its code."""
    load = torch.load
    torch.load = lambda *given, **options: load(*given, **options, weights_only=False)
    try:
        net, _, _ = cgn_pytorch.from_pretrained(device="cpu")
    finally:
        torch.load = load
    net.build_6d_grasps = poses
    return net.eval()


def poses(
    contacts: torch.Tensor,
    closing: torch.Tensor,
    approach: torch.Tensor,
    width: torch.Tensor,
    gripper_depth: float,
    width_labels: object = None,
) -> torch.Tensor:
    """(G, 4, 4) of the hand's base, +z the approach and +x from the contact (G, 3) to the other side.

    As `CGN.build_6d_grasps`, all at once.
    """
    x = torch.nn.functional.normalize(closing, dim=1)
    z = torch.nn.functional.normalize(approach - (x * approach).sum(1, keepdim=True) * x, dim=1)
    T = torch.eye(4).repeat(len(contacts), 1, 1)
    T[:, :3, :3] = torch.stack([x, torch.linalg.cross(z, x), z], dim=2)
    T[:, :3, 3] = contacts - gripper_depth * z + width / 2 * x
    return T


@torch.no_grad()
def predict(net: torch.nn.Module, points: np.ndarray, on_object: np.ndarray, seed: int) -> tuple:
    """T_base (G, 4, 4) and confidence (G,) of the contacts on the object, the most confident first; frame of points.

    `POINTS` of the points (N, 3) at random, of fewer some twice; about their mean.
    """
    rng = np.random.default_rng(seed)
    torch.manual_seed(seed)
    some = rng.permutation(len(points))[:POINTS]
    some = np.concatenate([some, rng.integers(0, len(points), POINTS - len(some))])
    middle = points[some].mean(axis=0, dtype=np.float64)
    cloud = torch.from_numpy((points[some] - middle).astype(np.float32))
    batch = torch.zeros(POINTS, dtype=torch.int64)
    contacts = fps(cloud, batch, CONTACTS / POINTS)
    found = net(cloud[:, 3:], pcd_poses=cloud, batch=batch, idxs=contacts, gripper_depth=DEPTH, gripper_width=WIDTH)
    T, confidence = found[1][0].double().numpy(), torch.sigmoid(found[2][0]).numpy()
    T[:, :3, 3] += middle
    order = np.argsort(-confidence, kind="stable")
    order = order[on_object[some[contacts.numpy()]][order]]
    return T[order], confidence[order]


def answer(net: torch.nn.Module, given: str, got: str, warm: bool) -> None:
    """Write the grasps of each cloud in the file `given` to the file `got`; `warm`: the network has been called."""
    with np.load(given) as arrays:
        points, on_object, seeds = arrays["points"], arrays["on_object"], arrays["seeds"]
        ends = arrays["counts"].cumsum()[:-1]
    clouds = list(zip(np.split(points, ends), np.split(on_object, ends), seeds.tolist(), strict=True))
    if not warm:
        predict(net, *clouds[0])  # compiled
    found, seconds = [], []
    for cloud in clouds:
        start = time.process_time()
        found.append(predict(net, *cloud))
        seconds.append(time.process_time() - start)
    T, confidence = (np.concatenate(parts) for parts in zip(*found, strict=True))
    counts = np.array([len(its) for _, its in found])
    np.savez(got, T_base=T, confidence=confidence, counts=counts, seconds=np.array(seconds))


def main() -> None:
    torch.set_num_threads(1)
    answers, sys.stdout = sys.stdout, sys.stderr  # what the network prints is no answer
    net = network()
    if sys.argv[1:] == ["serve"]:
        warm = False
        while given := sys.stdin.readline().rstrip("\n"):
            answer(net, given, sys.stdin.readline().rstrip("\n"), warm)
            warm = True
            print("answered", file=answers, flush=True)
    elif len(sys.argv) == 3:
        answer(net, sys.argv[1], sys.argv[2], False)


if __name__ == "__main__":
    main()
