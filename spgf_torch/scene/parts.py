"""From oriented points of the targets to a scene: texlets of each, what is around them, and what cuts them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from spgf_torch.errors import InputError
from spgf_torch.scene.borders import cut_borders
from spgf_torch.scene.cloud import Cloud
from spgf_torch.scene.config import SceneConfig
from spgf_torch.scene.degenerate_clouds import flat_hint
from spgf_torch.scene.gravity import Gravity
from spgf_torch.scene.observed_space import Looked
from spgf_torch.scene.scene import Scene
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.sensing.texlets import Texlets, thin


@dataclass(frozen=True)
class Around:
    """What is known beside the targets; see `Scene`."""

    obstacles: np.ndarray
    table: np.ndarray | None
    gravity: Gravity | None
    viewpoints: np.ndarray | None
    looked: Looked


def thinned(
    clouds: Sequence[Cloud],
    around: Around,
    notes: list[str],
    config: SceneConfig,
    sensing: SensingConfig,
    generator: np.random.Generator,
    no_grasp: str | None,
) -> Scene:
    """The scene of oriented clouds together, each target thinned to texlets of its own."""
    points = np.concatenate([cloud.points for cloud in clouds])
    normals = np.concatenate([cloud.normals for cloud in clouds if cloud.normals is not None])
    label = np.concatenate([np.ones(len(c), np.int32) if c.labels is None else c.labels for c in clouds])
    numbers = np.unique(label).tolist() or [1]
    parts = {k: thin(points[label == k], normals[label == k], sensing, generator) for k in numbers}
    parts = {k: part for k, part in parts.items() if len(part)} or {numbers[0]: parts[numbers[0]]}
    if not any(map(len, parts.values())) and no_grasp is None:
        raise InputError(
            f"{clouds[0].name}: expected {sensing.min_members} points within {sensing.spacing:g} m somewhere, got "
            f"fewer everywhere in {len(points)}; a denser cloud, a smaller stride, or another unit?"
        )
    if len(parts) > 1:
        notes.append(f"targets: {', '.join(f'{k} ({len(part)} texlets)' for k, part in parts.items())}")
    if no_grasp is None and (hint := flat_hint(points, normals, around.table, config)) is not None:
        notes.append(hint)
    return scene_of_parts(parts, around, notes, config, sensing, no_grasp)


def scene_of_parts(
    parts: dict[int, Texlets],
    around: Around,
    notes: list[str],
    config: SceneConfig,
    sensing: SensingConfig,
    no_grasp: str | None,
) -> Scene:
    """The scene of the texlets of each target."""
    texlets = Texlets(
        torch.cat([part.positions for part in parts.values()]), torch.cat([part.normals for part in parts.values()])
    )
    labels = torch.cat([torch.full((len(part),), k, dtype=torch.int64) for k, part in parts.items()])
    solid = torch.from_numpy(around.obstacles).float()
    if len(solid):
        notes.append(f"obstacles: {len(solid)} points of what is no target")
    borders = _borders(parts, around, config, sensing)
    if borders is not None:
        cut = int(borders.isfinite().all(1).sum())
        notes.append(
            f"borders: {cut} of {len(texlets)} texlets lie where the image, a mask, a crop box or the cloud ends, but "
            "not their surface: nothing is gripped over such a border"
        )
    known, looked = (around.table, around.gravity, around.viewpoints), around.looked
    scene = Scene(texlets, labels, solid, *known, sensing.spacing, tuple(notes), no_grasp)
    return replace(scene, views=looked.views, borders=borders, unseen=looked.words)


def _borders(
    parts: Mapping[int, Texlets], around: Around, config: SceneConfig, sensing: SensingConfig
) -> torch.Tensor | None:
    """`Scene.borders` of the targets together; for each of them the others are obstacles."""
    found = []
    for number, part in parts.items():
        others = [other.positions.double().numpy() for k, other in parts.items() if k != number]
        solid, looked = np.concatenate([around.obstacles, *others]), around.looked
        found.append(cut_borders(part, solid, looked.views or (), looked.planes, sensing.spacing, config.border))
    borders = torch.cat(found)
    return borders if bool(borders.isfinite().any()) else None
