"""Small models, hands and features that the tests of proposals share."""

import torch
import trimesh

from spgf_torch.affordance.config import AffordanceConfig
from spgf_torch.affordance.model import GraspModel, learn
from spgf_torch.affordance.pairs import cell_pairs
from spgf_torch.affordance.sensed_collision import HandVolume, hand_volume
from spgf_torch.features.config import FeatureConfig
from spgf_torch.features.spgf import Features
from spgf_torch.geometry import se3
from spgf_torch.proposing.config import ProposingConfig
from spgf_torch.settings import plain, settings

AFFORDANCE = settings(AffordanceConfig, reach=0.06, rotation_deg=45, kernel=0, kernel_deg=0, min_support=1)
CONFIG = settings(
    ProposingConfig,
    point_support=1,
    proposing_features=10,
    coarse_voters=8,
    hypotheses=60,
    survivors=20,
    refined=5,
    probability_weight=0,
)
SETTINGS = {"hand": {"name": "claw"}, "affordance": plain(AFFORDANCE), "features": plain(settings(FeatureConfig))}


def two_fingers(opening: float) -> HandVolume:
    """A hand of two fingers 10 mm thick, 20 mm wide, from z = -40 to 10 mm, `opening` apart."""
    sides = [trimesh.creation.box((0.01, 0.02, 0.05)) for _ in range(2)]
    for sign, box in zip((-1, 1), sides, strict=True):
        box.apply_translation((sign * (opening / 2 + 0.005), 0, -0.015))
    return hand_volume(sides)


VOLUMES = {"NPG": two_fingers(0.02), "WPG": two_fingers(0.05)}


def centres(count: int) -> torch.Tensor:
    """(count, 144) f32 prototypes."""
    return torch.rand(count, 144, generator=torch.Generator().manual_seed(7))


def features_of(T: torch.Tensor, prototype: torch.Tensor, prototypes: torch.Tensor) -> Features:
    """Features at T (F, 4, 4) that look exactly like their prototypes."""
    rings = prototypes[prototype].view(-1, 2, 36, 2)
    return Features(T, rings, torch.ones(len(T), dtype=torch.bool))


def patches(count: int, generator: torch.Generator) -> torch.Tensor:
    """Poses (count, 4, 4) f64 within a few centimetres."""
    return se3.random_poses(count, generator, extent=0.03).double()


def learned(generator: torch.Generator, prototypes: int = 3) -> GraspModel:
    """A model of one object of 40 features and 200 grasps, half of which succeeded."""
    grasps = se3.random_poses(200, generator, extent=0.03)
    pairs = cell_pairs(patches(40, generator).float(), grasps, torch.arange(200) % 2, AFFORDANCE)
    ids = torch.randint(prototypes, (40,), generator=generator)
    success = torch.rand(200, generator=generator) < 0.5
    model = learn([(pairs, ids, success)], centres(prototypes), AFFORDANCE, types=2)
    return GraspModel(model.centres, model.condensed, model.grid, model.calibration, SETTINGS)
