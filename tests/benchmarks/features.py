"""SPGF against Open3D's FPFH: the same clouds, normals, radius and threads, in turn.

    python tests/benchmarks/features.py [points ...]

The clouds are texlets as the package makes them (5 mm apart, some 50 to 90 within 3 cm). Larger clouds show more
objects side by side, so that the density stays what it is: 100,000 texlets are the fifty objects twice. Normals are
given to both. FPFH gets its points as Open3D wants them, in float64, before the clock starts. SPGF's time includes its
alignment and poses; FPFH has none.
"""

import spgf_torch  # noqa: F401  before torch: it sets how torch's threads wait

# isort: split

import sys
from functools import partial

from shared.clouds import cloud
from shared.harness import Report, take_turns, threads

from spgf_torch.config import FeatureConfig, settings
from spgf_torch.features.spgf import spgf
from spgf_torch.geometry.neighbours import radius_pairs

SIZES = (1_000, 2_000, 4_000, 20_000, 100_000)
ASKED = {1_000: 3.0, 2_000: 3.0, 4_000: 3.0, 20_000: 1.5, 100_000: 1.5}


def main(sizes: list[int]) -> None:
    report = Report("features", __doc__.split("\n\n")[0] + " " + __doc__.split("\n\n")[2].replace("\n", " "))
    open3d = report.peer("open3d", "open3d-cpu")
    config = settings(FeatureConfig)
    devices = report.devices()
    ratios: dict[tuple[int, int], float] = {}
    for size in sizes:
        positions, normals = cloud(size)
        neighbours = len(radius_pairs(positions, config.radius)[0]) / size
        methods = {device: partial(spgf, positions.to(device), normals.to(device), config) for device in devices}
        if open3d:
            points = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(positions.double().numpy()))
            points.normals = open3d.utility.Vector3dVector(normals.double().numpy())
            search = open3d.geometry.KDTreeSearchParamRadius(config.radius)
            methods["FPFH"] = partial(open3d.pipelines.registration.compute_fpfh_feature, points, search)
        for count in (1, 2):
            with threads(count):
                seconds = take_turns(methods, rounds=max(3, min(21, 60_000 // size)))
            ratio = seconds["FPFH"] / seconds["cpu"] if open3d else float("nan")
            ratios[size, count] = ratio
            per_second = {f"features_per_s_{name}": round(size / value) for name, value in seconds.items()}
            report.row(points=size, neighbours=round(neighbours), threads=count, **per_second, ratio=ratio)
    for size in sizes if open3d else []:
        report.figure(
            f"SPGF features/s over Open3D's FPFH, {size:,} points, 1 / 2 threads",
            f">= {ASKED.get(size, 1.5):g}",
            " / ".join(f"{ratios[size, count]:.2f}" for count in (1, 2)),
        )
    report.write()


if __name__ == "__main__":
    main([int(word) for word in sys.argv[1:]] or list(SIZES))
