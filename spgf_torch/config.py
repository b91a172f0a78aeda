"""Typed settings of every room, their ranges, and the wording of what is wrong with them.

The values live in `conf/` (one YAML file a room, each value with its reason); the dataclasses here give
each key a type and a range. `settings(FeatureConfig)` reads a room's defaults without Hydra.

Lengths are metres, masses kilograms, times seconds; angles are degrees in settings (and only there).
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field, fields, is_dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar

from omegaconf import MISSING, OmegaConf
from omegaconf.errors import MissingMandatoryValue, OmegaConfBaseException

GRASP_TYPES = ("NPG", "WPG")
CLASSES = ("containers", "boxes", "curved")
# What local shape can be described by (features/descriptors.py).
DESCRIPTORS = ("spgf", "fpfh", "patch_pairs")
# What a novel object's grasps can be ranked by (affordance/ranking.py).
RANKINGS = ("paper", "log_odds", "log_odds_free", "calibrated")
# The one of these that cross-validation inside the training folds chose, in each fold anew.
NESTED = "nested"
# A learned judge's probability (judging/candidates.py), where it is asked for.
JUDGE = "judge"

T = TypeVar("T")


# Characters of a line that says what is wrong.
LONGEST_LINE = 1000


class InputError(ValueError):
    """Something the user gave cannot be used: one line that names it, what was expected and what was got.

    Names and values in it may come from a file: what would break the line or steer a terminal is written as `\\x1b`.
    """

    def __init__(self, message: str) -> None:
        super().__init__(one_line(message))


def one_line(words: str) -> str:
    """`words` without line breaks and control characters; of more than `LONGEST_LINE` characters both ends."""
    line = " ".join(words.split()) if not words.isprintable() else words
    line = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in line)
    half = LONGEST_LINE // 2 - 3
    return line if len(line) <= LONGEST_LINE else f"{line[:half]} ... {line[-half:]}"


class IncompleteError(Exception):
    """Work that could not be done to its end, in one line as for `InputError`; what is finished is kept (status 1)."""

    def __init__(self, message: str) -> None:
        super().__init__(one_line(message))


def bounded(low: float, high: float) -> Any:
    """A required number within [low, high]."""
    return field(default=MISSING, metadata={"range": (low, high)})


def choice(*options: str) -> Any:
    """A required word, one of `options`."""
    return field(default=MISSING, metadata={"choice": options})


def text(default: Any = MISSING) -> Any:
    """A string or path; its meaning is checked where it is used."""
    return field(default=default)


@dataclass
class SensingConfig:
    """Simulated RGB-D cameras on a circle around the object, their noise, and texlet extraction."""

    cameras: int = bounded(1, 64)
    distance: float = bounded(0.1, 5.0)
    elevation_deg: float = bounded(-89.0, 89.0)
    azimuth_deg: float = bounded(-360.0, 360.0)
    width: int = bounded(16, 4096)
    height: int = bounded(16, 4096)
    focal: float = bounded(1.0, 10000.0)
    axial_base: float = bounded(0.0, 0.1)
    axial_quadratic: float = bounded(0.0, 1.0)
    axial_nearest: float = bounded(0.0, 5.0)
    axial_grazing: float = bounded(0.0, 0.1)
    lateral_px: float = bounded(0.0, 10.0)
    disparity_step_px: float = bounded(0.0, 2.0)
    baseline: float = bounded(0.001, 1.0)
    flying_px: float = bounded(0.0, 1.0)
    edge_depth: float = bounded(0.0, 1.0)
    grazing_deg: float = bounded(1.0, 90.0)
    window: int = bounded(3, 15)
    depth_gate: float = bounded(0.0005, 0.1)
    min_window: int = bounded(3, 225)
    spacing: float = bounded(0.0005, 0.05)
    rival_deg: float = bounded(1.0, 180.0)
    min_members: int = bounded(1, 100)


@dataclass
class SceneConfig:
    """People's own data: the input files and how they become texlets (lengths here in metres, whatever `unit` says)."""

    input: Any = text()
    unit: str = choice("m", "cm", "mm")
    min_extent: float = bounded(0.0001, 1.0)
    max_extent: float = bounded(0.1, 1000.0)
    max_points: int = bounded(1, 1_000_000_000)
    viewpoints: Any = text()
    intrinsics: Any = text()
    poses: Any = text()
    mask: Any = text()
    segments: Any = text()
    depth_scale: float | None = bounded(1e-6, 1.0)
    stride: int | None = text()
    read_as: str = choice("auto", "cloud", "mesh")
    mesh: str = choice("sensed", "whole")
    mesh_pitch: float = bounded(0.0005, 0.01)
    mesh_samples: int = bounded(1000, 20_000_000)
    crop_low: Any = text()
    crop_high: Any = text()
    voxel: float = bounded(0.0005, 0.05)
    table: Any = text()
    table_distance: float = bounded(0.0005, 0.05)
    table_share: float = bounded(0.01, 1.0)
    table_width: float = bounded(0.01, 10.0)
    table_hypotheses: int = bounded(10, 100_000)
    gravity: Any = text()
    border: float = bounded(0.0, 0.5)
    neighbours: int = bounded(5, 200)
    normal_radius: float = bounded(0.001, 0.1)
    min_neighbours: int = bounded(3, 200)


