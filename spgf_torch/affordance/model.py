"""Learning, asking and storing a grasp model: prototypes plus condensed shape-grasp particles.

A model folder holds `model.safetensors` (tensors) and `model.json` (settings and provenance): nothing in either can run
code when read. Each carries its own digest (`digests`), and `model.json` that of the tensors which it belongs to.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save
from torch import Tensor

from spgf_torch.affordance.calibration import NUMBERS, Calibration, uncalibrated
from spgf_torch.affordance.config import AffordanceConfig
from spgf_torch.affordance.neighbourhood import Condensed, condense
from spgf_torch.affordance.pairs import CellPairs, grid_of, shape_grasp_particles
from spgf_torch.affordance.voting import Votes, VotingIndex, cast_votes
from spgf_torch.errors import InputError
from spgf_torch.features.config import FeatureConfig
from spgf_torch.features.descriptors import width
from spgf_torch.files.digests import BLANK, KEY, check_seal, digest_of, sealed, sealed_json
from spgf_torch.files.reading import existing, json_values, unreadable
from spgf_torch.files.writing import write_bytes
from spgf_torch.geometry.se3_grid import Kernel, SE3Grid, gaussian_kernel
from spgf_torch.hands.config import HandConfig, grasp_types
from spgf_torch.prototypes.config import PrototypeConfig
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.settings import typed

__all__ = ["GraspModel", "learn", "load_model", "model_settings", "save_model", "vote"]

FORMAT = "spgf_torch model"
SCHEMA = 4
DIGEST = "tensors_sha256"  # key in model.json: SHA-256 of model.safetensors
LARGEST_HEADER = 1_000_000  # bytes in which model.safetensors says what is in it
# Tensors of a model in the file; partitions were called slices when the format was made.
_CONDENSED = {
    "slice_start": "partition_start",
    "cell": "cell",
    "probability": "probability",
    "support": "support",
    "base_rate": "base_rate",
}
_TENSORS = ("centres", "calibration", *_CONDENSED)


# What model.json must say: the settings of the rooms that made the model.
_SETTINGS: dict[str, type] = {
    "sensing": SensingConfig,
    "features": FeatureConfig,
    "prototypes": PrototypeConfig,
    "affordance": AffordanceConfig,
    "hand": HandConfig,
}
_SECTIONS = {"lattice": {"reach", "voxel", "rotation_deg"}, "settings": set(_SETTINGS)}
_LOWEST = {"cell": 0.0, "probability": 0.0, "support": 0.0, "base_rate": 0.0}
_HIGHEST = {"probability": 1.0, "base_rate": 1.0}


@dataclass(frozen=True)
class GraspModel:
    """What was learned.

    Attributes:
        centres (K, D) f32: the prototypes.
        condensed: condensed shape-grasp particles.
        grid: the cells that `condensed.cell` counts.
        calibration: from a grasp's log-odds score to its probability of success.
        settings: the resolved settings of the rooms that made it, as plain values.
    """

    centres: Tensor
    condensed: Condensed
    grid: SE3Grid
    calibration: Calibration
    settings: dict[str, Any] = field(default_factory=dict)

    @property
    def descriptor(self) -> str:
        """Of what its prototypes are: `features.descriptor`."""
        return str(self.settings.get("features", {}).get("descriptor", "spgf"))

    @property
    def grasp_types(self) -> tuple[str, ...]:
        """Names of the grasp types that it votes on."""
        return grasp_types(typed(HandConfig, self.settings["hand"]))

    def rings_deg(self) -> np.ndarray:
        """(K, 2, cells, 2) its prototypes: layer, cell, (alpha1, alpha2) in degrees.

        Raises InputError for a model of another descriptor than SPGF: its prototypes are no rings.
        """
        if self.descriptor != "spgf":
            raise InputError(f"features.descriptor: expected spgf, whose prototypes are rings, got {self.descriptor}")
        centres = self.centres.cpu().double().numpy()
        rings: np.ndarray = np.degrees(centres.reshape(len(centres), 2, -1, 2))
        return rings


def kernel_of(config: AffordanceConfig) -> Kernel:
    """The neighbourhood that the settings describe."""
    return gaussian_kernel(grid_of(config), config.kernel, config.kernel_deg)


def learn(
    examples: Sequence[tuple[CellPairs, Tensor, Tensor]], centres: Tensor, config: AffordanceConfig, types: int
) -> GraspModel:
    """Particles of all training objects, analysed and condensed; not calibrated.

    Args:
        examples: of each object its pairs, the prototype ids of its features (F,) int64 and the outcomes of its
            grasps (G,) bool.
        centres: (K, D) f32 prototypes.
        types: how many grasp types the hand has.
    """
    grid, kernel = grid_of(config), kernel_of(config)
    parts = [shape_grasp_particles(pairs, ids, types, success) for pairs, ids, success in examples]
    condensed = condense(parts, len(centres), grid, kernel, config.min_support)
    return GraspModel(centres, condensed, grid, uncalibrated(condensed.base_rate))


def vote(index: VotingIndex, pairs: CellPairs, ids: Tensor) -> Votes:
    """Votes of an object's features, of prototypes `ids` (F,) int64, on its grasps.

    A feature at the origin, for which a grasp 5 cm above held and one 5 cm beside did not, votes on both as it learned:

    >>> import torch
    >>> from spgf_torch.affordance.pairs import cell_pairs
    >>> from spgf_torch.affordance.config import AffordanceConfig
    >>> from spgf_torch.settings import settings
    >>> config = settings(AffordanceConfig, min_support=0.1)
    >>> feature, ids, grasps = torch.eye(4)[None], torch.tensor([0]), torch.eye(4).repeat(2, 1, 1)
    >>> grasps[:, :3, 3] = torch.tensor([[0.0, 0.0, 0.05], [0.05, 0.0, 0.0]])
    >>> pairs = cell_pairs(feature, grasps, torch.tensor([0, 0]), config)
    >>> model = learn([(pairs, ids, torch.tensor([True, False]))], torch.zeros(1, 144), config, types=1)
    >>> votes = vote(VotingIndex(model.condensed, model.grid), pairs, ids)
    >>> votes.grasp, votes.probability
    (tensor([0, 1]), tensor([1., 0.]))
    """
    return cast_votes(index, shape_grasp_particles(pairs, ids, index.condensed.types), pairs.grasp)


def save_model(model: GraspModel, folder: Path) -> int:
    """Write `model.safetensors` and then `model.json` into `folder`; returns the bytes of the former.

    Where only the first was written, the pair does not fit: `load_model` refuses it.
    """
    condensed = model.condensed
    tensors = {key: getattr(condensed, name) for key, name in _CONDENSED.items()}
    tensors |= {"centres": model.centres, "calibration": model.calibration.numbers}
    content = sealed(save({name: t.contiguous().cpu() for name, t in tensors.items()}, {KEY: BLANK.decode()}))
    write_bytes(folder / "model.safetensors", content)
    lattice, digest = _lattice_section(model.grid), hashlib.sha256(content).hexdigest()
    document = {"format": FORMAT, "schema": SCHEMA, "lattice": lattice, "settings": model.settings, DIGEST: digest}
    document["grasp_types"] = list(model.grasp_types)
    write_bytes(folder / "model.json", sealed_json(document, indent=1, sort_keys=True))
    return len(content)


def check_device(name: str) -> None:
    """Raises InputError where torch has no device of this name here."""
    try:
        if torch.device(name).type == "cpu" and torch.device(name).index:
            raise ValueError("there is one")
        torch.zeros(1, device=name).tolist()
    except Exception as error:  # each kind of device has errors of its own; `meta` holds nothing
        raise InputError(f"device: expected cpu or an accelerator of this machine, got {name or 'none'}") from error


def load_model(folder: Path, device: str = "cpu") -> GraspModel:
    """The model that `save_model` left in `folder`. Raises InputError if it is missing, damaged, edited or not ours."""
    document = _read_json(folder / "model.json")
    path = folder / "model.safetensors"
    if not path.is_file():
        raise InputError(f"{path}: expected the tensors of a model, found no such file")
    _check_tensors(path, document.get(DIGEST))
    try:
        tensors = load_file(path, device=device)
    except (SafetensorError, OSError, ValueError, KeyError) as error:  # the latter: a type that torch has not
        raise unreadable(path, "a safetensors file", error) from None
    missing = [name for name in _TENSORS if name not in tensors]
    if missing:
        raise InputError(f"{path}: expected the tensors {', '.join(_TENSORS)}; missing {', '.join(missing)}")
    D = width(typed(FeatureConfig, document["settings"]["features"]))
    _check_shapes(path, tensors, D, len(document["grasp_types"]))
    grid = grid_of(typed(AffordanceConfig, document["settings"]["affordance"]))
    _check_values(path, tensors, grid)
    tensors["cell"] = tensors["cell"].int()
    condensed = Condensed(*(tensors[key] for key in _CONDENSED))
    calibration = Calibration(tensors["calibration"])
    return GraspModel(tensors["centres"], condensed, grid, calibration, document["settings"])


def _check_tensors(path: Path, digest: str | None) -> None:
    """Raises InputError for tensors that are damaged, of another `model.json`, or with a header made to hurt."""
    with existing(path).open("rb") as file:
        length = int.from_bytes(file.read(8), "little")
    if length > LARGEST_HEADER:
        raise InputError(f"{path}: expected a safetensors file with a header of {LARGEST_HEADER} bytes, got {length}")
    if digest is not None and digest == digest_of(path):
        return
    if check_seal(path, "the tensors of a model") or digest is not None:
        raise InputError(f"{path}: expected the tensors that model.json beside it was written with, got others")


def _check_shapes(path: Path, tensors: dict[str, Tensor], D: int, types: int) -> None:
    """Raises InputError where the tensors are not of so many grasp types, or centres do not have D numbers."""
    for name, tensor in tensors.items():
        whole = name in ("slice_start", "cell")
        if name in _TENSORS and (tensor.is_floating_point() == whole or tensor.is_complex() or not tensor.ndim):
            raise InputError(f"{path}: expected {name} to hold {'whole ' * whole}numbers, got {tensor.dtype}")
    if tensors["centres"].ndim != 2 or tensors["centres"].shape[1] != D or not len(tensors["centres"]):
        raise InputError(f"{path}: expected centres of shape (K, {D}), got {tuple(tensors['centres'].shape)}")
    partitions, points = len(tensors["centres"]) * types, int(tensors["slice_start"].reshape(-1)[-1:].sum())
    expected: dict[str, tuple[int, ...]] = dict.fromkeys(("cell", "probability", "support"), (points,))
    expected |= {"slice_start": (partitions + 1,), "base_rate": (types,), "calibration": (types, len(NUMBERS))}
    for name, shape in expected.items():
        if tuple(tensors[name].shape) != shape:
            raise InputError(f"{path}: expected {name} of shape {shape}, got {tuple(tensors[name].shape)}")


def _check_values(path: Path, tensors: dict[str, Tensor], grid: SE3Grid) -> None:
    """Raises InputError where numbers are none that were learned: they would point at nothing, or rank at random."""
    start, cell = tensors["slice_start"], tensors["cell"]
    if int(start[0]) != 0 or bool((start.diff() < 0).any()):
        raise InputError(f"{path}: expected slice_start to rise from 0, got other numbers")
    if len(cell) and int(cell.max()) >= grid.cells:
        raise InputError(f"{path}: expected cells below {grid.cells}, got {int(cell.max())}")
    falls = (cell.diff() <= 0).nonzero()[:, 0] + 1
    if not bool(torch.isin(falls, start).all()):  # they are searched
        raise InputError(f"{path}: expected cells to rise within a partition, got other numbers")
    for name in _TENSORS:
        values = tensors[name]
        low, high = _LOWEST.get(name, -math.inf), _HIGHEST.get(name, math.inf)
        if values.numel() and not _finite_within(low, high, values):
            raise InputError(f"{path}: expected {name} finite and from {low:g} to {high:g}, got other numbers")


def _finite_within(low: float, high: float, values: Tensor) -> bool:
    """Whether all values are finite and from low to high, in one pass: NaN anywhere makes both extremes NaN."""
    least, most = (float(extreme) for extreme in torch.aminmax(values))
    return math.isfinite(least) and math.isfinite(most) and low <= least and most <= high


def model_settings(folder: Path) -> dict[str, Any]:
    """The settings of the model in `folder`, checked as `load_model` does, without its tensors."""
    told: dict[str, Any] = _read_json(folder / "model.json")["settings"]
    return told


def _read_json(path: Path) -> dict[str, Any]:
    if not path.is_file():
        raise InputError(f"{path}: expected a model that train left (make train), found no such file")
    document: dict[str, Any] = json_values(path, "a model's JSON", sealed=True)
    found = (document.get("format"), document.get("schema")) if isinstance(document, dict) else type(document).__name__
    if found != (FORMAT, SCHEMA):
        raise InputError(f"{path}: expected format {FORMAT!r}, schema {SCHEMA}; got {found}")
    for key, needed in _SECTIONS.items():
        section = document.get(key)
        if not isinstance(section, dict) or not needed <= section.keys():
            raise InputError(f"{path}: expected {key} with the keys {', '.join(sorted(needed))}; got something else")
    for key, room in _SETTINGS.items():
        try:
            config: Any = typed(room, document["settings"][key])
            if room is AffordanceConfig and document["lattice"] != (made := _lattice_section(grid_of(config))):
                raise InputError(f"expected the lattice {made}, got {document['lattice']}")
        except InputError as error:
            raise InputError(f"{path}: settings.{key}: {error}") from None
        if room is HandConfig and document.get("grasp_types") != (own := list(grasp_types(config))):
            got = str(document.get("grasp_types"))[:80]
            raise InputError(f"{path}: grasp_types: expected those of its hand, {own}, got {got}")
    return document


def _lattice_section(grid: SE3Grid) -> dict[str, float]:
    return {"reach": grid.reach, "voxel": grid.voxel, "rotation_deg": grid.rotation_deg}
