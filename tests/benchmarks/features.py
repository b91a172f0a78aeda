"""SPGF against Open3D's FPFH: the same clouds, normals, radius and threads, in turn.

    python tests/benchmarks/features.py [points ...]

The clouds are texlets as the package makes them (5 mm apart, some 50 to 90 within 3 cm). Larger clouds show more
objects side by side, so that the density stays what it is: 100,000 texlets are the fifty objects twice. Normals are
given to both. FPFH gets its points as Open3D wants them, in float64, before the clock starts. SPGF's time includes its
alignment and poses; FPFH has none. Each number of threads has a process of its own.
"""

import spgf_torch  # noqa: F401  before torch: it sets how torch's threads wait

# isort: split

import sys
from functools import partial

import torch
from shared.clouds import cloud
from shared.harness import Report, in_process, take_turns, threads

from spgf_torch.features.config import FeatureConfig
from spgf_torch.features.spgf import spgf
from spgf_torch.ops.neighbours import radius_pairs
from spgf_torch.settings import settings

SIZES = (1_000, 2_000, 4_000, 20_000, 100_000)
ASKED = {1_000: 3.0, 2_000: 3.0, 4_000: 3.0, 20_000: 1.5, 100_000: 1.5}


def seconds(size: int, peer: bool) -> tuple[int, dict[str, float]]:
    """Neighbours of a point, and seconds of each method, in a process whose threads are set."""
    positions, normals = cloud(size)
    config, count = settings(FeatureConfig), torch.get_num_threads()
    neighbours = len(radius_pairs(positions, config.radius)[0]) // size
    methods = {"SPGF": partial(spgf, positions, normals, config)}
    if peer:
        import open3d

        points = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(positions.double().numpy()))
        points.normals = open3d.utility.Vector3dVector(normals.double().numpy())
        search = open3d.geometry.KDTreeSearchParamRadius(config.radius)
        methods["FPFH"] = partial(open3d.pipelines.registration.compute_fpfh_feature, points, search)
    with threads(count):
        return neighbours, take_turns(methods, rounds=max(3, min(41, 60_000 // size)))


def main(sizes: list[int]) -> None:
    report = Report("features", __doc__.split("\n\n")[0] + " " + __doc__.split("\n\n")[2].replace("\n", " "))
    open3d = report.peer("open3d", "open3d-cpu")
    report.skip("device=cuda: SPGF is computed on the CPU")
    ratios: dict[tuple[int, int], float] = {}
    for size in sizes:
        for count in (1, 2):
            neighbours, taken = in_process(count, seconds, size, open3d is not None)
            ratio = taken["FPFH"] / taken["SPGF"] if open3d else float("nan")
            ratios[size, count] = ratio
            per_second = {f"features_per_s_{name}": round(size / value) for name, value in taken.items()}
            report.row(points=size, neighbours=neighbours, threads=count, **per_second, ratio=ratio)
    for size in sizes if open3d else []:
        report.figure(
            f"SPGF features/s over Open3D's FPFH, {size:,} points, 1 / 2 threads",
            f">= {ASKED.get(size, 1.5):g}",
            " / ".join(f"{ratios[size, count]:.2f}" for count in (1, 2)),
        )
    report.write()


if __name__ == "__main__":
    main([int(word) for word in sys.argv[1:]] or list(SIZES))