@dataclass
class FeatureConfig:
    """The Sliced Pineapple Grid Feature (paper, section 3.1), or a baseline in its place."""

    # Older models do not say: theirs is SPGF.
    descriptor: str = field(default="spgf", metadata={"choice": DESCRIPTORS})
    radius: float = bounded(0.001, 1.0)
    cells: int = bounded(4, 360)
    half_length: int = bounded(0, 180)
    alignment: str = choice("argmax", "soft", "random")
    layers: int = bounded(1, 2)
    gaps: str = choice("saturated", "flat")


@dataclass
class PrototypeConfig:
    """k-means of the relational parts (paper, section 3.2)."""

    num_clusters: int = bounded(1, 1000)
    restarts: int = bounded(1, 1000)
    subsample: int = bounded(100, 10_000_000)
    components: int = bounded(1, 10_000)
    parts: int = bounded(1, 1_000_000)
    finalists: int = bounded(1, 1000)
    breath: int = bounded(0, 100)
    batch_size: int = bounded(1, 1_000_000)
    epochs: int = bounded(1, 1000)
    refine_steps: int = bounded(1, 10_000)
    tolerance: float = bounded(0.0, 1.0)


@dataclass
class AffordanceConfig:
    """Shape-grasp particles, neighbourhood analysis, condensation, voting (paper, section 3.4)."""

    reach: float = bounded(0.005, 0.5)
    voxel: float = bounded(0.001, 0.1)
    rotation_deg: float = bounded(5.0, 90.0)
    kernel: float = bounded(0.0, 0.1)
    kernel_deg: float = bounded(0.0, 90.0)
    min_support: float = bounded(0.0, 1e6)
    shrinkage: float = bounded(0.0, 1e6)
    vote_shrinkage: float = bounded(0.0, 1e6)
    features_per_object: int = bounded(1, 1_000_000)


@dataclass
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


@dataclass
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


@dataclass
class FingerConfig:
    """One finger of the hand: its pad (a point of `pad_link`'s closing face, in that link's frame, m) and its joints.

    `proximal` closes the finger; `distal`, where there is one, turns against it so that the pads stay parallel.
    """

    pad_link: str = text()
    pad: list[float] = field(default_factory=list)
    proximal: str = text()
    distal: str = text("")


