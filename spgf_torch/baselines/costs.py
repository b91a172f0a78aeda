"""What a network costs: bytes, seconds of training, and the time of a prediction, as of a model of `train`."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from statistics import median

import numpy as np
import torch

from spgf_torch.affordance.calibration import Calibration
from spgf_torch.baselines.config import BaselineConfig
from spgf_torch.baselines.data import Data
from spgf_torch.baselines.folds import MODEL, Judged, calibrated, scores
from spgf_torch.baselines.kept import read_tensors
from spgf_torch.baselines.pointnet import PointNet, judge
from spgf_torch.cache import Cache
from spgf_torch.experiment.costs import OBJECTS
from spgf_torch.experiment.describe import Description, Steps
from spgf_torch.formats.config import SamplesConfig
from spgf_torch.formats.samples import CHUNK, grasp_clouds


def costs(
    data: Data, judged: Mapping[int, Judged], config: BaselineConfig, work: Path, reading: float
) -> dict[str, float]:
    """The block `costs` of `results.json`.

    Args:
        work: holds the networks of the folds; the first is measured.
        reading: s that the samples took to read, which with all epochs of all folds is the training.
    """
    first = min(judged)
    path = work / f"fold{first}" / MODEL
    network = PointNet(config.network, data.samples.radius, torch.Generator())
    network.load_state_dict(read_tensors(path))
    network = network.to(data.samples.cloud.device).eval()
    calibration, _ = calibrated(data, judged[first], config.N)
    return {
        "model_bytes": path.stat().st_size,
        "prediction_ms": prediction_ms(network, calibration, data),
        "training_s": reading + sum(each.seconds for each in judged.values()),
    }


def prediction_ms(network: PointNet, calibration: Calibration, data: Data) -> float:
    """Milliseconds from an object's texlets to the scores of all its tried grasps: the median over a few objects.

    Points about each grasp, sensed collisions and the network are counted; sensing is not.
    """
    alone = replace(data.describe, cache=Cache(None))
    chosen = range(0, len(data.objects), max(1, len(data.objects) // OBJECTS))
    return 1000 * median(_seconds(network, calibration, data, alone, i) for i in chosen)


def _seconds(network: PointNet, calibration: Calibration, data: Data, describe: Description, i: int) -> float:
    samples, grasps, device = data.samples, data.tried[i].grasps, network.radius.device
    config = SamplesConfig(points=samples.cloud.shape[1], radius=samples.radius, per_shard=1)
    steps, rng = Steps(describe, data.objects[i], grasps), np.random.default_rng(0)
    points, poses = steps.texlets.positions.numpy(), grasps.T_object_tcp.numpy()
    start = time.perf_counter()
    parts = [grasp_clouds(points, poses[k : k + CHUNK], config, rng) for k in range(0, len(poses), CHUNK)]
    cloud = torch.from_numpy(np.concatenate(parts)).to(device)
    logit = judge(network, cloud, grasps.grasp_type.to(device)).cpu()
    scores(logit, grasps.grasp_type, steps.collides, calibration)
    return time.perf_counter() - start
