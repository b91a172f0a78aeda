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
from spgf_torch.baselines.checkpoints import read_tensors
from spgf_torch.baselines.config import BaselineConfig
from spgf_torch.baselines.data import Data
from spgf_torch.baselines.folds import MODEL, FoldLogits, calibrated, scores
from spgf_torch.baselines.pointnet import PointNet, grasp_logits
from spgf_torch.cache import Cache
from spgf_torch.experiment.costs import OBJECTS
from spgf_torch.experiment.describe import CachedSteps, Describer
from spgf_torch.formats.config import SamplesConfig
from spgf_torch.formats.samples import CHUNK, grasp_clouds


def costs(
    data: Data, logits: Mapping[int, FoldLogits], config: BaselineConfig, work: Path, reading: float
) -> dict[str, float]:
    """The block `costs` of `results.json`.

    Args:
        work: holds the networks of the folds; the first is measured.
        reading: s that the samples took to read, which with all epochs of all folds is the training.
    """
    first = min(logits)
    path = work / f"fold{first}" / MODEL
    network = PointNet(config.network, len(data.grasp_types), data.samples.radius, torch.Generator())
    network.load_state_dict(read_tensors(path))
    network = network.to(data.samples.cloud.device).eval()
    calibration, _ = calibrated(data, logits[first], config.N)
    return {
        "model_bytes": path.stat().st_size,
        "prediction_ms": prediction_ms(network, calibration, data),
        "training_s": reading + sum(each.seconds for each in logits.values()),
    }


def prediction_ms(network: PointNet, calibration: Calibration, data: Data) -> float:
    """Milliseconds from an object's texlets to the scores of all its tried grasps: the median over a few objects.

    Points about each grasp, sensed collisions and the network are counted; sensing is not.
    """
    alone = replace(data.describer, cache=Cache(None))
    chosen = range(0, len(data.objects), max(1, len(data.objects) // OBJECTS))
    return 1000 * median(_seconds(network, calibration, data, alone, i) for i in chosen)


def _seconds(network: PointNet, calibration: Calibration, data: Data, describer: Describer, i: int) -> float:
    samples, table, device = data.samples, data.tables[i], network.radius.device
    config = SamplesConfig(points=samples.cloud.shape[1], radius=samples.radius, per_shard=1)
    steps, rng = CachedSteps(describer, data.objects[i], table), np.random.default_rng(0)
    points, poses = steps.texlets.positions.numpy(), table.T_object_tcp.numpy()
    start = time.perf_counter()
    parts = [grasp_clouds(points, poses[k : k + CHUNK], config, rng) for k in range(0, len(poses), CHUNK)]
    cloud = torch.from_numpy(np.concatenate(parts)).to(device)
    logit = grasp_logits(network, cloud, table.grasp_type.to(device)).cpu()
    scores(logit, table.grasp_type, steps.collides, calibration)
    return time.perf_counter() - start