@dataclass
class HandConfig:
    """A gripper: a URDF and the roles of its joints (frames: palm z out of the palm; TCP +z approach, +x closing)."""

    name: str = text()
    urdf: str = text()
    base_link: str = text()
    fingers: list[FingerConfig] = field(default_factory=list)
    fixed_deg: dict[str, float] = field(default_factory=dict)
    openings: dict[str, float] = field(default_factory=dict)
    proximal_stiffness: float = bounded(0.0, 1e5)
    proximal_damping: float = bounded(0.0, 1e4)
    proximal_limit: float = bounded(0.0, 1e4)
    closing_torque: float = bounded(0.0, 1e4)
    closing_speed: float = bounded(0.001, 100.0)
    distal_stiffness: float = bounded(0.0, 1e5)
    distal_damping: float = bounded(0.0, 1e4)
    distal_limit: float = bounded(0.0, 1e4)


@dataclass
class SamplerConfig:
    """Candidate grasps on an object's surface (SIMULATION.md, Candidates)."""

    jitter_deg: float = bounded(0.0, 90.0)
    jitter: float = bounded(0.0, 0.1)


@dataclass
class EpisodeConfig:
    """One simulated grasp: solver, phases, success rule (SIMULATION.md)."""

    dt: float = bounded(1e-5, 0.02)
    position_iterations: int = bounded(1, 255)
    velocity_iterations: int = bounded(1, 255)
    contact_offset: float = bounded(1e-5, 0.05)
    friction: float = bounded(0.0, 5.0)
    depenetration: float = bounded(0.01, 100.0)
    damping: float = bounded(0.0, 100.0)
    close_time: float = bounded(0.01, 10.0)
    stall_window: float = bounded(0.002, 1.0)
    stall_motion: float = bounded(0.0, 0.1)
    settle_time: float = bounded(0.0, 10.0)
    hold_time: float = bounded(0.0, 10.0)
    hold_acceleration: float = bounded(0.0, 100.0)
    shake_time: float = bounded(0.0, 10.0)
    shake_acceleration: float = bounded(0.0, 100.0)
    gravity: float = bounded(0.0, 100.0)
    max_slip: float = bounded(0.0, 1.0)
    max_rotation_deg: float = bounded(0.0, 180.0)


@dataclass
class CollisionConfig:
    """Scanned meshes: their convex collision pieces, the check of these, and what a mesh may be."""

    tolerance: float = bounded(0.00005, 0.05)
    inset: float = bounded(0.0, 0.01)
    thickness: float = bounded(0.0002, 0.05)
    max_edge: float = bounded(0.0005, 0.5)
    attempts: int = bounded(1, 10)
    samples: int = bounded(1000, 10_000_000)
    cavity_depth: float = bounded(0.0, 1.0)
    volume_tolerance: float = bounded(0.0, 1.0)
    free_space_kept: float = bounded(0.0, 1.0)
    density: float = bounded(1.0, 20_000.0)
    wall_density: float = bounded(1.0, 20_000.0)
    min_extent: float = bounded(0.0001, 1.0)
    max_extent: float = bounded(0.01, 100.0)
    max_hole: float = bounded(0.0, 0.1)


@dataclass
class ObjectsConfig:
    """A folder of objects, for every door that takes one: descriptions, or meshes and how they are read."""

    objects: str = text()
    unit: str = choice("auto", "m", "cm", "mm")
    category: str = choice("manifest", *CLASSES)
    skip_bad: bool = MISSING
    workers: int = bounded(0, 1024)
    hand: HandConfig = field(default_factory=HandConfig)
    collision: CollisionConfig = field(default_factory=CollisionConfig)


