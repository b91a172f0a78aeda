"""Settings of what proposes grasps: votes, hypotheses from geometry."""

from __future__ import annotations

from dataclasses import dataclass

from omegaconf import MISSING, OmegaConf

from spgf_torch.errors import InputError
from spgf_torch.paths import root
from spgf_torch.settings import bounded, defaults_from, left_out, settings


@dataclass
class NeighboursConfig:
    """What is different where a target has neighbours, or is a whole table of things (conf/proposing/clutter.yaml)."""

    way: float = bounded(0.0, 1.0)
    unseen_from: float = bounded(0.0, 0.1)
    unseen_depth: float = bounded(0.0, 1.0)
    unseen_cell: float = bounded(0.002, 0.05)
    unseen_on_way: bool = MISSING
    unseen_weight: float = bounded(0.0, 1.0)
    seeds: int = bounded(1, 100_000)
    judged: int = bounded(1, 1_000_000)
    voters: int = bounded(1, 1_000_000)
    quota: int = bounded(1, 100_000)
    body_link: float = bounded(0.001, 0.1)
    body_hollow_deg: float = bounded(0.0, 180.0)
    strangers: float = bounded(0.0, 1.0)
    gap_from: float = bounded(0.0, 0.1)
    gap_to: float = bounded(0.0, 0.2)
    avoid_radius: float = bounded(0.0, 1.0)


@dataclass
@defaults_from("proposing/particles.yaml")
class ProposingConfig:
    """New grasps from feature pose x learned particle, without a mesh."""

    points: int = bounded(1, 100_000)
    pool: int = bounded(1, 100_000)
    point_support: float = bounded(0.0, 1e6)
    point_distance: float = bounded(0.0, 1.0)
    point_deg: float = bounded(0.0, 180.0)
    normal_weight: float = bounded(0.0, 1.0)
    proposing_features: int = bounded(1, 1_000_000)
    coarse_voters: int = bounded(1, 1_000_000)
    hypotheses: int = bounded(1, 100_000)
    coarse_points: int = bounded(1, 1_000_000)
    merge_distance: float = bounded(0.0, 1.0)
    merge_deg: float = bounded(0.0, 180.0)
    survivors: int = bounded(1, 100_000)
    refined: int = bounded(1, 100_000)
    rounds: int = bounded(0, 100)
    moves: int = bounded(1, 1000)
    move: float = bounded(0.0, 0.1)
    move_deg: float = bounded(0.0, 45.0)
    vote_shrinkage: float = bounded(0.0, 1e6)
    apart: float = bounded(0.0, 1.0)
    apart_deg: float = bounded(0.0, 180.0)
    count: int = bounded(1, 100_000)
    obstacle_clearance: float = bounded(0.0, 1.0)
    coarse_cell: float = bounded(0.001, 0.1)
    plane_clearance: float = bounded(0.0, 1.0)
    between: float = bounded(0.001, 0.2)
    probability_weight: float = bounded(0.0, 1.0)
    neighbours: NeighboursConfig | None = left_out()


@dataclass
@defaults_from("hypotheses/antipodal.yaml")
class HypothesesConfig:
    """Antipodal hypotheses from sensed geometry, and the numbers that a judge weighs them by."""

    seeds: int = bounded(1, 100_000)
    normal_weight: float = bounded(0.0, 1.0)
    normal_radius: float = bounded(0.001, 0.2)
    tilt_deg: float = bounded(0.0, 90.0)
    deepest: float = bounded(-0.2, 0.2)
    shallowest: float = bounded(-0.2, 0.2)
    depth_step: float = bounded(0.0005, 0.1)
    back: int = bounded(0, 100)
    face_gap: float = bounded(0.0, 0.1)
    play: float = bounded(0.0, 0.1)
    closing_points: int = bounded(1, 10_000)
    hypotheses: int = bounded(1, 1_000_000)
    coarse_points: int = bounded(1, 1_000_000)
    friction: float = bounded(0.01, 5.0)
    pad_depth: float = bounded(0.0005, 0.1)
    margin: float = bounded(0.001, 1.0)
    near_fingers: float = bounded(0.0, 1.0)
    far_palm: float = bounded(0.0, 1.0)
    grid: float = bounded(0.001, 0.1)
    coarse_grid: float = bounded(0.001, 0.1)
    unseen: float = bounded(0.0, 0.1)
    unseen_mid: float = bounded(0.0, 1.0)
    unseen_far: float = bounded(0.0, 1.0)


def proposing_named(name: str) -> ProposingConfig:
    """The settings of conf/proposing/NAME.yaml, read without Hydra. Raises InputError where there is none."""
    files = {file.stem: file for file in sorted((root() / "conf" / "proposing").glob("*.yaml"))}
    if name not in files:
        raise InputError(f"proposing: expected one of {', '.join(files)}; got {name!r:.40}")
    values: dict = OmegaConf.to_container(OmegaConf.load(files[name]))  # type: ignore[assignment]
    return settings(ProposingConfig, **{str(key): value for key, value in values.items() if key != "defaults"})
