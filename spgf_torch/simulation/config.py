"""Settings of trials in simulation, and of `simulate`."""

from __future__ import annotations

from dataclasses import dataclass, field

from omegaconf import MISSING

from spgf_torch.hands.config import HandConfig, grasp_types
from spgf_torch.objects.config import ObjectsConfig
from spgf_torch.settings import bounded, choice, defaults_from, left_out, text

# Samplers of candidate grasps.
SURFACE_PAIRS, APPROACH = "surface_pairs", "approach"


@dataclass
@defaults_from("sampler/surface_pairs.yaml")
class SamplerConfig:
    """Candidate grasps on an object's surface (docs/design/simulation.md)."""

    jitter_deg: float = bounded(0.0, 90.0)
    jitter: float = bounded(0.0, 0.1)
    depth: float = bounded(0.0, 0.5)


def samplers_of(hand: HandConfig) -> dict[str, str]:
    """Grasp type -> the sampler of its candidates (`candidates.SAMPLERS`), in the order of the types' codes."""
    return {name: hand.preshapes[name].sampler for name in grasp_types(hand)}


@dataclass
class RobotConfig:
    """What a robot adds to a trial, and what it does not know (conf/episode/robot.yaml)."""

    floating: float = bounded(0.0, 1.0)
    rest: str = choice("stable", "upright")
    approach: float = bounded(0.0, 1.0)
    turn_time: float = bounded(0.0, 10.0)
    fast_forward: bool = MISSING
    mass_spread: float = bounded(0.0, 0.95)
    friction_spread: float = bounded(0.0, 0.95)
    pose_error: float = bounded(0.0, 0.1)
    pose_error_deg: float = bounded(0.0, 90.0)
    draw: int = bounded(0, 2**31 - 1)


@dataclass
@defaults_from("episode/pinch.yaml")
class EpisodeConfig:
    """One simulated grasp: solver, phases, success rule (docs/design/simulation.md)."""

    dt: float = bounded(1e-5, 0.02)
    position_iterations: int = bounded(1, 255)
    velocity_iterations: int = bounded(1, 255)
    contact_offset: float = bounded(1e-5, 0.05)
    friction: float = bounded(0.0, 5.0)
    depenetration: float = bounded(0.01, 100.0)
    damping: float = bounded(0.0, 100.0)
    stall_window: float = bounded(0.002, 1.0)
    stall_motion: float = bounded(0.0, 0.1)
    stall_share: float = bounded(0.0, 0.9)
    settle_time: float = bounded(0.0, 10.0)
    hold_time: float = bounded(0.0, 10.0)
    hold_acceleration: float = bounded(0.0, 100.0)
    shake_time: float = bounded(0.0, 10.0)
    shake_acceleration: float = bounded(0.0, 100.0)
    gravity: float = bounded(0.0, 100.0)
    max_slip: float = bounded(0.0, 1.0)
    max_rotation_deg: float = bounded(0.0, 180.0)
    robot: RobotConfig | None = left_out()


@dataclass
class SimulateConfig(ObjectsConfig):
    """`python -m spgf_torch.simulate`: the trial table."""

    candidates: int = bounded(1, 10_000_000)
    budget: int | None = bounded(1, 10_000_000)
    out: str | None = text()
    seed: int = bounded(0, 2**31 - 1)
    chunk: int = bounded(1, 1_000_000)
    time_limit: float = bounded(0.1, 86_400.0)
    failed_as: str | None = text()
    runner: str = choice("local", "dask")
    address: str | None = text()
    shard: str = text()
    sampler: SamplerConfig = field(default_factory=SamplerConfig)
    episode: EpisodeConfig = field(default_factory=EpisodeConfig)