@dataclass
class TrainConfig(ObjectsConfig):
    """`python -m spgf_torch.train`: the paper's experiment."""

    K: int = bounded(1, 1000)
    N: int = bounded(1, 1000)
    folds: int = bounded(2, 50)
    seed: int = bounded(0, 2**31 - 1)
    ranking: str = choice(*RANKINGS, NESTED, JUDGE)
    inner_grasps: int = bounded(10, 1_000_000)
    trials_per_object: int = bounded(1, 1_000_000)
    training_objects: int = bounded(2, 1_000_000)
    final_model: bool = MISSING
    fold_models: bool = MISSING
    bootstrap: int = bounded(100, 1_000_000)
    trials: str = text()
    # Older runs do not say: theirs have none.
    judge: str = field(default="none", metadata={"choice": ("none", "learn")})
    own_trials: str | None = text(None)
    judging: dict[str, Any] = field(default_factory=dict)
    runner: str = field(default="local", metadata={"choice": ("local", "dask")})
    address: str | None = text(None)
    device: str = text()
    cache: str | None = text()
    cache_gb: float = bounded(0.0, 1e6)
    sensing: SensingConfig = field(default_factory=SensingConfig)
    features: FeatureConfig = field(default_factory=FeatureConfig)
    prototypes: PrototypeConfig = field(default_factory=PrototypeConfig)
    affordance: AffordanceConfig = field(default_factory=AffordanceConfig)
    sampler: SamplerConfig = field(default_factory=SamplerConfig)
    episode: EpisodeConfig = field(default_factory=EpisodeConfig)


@dataclass
class SimulateConfig(ObjectsConfig):
    """`python -m spgf_torch.simulate`: the trial table."""

    candidates: int = bounded(1, 10_000_000)
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


@dataclass
class EvaluateConfig(ObjectsConfig):
    """`python -m spgf_torch.evaluate`: the model's best grasps on a folder of meshes, executed."""

    model: str = text()
    judge: str | None = text()
    table: bool = MISSING
    held_out: bool = MISSING
    N: int = bounded(1, 1000)
    candidates: str = choice("proposed", "sampled")
    samples: int = bounded(1, 10_000_000)
    random_trials: int = bounded(1, 1_000_000)
    ranking: str = choice(*RANKINGS)
    bootstrap: int = bounded(100, 1_000_000)
    seed: int = bounded(0, 2**31 - 1)
    device: str = text()
    cache: str | None = text()
    cache_gb: float = bounded(0.0, 1e6)
    sensing: SensingConfig = field(default_factory=SensingConfig)
    sampler: SamplerConfig = field(default_factory=SamplerConfig)
    episode: EpisodeConfig = field(default_factory=EpisodeConfig)
    proposing: ProposingConfig = field(default_factory=ProposingConfig)


@dataclass
class TreesConfig:
    """Boosted trees of a judge (scikit-learn's HistGradientBoostingClassifier)."""

    trees: int = bounded(1, 10_000)
    rate: float = bounded(0.001, 1.0)
    leaves: int = bounded(2, 1000)
    least: int = bounded(1, 100_000)
    l2: float = bounded(0.0, 1e6)


@dataclass
class JudgeConfig(ObjectsConfig):
    """`python -m spgf_torch.judge`: a hand's judge of grasp hypotheses."""

    trials: str | None = text()
    own_trials: str | None = text()
    candidates: int = bounded(1, 1_000_000)
    rounds: int = bounded(1, 10)
    best: int = bounded(1, 1000)
    random: int = bounded(0, 1000)
    one_view: int = bounded(1, 100)
    four_views: int = bounded(0, 100)
    surveyed: int = bounded(0, 100_000)
    looks: int = bounded(0, 100)
    lowest_deg: float = bounded(-89.0, 89.0)
    highest_deg: float = bounded(-89.0, 89.0)
    folds: int = bounded(2, 50)
    form: str = choice("trees", "logistic")
    sure: float = bounded(0.0, 1.0)
    bootstrap: int = bounded(100, 1_000_000)
    seed: int = bounded(0, 2**31 - 1)
    runner: str = choice("local", "dask")
    address: str | None = text()
    time_limit: float = bounded(0.1, 86_400.0)
    cache: str | None = text()
    cache_gb: float = bounded(0.0, 1e6)
    sensing: SensingConfig = field(default_factory=SensingConfig)
    sampler: SamplerConfig = field(default_factory=SamplerConfig)
    episode: EpisodeConfig = field(default_factory=EpisodeConfig)
    proposing: ProposingConfig = field(default_factory=ProposingConfig)
    hypotheses: HypothesesConfig = field(default_factory=HypothesesConfig)
    learning: TreesConfig = field(default_factory=TreesConfig)


