"""Six objects with forty trials each, whose clouds tell how they ended: a grasp holds where some points are far off."""

import json
from pathlib import Path

import numpy as np
import torch
import trimesh
from trial_tables import trial_table

from spgf_torch.affordance.config import AffordanceConfig
from spgf_torch.affordance.sensed_collision import hand_volume
from spgf_torch.baselines.config import AugmentConfig, BaselineConfig, LearningConfig, NetworkConfig
from spgf_torch.baselines.data import Data, taught_rows
from spgf_torch.baselines.samples import load_samples
from spgf_torch.evaluation.folds import stratified_folds
from spgf_torch.experiment.describe import Describer
from spgf_torch.features.config import FeatureConfig
from spgf_torch.formats import tar
from spgf_torch.formats.samples import shard_name
from spgf_torch.geometry import se3
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.settings import settings
from spgf_torch.simulation.table import TrialTable

CLASSES = ("boxes", "boxes", "boxes", "curved", "curved", "curved")
TRIALS, POINTS, RADIUS, FOLDS = 40, 12, 0.1, 2
NETWORK = NetworkConfig(frequencies=1, widths=[16, 16], head=[8])
AUGMENT = AugmentConfig(points=8, mirror=True, rotation_deg=3.0, shift=0.002, jitter=0.001)
VOLUMES = {kind: hand_volume([trimesh.creation.box((0.01, 0.01, 0.01))]) for kind in ("NPG", "WPG")}


def learning(**changes: float) -> LearningConfig:
    values = {
        "grasps_per_epoch": 64,
        "epochs": 4,
        "patience": 4,
        "batch_size": 32,
        "rate": 0.01,
        "weight_decay": 0.01,
        "inner_share": 0.34,
        "inner_grasps": 30,
    }
    return LearningConfig(**{**values, **changes})


def config(**changes: float) -> BaselineConfig:
    return BaselineConfig(N=5, folds=FOLDS, seed=0, network=NETWORK, augment=AUGMENT, learning=learning(**changes))


def objects() -> list[GraspObject]:
    made = []
    for i, category in enumerate(CLASSES):
        mesh = trimesh.creation.box((0.04 + 0.005 * i, 0.05, 0.06))
        parts = (mesh.vertices,)
        made.append(GraspObject(f"thing_{i}", category, mesh, parts, 0.2, mesh.center_mass, mesh.moment_inertia))
    return made


def clouds(held: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(G, POINTS, 3) f32: all points 2 cm off, but where `held` (G,) a third of them 8 cm off."""
    directions = rng.normal(size=(len(held), POINTS, 3))
    distance = np.full((len(held), POINTS), 0.02)
    distance[held, : POINTS // 3] = 0.08
    return (directions / np.linalg.norm(directions, axis=2, keepdims=True) * distance[..., None]).astype(np.float32)


def tiny(folder: Path, trials_per_object: int = 1000) -> Data:
    """Everything that a cross-validation needs; the shards are in `folder`."""
    rng, things = np.random.default_rng(0), objects()
    fold = stratified_folds(CLASSES, FOLDS, 0)
    grasp_type = torch.arange(2).repeat_interleave(TRIALS // 2)
    tables, all_clouds = [], []
    for i in range(len(things)):
        held = rng.random(TRIALS) < np.where(grasp_type.numpy() == 0, 0.2, 0.5)
        poses = se3.random_poses(TRIALS, torch.Generator().manual_seed(i), extent=0.1)
        tables.append(trial_table(poses, grasp_type, torch.from_numpy(np.where(held, 0, 3))))
        all_clouds.append(clouds(held, rng))
    for f in range(FOLDS):
        write_shards(folder, f, [i for i in range(len(things)) if fold[i] == f], things, tables, all_clouds)
    shards = sorted(folder.glob("*.tar"))
    samples = load_samples(shards, RADIUS, things, tables, fold, lambda done: None)
    sensing = settings(SensingConfig, width=160, height=120, focal=144)
    describer = Describer(sensing, settings(FeatureConfig), settings(AffordanceConfig), VOLUMES, 0)
    collides = [torch.zeros(TRIALS, dtype=torch.bool) for _ in things]
    taught = taught_rows(tables, samples.start, trials_per_object, 0)
    return Data(things, tables, fold, collides, samples, taught, torch.ones(2, dtype=torch.bool), describer)


def write_shards(
    folder: Path,
    fold: int,
    members: list[int],
    things: list[GraspObject],
    tables: list[TrialTable],
    all_clouds: list[np.ndarray],
) -> None:
    """The samples of a fold in two shards, in random order, as `datasets.samples` writes them."""
    folder.mkdir(exist_ok=True)
    pairs = [(i, row) for i in members for row in range(TRIALS)]
    order = np.random.default_rng(fold).permutation(len(pairs))
    for number, half in enumerate(np.array_split(order, 2)):
        with tar.written(folder / shard_name(fold, number)) as shard:
            for i, row in (pairs[at] for at in half):
                held, kind = bool(tables[i].success[row]), tables[i].grasp_types[int(tables[i].grasp_type[row])]
                about = {"type": kind, "label": int(held), "outcome": "success" if held else "missed"}
                about |= {"object": things[i].name, "class": things[i].category, "fold": fold, "index": row}
                buffer = folder / "buffer.npy"
                np.save(buffer, all_clouds[i][row])
                key = f"{things[i].name}_{kind}_{row}"
                tar.add(shard, f"{key}.cloud.npy", buffer.read_bytes())
                tar.add(shard, f"{key}.json", json.dumps(about).encode())
                buffer.unlink()
