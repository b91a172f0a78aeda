"""The page and the picture of grasps on what was seen."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from spgf_torch.drawing.grasp_page import write_scene_page
from spgf_torch.drawing.grasp_scene import Beside
from spgf_torch.drawing.judge_words import weighed_words
from spgf_torch.drawing.page_hands import fractions
from spgf_torch.extras import installed
from spgf_torch.hands.hand import closing_poses
from spgf_torch.proposing.judge_influences import weighed

if TYPE_CHECKING:
    from spgf_torch.grasps.grasps import Grasps
    from spgf_torch.predictor import Predictor


def write_page(grasps: Grasps, folder: Path, lines: Sequence[str] = ()) -> list[Path]:
    """Write `grasps.png` and, where plotly is installed, `index.html`, with `lines`, in the scene's frame.

    Returns the paths; none where nothing was seen that can be drawn.
    """
    source = grasps.source
    assert source is not None  # who calls has looked
    model, scene = source.model, source.scene
    if not len(scene.texlets):
        return []
    T_scene_grasps = np.linalg.inv(source.T_grasps_scene)
    shown = grasps if np.array_equal(T_scene_grasps, np.eye(4)) else grasps.transform(T_scene_grasps)
    words: tuple[str, ...] = ()
    if model.judged is not None:
        known = [grasp.numbers for grasp in grasps if grasp.numbers is not None]
        names = sorted(model.grippers)
        words = tuple(weighed_words(weights, names) for weights in weighed(model.judged.judge, known))
    closing = closings(model) if grasps else {}
    beside = Beside(scene.obstacles.double().numpy(), scene.table, tuple(lines), scene.notes, words, closing)
    positions, normals = scene.texlets.positions.double().numpy(), scene.texlets.normals.double().numpy()
    page, picture = folder / "index.html" if installed("plotly") else None, folder / "grasps.png"
    write_scene_page(page, picture, positions, normals, shown, grasps.grippers, grasps.names, beside)
    return [path for path in (page, picture) if path is not None]


def closings(model: Predictor) -> dict[str, np.ndarray]:
    """Grasp type -> how the shapes of its hand move while it closes."""
    hand = model.hand
    return {} if hand is None else {name: closing_poses(hand, name, fractions()) for name in model.grippers}
