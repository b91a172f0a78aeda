"""Learning, asking and storing a grasp model: prototypes plus condensed shape-grasp particles.

A model folder holds `model.safetensors` (tensors) and `model.json` (settings and provenance): nothing in
either can run code when read.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file
from torch import Tensor

from spgf_torch.affordance.lattice import Lattice, gaussian_kernel
from spgf_torch.affordance.neighbourhood import Condensed, condense
from spgf_torch.affordance.particles import Particles, pairs_within
from spgf_torch.affordance.voting import Votes, VotingIndex, cast_votes
from spgf_torch.config import GRASP_TYPES, AffordanceConfig, InputError

FORMAT = "spgf_torch model"
SCHEMA = 1
_TENSORS = ("centres", "slice_start", "cell", "probability", "support", "base_rate")


# What model.json must say.
_SECTIONS = {
    "lattice": {"reach", "voxel", "rotation_deg"},
    "settings": {"features", "prototypes", "affordance", "hand"},
}


@dataclass(frozen=True)
class CellPairs:
    """Feature-grasp pairs of one object, with the lattice cell of each: free of K, so computed once.

    Attributes:
        feature (P,) int32, grasp (P,) int32, cell (P,) int32.
        grasp_type (G,) int64 of the object's grasps.
    """

    feature: Tensor
    grasp: Tensor
    cell: Tensor
    grasp_type: Tensor


@dataclass(frozen=True)
class GraspModel:
    """What was learned.

    Attributes:
        centres (K, D) f32: the prototypes.
        condensed: condensed shape-grasp particles.
        lattice: the cells that `condensed.cell` counts.
        settings: the resolved settings of the rooms that made it, as plain values.
    """

    centres: Tensor
    condensed: Condensed
    lattice: Lattice
    settings: dict[str, Any] = field(default_factory=dict)


def lattice_of(config: AffordanceConfig) -> Lattice:
    """The lattice that the settings describe."""
    return Lattice(config.reach, config.voxel, config.rotation_deg)


def cell_pairs(
    T_object_feature: Tensor,
    T_object_grasp: Tensor,
    grasp_type: Tensor,
    config: AffordanceConfig,
    generator: torch.Generator | None = None,
) -> CellPairs:
    """Pairs of an object's features (F, 4, 4) and grasps (G, 4, 4) within reach, and their lattice cells.

    With a generator and more than `features_per_object` features, a random subset of them takes part.
    """
    chosen = torch.arange(len(T_object_feature), device=T_object_feature.device)
    if generator is not None and len(chosen) > config.features_per_object:
        drawn = torch.randperm(len(chosen), generator=generator)[: config.features_per_object]
        chosen = drawn.sort().values.to(chosen.device)
    pairs = pairs_within(T_object_feature[chosen], T_object_grasp, config.reach)
    cell = lattice_of(config).index(pairs.position, pairs.quaternion)
    return CellPairs(chosen[pairs.feature].int(), pairs.grasp.int(), cell.int(), grasp_type)


def learn(
    examples: Sequence[tuple[CellPairs, Tensor, Tensor]], centres: Tensor, config: AffordanceConfig
) -> GraspModel:
    """Particles of all training objects, analysed and condensed.

    Args:
        examples: of each object its pairs, the prototype ids of its features (F,) int64 and the outcomes of its
            grasps (G,) bool.
        centres: (K, D) f32 prototypes.
    """
    lattice = lattice_of(config)
    kernel = gaussian_kernel(lattice, config.kernel, config.kernel_deg, centres.device)
    parts = [shape_grasp_particles(pairs, ids, success) for pairs, ids, success in examples]
    return GraspModel(centres, condense(parts, len(centres), lattice, kernel, config.min_support), lattice)


def shape_grasp_particles(pairs: CellPairs, ids: Tensor, success: Tensor) -> Particles:
    """The particles of one object: ids (F,) int64 of its features, success (G,) bool of its grasps."""
    prototype, grasp_type = ids.index_select(0, pairs.feature), pairs.grasp_type.index_select(0, pairs.grasp)
    return Particles(prototype, grasp_type, pairs.cell, success.index_select(0, pairs.grasp))


def vote(model: GraspModel, pairs: CellPairs, ids: Tensor) -> Votes:
    """Votes of an object's features, of prototypes `ids` (F,) int64, on its grasps."""
    grasp = pairs.grasp.long()
    index = VotingIndex(model.condensed, model.lattice)
    return cast_votes(index, ids[pairs.feature.long()], pairs.grasp_type[grasp], grasp, pairs.cell.long())