@dataclass
class PredictConfig(SceneConfig):
    """`python -m spgf_torch.predict`: ranked grasps for people's own data; its input settings are those of a scene."""

    model: str = text()
    judge: str | None = text()
    N: int = bounded(1, 1000)
    retreat: float = bounded(0.0, 1.0)
    device: str = text()
    seed: int = bounded(0, 2**31 - 1)
    proposing: ProposingConfig = field(default_factory=ProposingConfig)


@dataclass
class ReportConfig:
    """`python -m spgf_torch.report`: Table 1, figures and a page from runs of train."""

    runs: Any = text()
    ranking: str = choice(NESTED, *RANKINGS, JUDGE)
    rankings: list[str] = field(default_factory=list)
    show: int | None = field(default=None)
    objects: int = bounded(1, 100)
    worst: int = bounded(1, 100)
    grasps: int = bounded(2, 1000)
    precision: int = bounded(1, 10_000)
    bootstrap: int = bounded(100, 1_000_000)
    seed: int = bounded(0, 2**31 - 1)


@dataclass
class CompareConfig:
    """`python -m spgf_torch.compare`: descriptors and the learned baseline side by side."""

    runs: Any = text()
    baseline: Any = text()
    reference: str = text()
    ranking: str = choice(NESTED, *RANKINGS)
    rankings: list[str] = field(default_factory=list)
    K: int = bounded(1, 1000)
    trials_per_object: int | None = field(default=None)
    bootstrap: int = bounded(100, 1_000_000)
    seed: int = bounded(0, 2**31 - 1)


# Where each room's default values stand, below conf/.
DEFAULTS: dict[type, str] = {
    SensingConfig: "sensing/four_cameras.yaml",
    SceneConfig: "scene/tabletop.yaml",
    FeatureConfig: "features/spgf.yaml",
    PrototypeConfig: "prototypes/minibatch.yaml",
    AffordanceConfig: "affordance/lattice.yaml",
    ProposingConfig: "proposing/particles.yaml",
    HypothesesConfig: "hypotheses/antipodal.yaml",
    TreesConfig: "learning/trees.yaml",
    HandConfig: "hand/sdh2.yaml",
    SamplerConfig: "sampler/surface_pairs.yaml",
    EpisodeConfig: "episode/pinch.yaml",
    CollisionConfig: "collision/shell.yaml",
}


def root() -> Path:
    """The folder that holds `conf` and `data`: the package's own copy in a wheel, else the repository."""
    packaged = Path(__file__).parent / "_shipped"
    return packaged if packaged.is_dir() else Path(__file__).parent.parent


def find(path: str | Path) -> Path:
    """`path` as given if it exists (relative to the working folder), else below `root()`."""
    if "\0" in str(path):
        raise InputError(f"{path}: expected a file or folder, got a name with a zero in it")
    try:
        given = Path(path).expanduser()
        shipped = root() / given
        return shipped if not given.exists() and shipped.exists() else given
    except (OSError, RuntimeError) as error:  # a name too long; ~somebody who is not known here
        raise InputError(
            f"{path}: expected a file or folder, got {getattr(error, 'strerror', None) or error}"
        ) from None


def settings(kind: type[T], **changes: Any) -> T:
    """The default settings of a room, read from `conf/` without Hydra, with `changes` applied."""
    given = {key: _python(value) for key, value in changes.items()}
    return typed(kind, {**_plain(OmegaConf.load(root() / "conf" / DEFAULTS[kind])), **given})


