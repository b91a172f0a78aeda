"""Learning, asking and storing a grasp model: prototypes plus condensed shape-grasp particles.

A model folder holds `model.safetensors` (tensors) and `model.json` (settings and provenance): nothing in either can run
code when read. Each carries its own digest (`digests`), and `model.json` that of the tensors which it belongs to.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save
from torch import Tensor

from spgf_torch.affordance.calibration import Calibration, uncalibrated
from spgf_torch.affordance.config import AffordanceConfig
from spgf_torch.affordance.model_checks import CONDENSED, TENSORS, check_digest, check_shapes, check_values
from spgf_torch.affordance.neighbourhood import Condensed, condense
from spgf_torch.affordance.pairs import CellPairs, grid_of, shape_grasp_particles
from spgf_torch.affordance.small_config import SmallConfig
from spgf_torch.affordance.small_points import TENSORS as CODED
from spgf_torch.affordance.small_points import coded, decoded
from spgf_torch.affordance.voting import Votes, VotingIndex, cast_votes
from spgf_torch.errors import InputError
from spgf_torch.features.config import FeatureConfig
from spgf_torch.features.descriptors import width
from spgf_torch.files.digests import BLANK, KEY, sealed, sealed_json
from spgf_torch.files.reading import json_values, unreadable
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
SMALL = "small"  # key in model.json of a small one: of what it is, and how many points were left out
SMALL_TENSORS = ("centres", "calibration", "slice_start", "base_rate", *CODED)
# What model.json must say: the settings of the rooms that made the model.
_SETTINGS: dict[str, type] = {
    "sensing": SensingConfig,
    "features": FeatureConfig,
    "prototypes": PrototypeConfig,
    "affordance": AffordanceConfig,
    "hand": HandConfig,
}
_SECTIONS = {"lattice": {"reach", "voxel", "rotation_deg"}, "settings": set(_SETTINGS)}


@dataclass(frozen=True)
class GraspModel:
    """What was learned.

    Attributes:
        centres (K, D) f32: the prototypes.
        condensed: condensed shape-grasp particles.
        grid: the cells that `condensed.cell` counts.
        calibration: from a grasp's log-odds score to its probability of success.
        settings: the resolved settings of the rooms that made it, as plain values.
        about: what its file says beside: `date` of learning, digest of the tensors, and of a `small` one what it is of.
    """

    centres: Tensor
    condensed: Condensed
    grid: SE3Grid
    calibration: Calibration
    settings: dict[str, Any] = field(default_factory=dict)
    about: dict[str, Any] = field(default_factory=dict)

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


def save_model(model: GraspModel, folder: Path, small: SmallConfig | None = None) -> int:
    """Write `model.safetensors` and then `model.json` into `folder`; returns the bytes of the former.

    Where only the first was written, the pair does not fit: `load_model` refuses it.

    Args:
        small: how points are left out and rounded, so that the model takes few bytes; None: all of it is written.
    """
    condensed = model.condensed
    tensors = {key: getattr(condensed, name) for key, name in CONDENSED.items()}
    learned_now = DIGEST not in model.about  # one from a file says itself when it was learned, or does not know
    about: dict[str, Any] = {"date": datetime.now(UTC).date().isoformat()} if learned_now else {}
    about |= {"date": model.about["date"]} if "date" in model.about else {}
    if small is not None:
        tensors = {"base_rate": condensed.base_rate, **coded(condensed, small)}
        about[SMALL] = _small_of(model, int(tensors["slice_start"][-1]))
    tensors |= {"centres": model.centres, "calibration": model.calibration.numbers}
    content = sealed(save({name: t.contiguous().cpu() for name, t in tensors.items()}, {KEY: BLANK.decode()}))
    write_bytes(folder / "model.safetensors", content)
    lattice, digest = _lattice_section(model.grid), hashlib.sha256(content).hexdigest()
    document = {"format": FORMAT, "schema": SCHEMA, "lattice": lattice, "settings": model.settings, DIGEST: digest}
    document |= {**about, "grasp_types": list(model.grasp_types)}
    write_bytes(folder / "model.json", sealed_json(document, indent=1, sort_keys=True))
    return len(content)


def _small_of(model: GraspModel, points: int) -> dict[str, Any]:
    """Of what model a small one is: the digest of its tensors, where it came from a file, and how many points went."""
    left_out = len(model.condensed.cell) - points
    if SMALL in model.about:
        before = model.about[SMALL]
        return {**before, "points": points, "left_out": before["left_out"] + left_out}
    return {"of": model.about.get(DIGEST), "points": points, "left_out": left_out}


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
    check_digest(path, document.get(DIGEST))
    try:
        tensors = load_file(path, device=device)
    except (SafetensorError, OSError, ValueError, KeyError) as error:  # the latter: a type that torch has not
        raise unreadable(path, "a safetensors file", error) from None
    needed = TENSORS if SMALL not in document else SMALL_TENSORS
    if missing := [name for name in needed if name not in tensors]:
        raise InputError(f"{path}: expected the tensors {', '.join(needed)}; missing {', '.join(missing)}")
    grid = grid_of(typed(AffordanceConfig, document["settings"]["affordance"]))
    if SMALL in document:
        tensors |= {name: tensor.to(device) for name, tensor in decoded(path, tensors, grid.cells).items()}
    D = width(typed(FeatureConfig, document["settings"]["features"]))
    check_shapes(path, tensors, D, len(document["grasp_types"]))
    check_values(path, tensors, grid)
    tensors["cell"] = tensors["cell"].int()
    condensed = Condensed(*(tensors[key] for key in CONDENSED))
    calibration = Calibration(tensors["calibration"])
    about = {key: document[key] for key in ("date", SMALL, DIGEST) if key in document}
    return GraspModel(tensors["centres"], condensed, grid, calibration, document["settings"], about)


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
    small, date = document.get(SMALL, {}), document.get("date", "")
    if not isinstance(date, str) or len(date) > 40 or not isinstance(small, dict):
        raise InputError(f"{path}: expected date and {SMALL} as words and keys; got something else")
    if SMALL in document and not all(type(small.get(key)) is int for key in ("points", "left_out")):
        raise InputError(f"{path}: expected {SMALL} with whole numbers points and left_out; got something else")
    return document


def _lattice_section(grid: SE3Grid) -> dict[str, float]:
    return {"reach": grid.reach, "voxel": grid.voxel, "rotation_deg": grid.rotation_deg}