def save_model(model: GraspModel, folder: Path) -> None:
    """Write `model.safetensors` and `model.json` into `folder`."""
    condensed = model.condensed
    tensors = {"centres": model.centres, **{name: getattr(condensed, name) for name in _TENSORS[1:]}}
    tensors["cell"] = condensed.cell.int()  # half the file
    save_file({name: t.contiguous().cpu() for name, t in tensors.items()}, folder / "model.safetensors")
    lattice = {"reach": model.lattice.reach, "voxel": model.lattice.voxel, "rotation_deg": model.lattice.rotation_deg}
    document = {"format": FORMAT, "schema": SCHEMA, "lattice": lattice, "settings": model.settings}
    (folder / "model.json").write_text(json.dumps(document, indent=1, sort_keys=True) + "\n")


def check_device(name: str) -> None:
    """Raises InputError where torch has no device of this name here."""
    try:
        torch.zeros(1, device=name)
    except (RuntimeError, AssertionError) as error:  # torch built without CUDA raises the latter
        raise InputError(f"device: expected cpu or an accelerator of this machine, got {name}") from error


def load_model(folder: Path, device: str = "cpu") -> GraspModel:
    """The model that `save_model` left in `folder`. Raises InputError if it is missing, cut off or not ours."""
    document = _read_json(folder / "model.json")
    path = folder / "model.safetensors"
    if not path.is_file():
        raise InputError(f"{path}: expected the tensors of a model, found no such file")
    try:
        tensors = load_file(path, device=device)
    except (SafetensorError, OSError) as error:
        raise InputError(f"{path}: expected a safetensors file, got: {str(error).splitlines()[0]}") from None
    missing = [name for name in _TENSORS if name not in tensors]
    if missing:
        raise InputError(f"{path}: expected the tensors {', '.join(_TENSORS)}; missing {', '.join(missing)}")
    _check_shapes(path, tensors)
    tensors["cell"] = tensors["cell"].long()
    condensed = Condensed(*(tensors[name] for name in _TENSORS[1:]))
    return GraspModel(tensors["centres"], condensed, _lattice(document["lattice"]), document["settings"])


def _lattice(section: dict[str, float]) -> Lattice:
    return Lattice(section["reach"], section["voxel"], section["rotation_deg"])


def _check_shapes(path: Path, tensors: dict[str, Tensor]) -> None:
    """Raises InputError where the tensors do not belong together."""
    slices, points = len(tensors["centres"]) * len(GRASP_TYPES), int(tensors["slice_start"].reshape(-1)[-1:].sum())
    expected = dict.fromkeys(("cell", "probability", "support"), (points,))
    expected |= {"slice_start": (slices + 1,), "base_rate": (len(GRASP_TYPES),)}
    for name, shape in expected.items():
        if tuple(tensors[name].shape) != shape:
            raise InputError(f"{path}: expected {name} of shape {shape}, got {tuple(tensors[name].shape)}")


def _read_json(path: Path) -> dict[str, Any]:
    if not path.is_file():
        raise InputError(f"{path}: expected a model that train left (make train), found no such file")
    try:
        document = json.loads(path.read_text())
    except (json.JSONDecodeError, UnicodeDecodeError):
        raise InputError(f"{path}: expected a JSON document, got something else") from None
    found = (document.get("format"), document.get("schema")) if isinstance(document, dict) else type(document).__name__
    if found != (FORMAT, SCHEMA):
        raise InputError(f"{path}: expected format {FORMAT!r}, schema {SCHEMA}; got {found}")
    for key, needed in _SECTIONS.items():
        section = document.get(key)
        if not isinstance(section, dict) or not needed <= section.keys():
            raise InputError(f"{path}: expected {key} with the keys {', '.join(sorted(needed))}; got something else")
    return document
