"""From a cloud to ranked grasps with a model in memory: seconds, the stages' shares, and peak memory.

    python tests/benchmarks/prediction.py [model=FOLDER] [size=one|scene]

`one`: an object, 1500 texlets or so. `scene`: 100,000 points of many objects on a table, not cropped, the table found
and removed. Points lie on the surfaces of shipped objects, with the normals of their faces and 1 mm of noise. Each
size is measured in a process of its own, for the peak of memory, of which the model takes a part that is told.
"""

import spgf_torch  # before torch: it sets how torch's threads wait

# isort: split

import json
import resource
import subprocess
import sys
import time

import numpy as np
import torch
from shared.clouds import objects
from shared.harness import Report, threads

from spgf_torch.features.descriptors import descriptor
from spgf_torch.paths import find
from spgf_torch.scene.assembly import scene_of_clouds
from spgf_torch.scene.cloud import Cloud
from spgf_torch.scene.config import SceneConfig
from spgf_torch.settings import settings

DEFAULT, ROUNDS = "outputs/train/latest", 5
LIMITS = {"one": "<= 0.5 s on 2 cores", "scene": "<= 5 s, <= 2 GB"}
POINTS = {"one": 12_000, "scene": 100_000}
AREA = 0.06  # m2 of the one object: some 1500 texlets


def surface(number: int, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    mesh = objects()[number].mesh
    points, faces = mesh.sample(count, return_index=True, seed=int(rng.integers(2**31)))
    return points + rng.normal(0, 0.001, points.shape), mesh.face_normals[faces]


def scene(size: str, rng: np.random.Generator) -> Cloud:
    """One object, or thirty on a table of 1.6 by 1.4 m that has two fifths of the points."""
    if size == "one":
        number = min(range(30), key=lambda i: abs(objects()[i].mesh.area - AREA))
        return Cloud(*surface(number, POINTS[size], rng))
    table = np.hstack(
        [rng.uniform([-0.2, -0.2], [1.7, 1.4], (2 * POINTS[size] // 5, 2)), np.zeros((2 * POINTS[size] // 5, 1))]
    )
    parts = [(table, np.tile([0.0, 0.0, 1.0], (len(table), 1)))]
    areas = np.array([objects()[i].mesh.area for i in range(30)])
    counts = (areas / areas.sum() * (POINTS[size] - len(table))).astype(int)
    counts[0] += POINTS[size] - len(table) - counts.sum()
    for i, count in enumerate(counts):
        points, normals = surface(i, int(count), rng)
        lowest = objects()[i].mesh.bounds[0, 2]
        parts.append((points + np.array([0.3 * (i % 6), 0.3 * (i // 6), 0.001 - lowest]), normals))
    return Cloud(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def stages(predictor: "spgf_torch.predictor.Predictor", cloud: Cloud, size: str) -> dict[str, float]:
    """Seconds of each stage of one prediction, and how much it was of what."""
    taken, proposer = {}, predictor.proposer
    config = settings(SceneConfig, **({} if size == "one" else {"table": "find"}))
    busy, clock = time.process_time(), time.perf_counter()

    def lap(name: str) -> None:
        nonlocal clock
        taken[name], clock = time.perf_counter() - clock, time.perf_counter()

    found = scene_of_clouds([cloud], config, predictor.sensing, np.random.default_rng(0))
    lap("texlets")
    positions, normals = found.texlets.positions, found.texlets.normals
    generator = torch.Generator().manual_seed(0)
    features = descriptor(proposer.features)(positions, normals, proposer.features, generator)
    lap("features")
    proposals = proposer.propose_from(features, positions, predictor.surroundings(found))
    lap("proposals")
    grasps = predictor.grasps(proposals, 10)
    lap("grasps")
    return {
        **taken,
        "processor": time.process_time() - busy,
        "count_texlets": len(positions),
        "count_grasps": len(grasps),
    }


def measured(model: str, size: str) -> dict[str, float]:
    """In this process: medians over rounds, after one that is not counted."""
    predictor = spgf_torch.load(model)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    cloud = scene(size, np.random.default_rng(0))
    with threads(2):
        rounds = [stages(predictor, cloud, size) for _ in range(ROUNDS + 1)][1:]
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    median = {name: float(np.median([r[name] for r in rounds])) for name in rounds[0]}
    return {**median, "gb_loaded": before, "gb_peak": peak}


def main(words: dict[str, str]) -> None:
    model = words.get("model", DEFAULT)
    report = Report("prediction", " ".join(__doc__.split("\n\n")[2].split()))
    if not (find(model) / "model.safetensors").is_file():
        print(f"prediction: skipped: expected a trained model in {model}, found none: make train, or model=FOLDER")
        return
    report.devices()
    for size in [words["size"]] if "size" in words else list(POINTS):
        command = [sys.executable, __file__, f"model={model}", f"measure={size}"]
        found = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()[-1])
        laps = {name: found[name] for name in ("texlets", "features", "proposals", "grasps")}
        total = sum(laps.values())
        report.row(points=POINTS[size], **found, seconds=total)
        shares = ", ".join(f"{name} {value / total:.0%}" for name, value in laps.items())
        report.figure(
            f"predict, {POINTS[size]:,} points, {found['count_texlets']:.0f} texlets, 2 threads",
            LIMITS[size],
            f"{total:.2f} s (of processor: {found['processor']:.2f} s; {shares}); "
            f"peak {found['gb_peak']:.2f} GB, {found['gb_loaded']:.2f} with the model loaded",
        )
    report.write()


if __name__ == "__main__":
    given = dict(word.split("=", 1) for word in sys.argv[1:])
    if "measure" in given:
        print(json.dumps(measured(given["model"], given["measure"])))
    else:
        main(given)