def typed(kind: type[T], values: Any) -> T:
    """`values` (a mapping) as an instance of the dataclass `kind`.

    Raises InputError in one line for a key that does not exist, a wrong type or a number out of range, and for
    `${...}`: Hydra has resolved the settings' own, and in a file read from elsewhere it would read the environment.
    """
    try:
        _check_literal(values, "")
        merged = OmegaConf.merge(OmegaConf.structured(kind), OmegaConf.create(_plain(values)))
        result = OmegaConf.to_object(merged)
    except MissingMandatoryValue as error:
        raise InputError(f"{error.full_key or error.key}: expected a value, got none") from None
    except OmegaConfBaseException as error:
        raise InputError(_one_line(error)) from None
    _check(result, "")
    return result  # type: ignore[return-value]


def plain(config: Any) -> dict[str, Any]:
    """A settings dataclass as nested dicts and lists of plain Python values."""
    return _plain(OmegaConf.structured(config))


def _python(value: Any) -> Any:
    """A value of a setting given in Python: arrays, tensors, their numbers and paths as plain values."""
    if isinstance(value, list | tuple):
        return [_python(part) for part in value]
    if isinstance(value, Path):
        return str(value)
    return value.tolist() if callable(getattr(value, "tolist", None)) else value


def _plain(values: Any) -> Any:
    return OmegaConf.to_container(values, resolve=True) if OmegaConf.is_config(values) else values


# OmegaConf's words in ours.
_WORDS = {
    r"^Value '(.*)' of type '\w+' could not be converted to (\w+)$": r"expected a value of type \2, got \1",
    r"^Incompatible value '(.*)' for field of type '(\w+)'$": r"expected a value of type \2, got \1",
    r"^Cannot convert '(\w+)' to string: '(.*)'$": r"expected text, got \2",
    r"^field '(\w+)' is not Optional$": r"\1: expected a value, got none",
    r"^Object of unsupported type: '(\w+)'$": r"expected keys and values, got \1",
    r"^Invalid type assigned: \w+ is not a subclass of (\w+)\. value: (.*)$": r"expected keys of \1, got \2",
}


def _one_line(error: OmegaConfBaseException) -> str:
    message = str(error.msg or error).splitlines()[0].strip()
    unknown = re.match(r"^Key '(.*)' not in '\w+'$", message)
    kind = getattr(error, "object_type", None)
    if unknown and isinstance(kind, type) and is_dataclass(kind):
        near = get_close_matches(unknown[1], [entry.name for entry in fields(kind)], 1)
        hint = f"; did you mean {near[0]}?" if near else ""
        named = str(getattr(error, "full_key", None) or unknown[1])
        return f"{named}: expected a key of {kind.__name__}, got {unknown[1]}{hint}"
    for pattern, words in _WORDS.items():
        message = re.sub(pattern, words, message)
    key = getattr(error, "full_key", None)
    return f"{key}: {message}" if key and str(key) not in message else message


def _check_literal(value: Any, name: str) -> None:
    if isinstance(value, str) and "${" in value:
        raise InputError(f"{name}: expected a plain value, got {value}")
    parts = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list | tuple) else ()
    for key, part in parts:
        _check_literal(part, f"{name}.{key}" if name else str(key))


def _check(config: Any, prefix: str) -> None:
    for entry in fields(config):
        value, name = getattr(config, entry.name), prefix + entry.name
        if is_dataclass(value):
            _check(value, name + ".")
        elif "range" in entry.metadata:
            low, high = entry.metadata["range"]
            if value is not None and not low <= value <= high:
                raise InputError(f"{name}: expected a number from {low:g} to {high:g}, got {value}")
        elif "choice" in entry.metadata and value not in entry.metadata["choice"]:
            raise InputError(f"{name}: expected one of {', '.join(entry.metadata['choice'])}; got {value}")
