"""The page and the picture of grasps on what was seen."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from spgf_torch.drawing.grasp_beside import beside_of, model_words
from spgf_torch.drawing.grasp_page import write_scene_page
from spgf_torch.drawing.grasp_scene import Told

if TYPE_CHECKING:
    from spgf_torch.grasps.grasps import Grasps
    from spgf_torch.predictor import Predictor


def head_of(model: Predictor, file: str = "", **more: str) -> list[tuple[str, str]]:
    """What a page says of itself: file, model with digest, date and `more` (a version); without what is empty."""
    folders = dict.fromkeys(folder for folder in (model.folder, model.judge_folder) if folder is not None)
    head = {
        "file": file,
        "model": ", judge ".join(map(model_words, folders)),
        "date": time.strftime("%Y-%m-%d %H:%M"),
        **more,
    }
    return [(name, words) for name, words in head.items() if words]


def write_page(
    grasps: Grasps,
    folder: Path,
    head: Sequence[tuple[str, str]] | None = None,
    lines: Sequence[str] = (),
    doubts: Sequence[str] = (),
) -> list[Path]:
    """Write `grasps.png` and `index.html`, in the scene's frame.

    Args:
        head: name and value of what the page says of itself beside the hand, as `head_of` makes it: `file` is in its
            title; None: without a file.
        lines: of plain text, on how the grasps came about. doubts: why there is none, or none that is sure.

    Returns the paths; none where nothing was seen that can be drawn.
    """
    source = grasps.source
    assert source is not None  # who calls has looked
    model, scene = source.model, source.scene
    if not len(scene.texlets):
        return []
    T_scene_grasps = np.linalg.inv(source.T_grasps_scene)
    shown = grasps if np.array_equal(T_scene_grasps, np.eye(4)) else grasps.transform(T_scene_grasps)
    judge = None if model.judged is None else model.judged.judge
    rings = None if model.model is None or model.model.descriptor != "spgf" else model.model.rings_deg()
    own = () if model.hand is None else (("hand", model.hand.config.name),)
    head = head_of(model) if head is None else head
    told = Told((*own, *head), tuple(lines), tuple(doubts), scene.notes)
    beside = beside_of(scene, shown, model.hand, judge, rings, told)
    positions, normals = scene.texlets.positions.double().numpy(), scene.texlets.normals.double().numpy()
    page, picture = folder / "index.html", folder / "grasps.png"
    write_scene_page(page, picture, positions, normals, shown, grasps.grippers, grasps.names, beside)
    return [page, picture]
