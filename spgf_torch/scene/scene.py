"""A scene: what there is to grasp and all that a hand must not touch, from arrays or files.

    scene = Scene.from_depth(depth, K, T_base_camera, mask=mask, table="find")
    grasps = model.predict(scene)

A mask, a crop box or a segment marks a target; everything else that was sensed stays an obstacle. The table is looked
for before, among all points. What was assumed, left out or looks wrong is a line in `notes`.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from spgf_torch.errors import InputError
from spgf_torch.scene.config import SceneConfig
from spgf_torch.scene.gravity import Gravity
from spgf_torch.scene.sensed import Sensed
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.sensing.texlets import Texlets
from spgf_torch.sensing.unseen import DepthView
from spgf_torch.settings import settings

__all__ = ["Scene"]

# Draws the order of texlets and the planes that are tried, where no generator is given.
_SEED = 0


@dataclass(frozen=True, repr=False)
class Scene:
    """What was sensed, in the input's frame.

    Attributes:
        texlets: of the targets.
        labels: (N,) int64, the target that each texlet is of.
        obstacles: (M, 3) float32, m: everything else that was sensed, one a voxel; without the table.
        table: (4,) float64 a, b, c, d, a x + b y + c z + d the height above it in m; None: none is known.
        gravity: what is up, where no table says it; None: hands may come from anywhere.
        viewpoints: (V, 3) float64, m, from where it was seen; None where not known.
        spacing: m between texlets, which a model's must equal.
        notes: what was assumed, left out or looks wrong ("warning: ..."), a line each.
        views: whole depth images with their cameras, also those that clouds make at their viewpoints, which tell unseen
            space; None: it is not known.
        borders: (N, 3) float32 of each texlet the unit vector along its surface over the border of an image, a mask, a
            crop box or the cloud that cuts it there; NaN: none does; None: none does anywhere.
        unseen: how unseen space is known, or why it is not, in words.
        sensed: all that was sensed, with its colours, to be shown; None: the texlets and obstacles are all.
        no_grasp: why there can be none, such as points on a line; None: there may be some.
    """

    texlets: Texlets
    labels: torch.Tensor
    obstacles: torch.Tensor
    table: np.ndarray | None
    gravity: Gravity | None
    viewpoints: np.ndarray | None
    spacing: float
    notes: tuple[str, ...]
    no_grasp: str | None = None
    views: tuple[DepthView, ...] | None = None
    borders: torch.Tensor | None = None
    unseen: str = ""
    sensed: Sensed | None = None

    def __repr__(self) -> str:
        table = "no table" if self.table is None else "a table"
        counted = f"{len(self.targets)} target(s), {len(self.texlets)} texlets, {len(self.obstacles)} obstacle points"
        return f"Scene({counted}, {table}, {len(self.views or ())} images, {len(self.notes)} notes)"

    @property
    def targets(self) -> tuple[int, ...]:
        """The numbers of the targets: those of `segments`, or 1."""
        return tuple(torch.unique(self.labels).tolist())

    def of(self, target: int) -> Scene:
        """The scene with one of its targets; the others are obstacles. InputError for a number that is none of them."""
        if target not in self.targets:
            raise InputError(f"target: expected one of {', '.join(map(str, self.targets)) or 'none'}; got {target!r}")
        own = self.labels == target
        others = self.texlets.positions[~own]
        return replace(
            self,
            texlets=Texlets(self.texlets.positions[own], self.texlets.normals[own]),
            labels=self.labels[own],
            obstacles=torch.cat([self.obstacles, others]),
            borders=None if self.borders is None else self.borders[own],
        )

    @staticmethod
    def from_points(
        points: Any,
        viewpoints: Any = None,
        normals: Any = None,
        *,
        mask: Any = None,
        segments: Any = None,
        sensing: SensingConfig | None = None,
        **changes: Any,
    ) -> Scene:
        """The scene that a point cloud shows, or several in lists, such as one a view.

        Args:
            points: (N, 3), or (H, W, 3) as an image of points, m (or `unit`); NaN, infinity and 0 0 0: no reading.
            viewpoints: (3,) or (V, 3), where it was seen from, m, same frame; None: found from the points, or refused.
            normals: in the shape of the points, out of the surface; None: estimated.
            mask: (N,) or (H, W), not 0: the target, 0: an obstacle; None: all is the target.
            segments: whole numbers in the same shape, each above 0 a target of its own; not together with `mask`.
            sensing: how the model's objects were sensed (`model.sensing`); None: as shipped models' are.
            changes: settings of conf/scene, such as table="find", crop_low, gravity.

        Raises:
            InputError: in one line, for whatever cannot be used.

        A ball of 3 cm radius on a table:

        >>> import torch
        >>> from spgf_torch import Scene
        >>> draws = torch.randn(20000, 3, generator=torch.Generator().manual_seed(0))
        >>> outwards = torch.nn.functional.normalize(draws).numpy()
        >>> points = 0.03 * outwards + [0.0, 0.0, 0.03]
        >>> scene = Scene.from_points(points, normals=outwards, table=[0.0, 0.0, 1.0, 0.0])
        >>> scene.targets, len(scene.obstacles)
        ((1,), 0)
        >>> round(scene.texlets.positions.mean(0)[2].item(), 2)  # m above the table
        0.03
        """
        from spgf_torch.scene.arrays import clouds_of_arrays
        from spgf_torch.scene.assembly import scene_of_clouds

        config = settings(SceneConfig, **changes)
        clouds = clouds_of_arrays(points, normals, viewpoints, mask, segments, config)
        return _with_warnings(scene_of_clouds(clouds, config, *_defaults(sensing)))

    @staticmethod
    def from_depth(
        depth: Any,
        K: Any,
        T_input_camera: Any = None,
        *,
        mask: Any = None,
        segments: Any = None,
        sensing: SensingConfig | None = None,
        **changes: Any,
    ) -> Scene:
        """The scene that a depth image shows, or several in lists.

        Args:
            depth: (H, W) floats in m (or `unit`), or whole numbers of `depth_scale`; 0, negative, not finite: nothing.
            K: (3, 3) in pixels, of rectified images; one, or one an image.
            T_input_camera: (4, 4) the camera's pose, m; None: the scene's frame is the camera's.
            mask: (H, W), not 0: the target, 0: an obstacle; None: all is the target.
            segments: (H, W) whole numbers, each above 0 a target of its own; not together with `mask`.
            sensing, changes: see `from_points`.

        Raises:
            InputError: in one line, for whatever cannot be used.
        """
        from spgf_torch.scene.arrays import views_of_arrays
        from spgf_torch.scene.assembly import scene_of_views

        config = settings(SceneConfig, **changes)
        views = views_of_arrays(depth, K, T_input_camera, mask, segments, config)
        return _with_warnings(scene_of_views(views, config, *_defaults(sensing)))

    @staticmethod
    def from_files(
        files: str | Path | Sequence[str | Path], *, sensing: SensingConfig | None = None, **changes: Any
    ) -> Scene:
        """The scene in files, as `predict input=` takes them: clouds, depth images with `intrinsics`, a mesh.

        Args:
            sensing, changes: see `from_points`; all settings of conf/scene.

        Raises:
            InputError: in one line that names the file, for whatever cannot be used.
        """
        from spgf_torch.scene.assembly import read_scene

        given = [str(file) for file in files] if isinstance(files, list | tuple) else str(files)
        return _with_warnings(read_scene(settings(SceneConfig, **{**changes, "input": given}), *_defaults(sensing)))


def _defaults(sensing: SensingConfig | None) -> tuple[SensingConfig, np.random.Generator]:
    if sensing is not None and not isinstance(sensing, SensingConfig):
        raise InputError(f"sensing: expected a model's (model.sensing), got {sensing!r:.40}")
    return sensing or settings(SensingConfig), np.random.default_rng(_SEED)


def _with_warnings(scene: Scene) -> Scene:
    """Re-issue the warnings in the scene's notes as UserWarning, for programs that do not read `notes`."""
    for note in scene.notes:
        if note.startswith("warning: "):
            warnings.warn(note.removeprefix("warning: "), stacklevel=3)
    return scene


def check_spacing(scene: Scene, sensing: SensingConfig) -> None:
    """InputError for a scene that was made for models of other texlets."""
    if abs(scene.spacing - sensing.spacing) > 1e-9:
        raise InputError(
            f"scene: expected texlets {sensing.spacing:g} m apart as the model's, got {scene.spacing:g} m; make the "
            "scene with sensing=model.sensing"
        )
