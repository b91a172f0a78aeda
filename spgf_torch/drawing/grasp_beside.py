"""What a page shows beside targets and grasps, gathered from a scene, a hand, a judge and prototypes."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from spgf_torch.drawing.grasp_scene import Beside, Told
from spgf_torch.drawing.judge_words import WeighedNumber, weighed_words
from spgf_torch.drawing.page_hands import fractions
from spgf_torch.drawing.prototype_picture import prototype_svg
from spgf_torch.hands.hand import Hand, closing_poses
from spgf_torch.hands.records import Grasp
from spgf_torch.proposing.judge import Judge
from spgf_torch.proposing.judge_influences import weighed
from spgf_torch.scene.scene import Scene

SHORT = 8  # letters of a digest that are shown
DIGEST = "tensors_sha256"  # key in model.json and judge.json


def beside_of(
    scene: Scene,
    grasps: Sequence[Grasp],
    hand: Hand | None,
    judge: Judge | None = None,
    rings_deg: np.ndarray | None = None,
    told: Told | None = None,
) -> Beside:
    """All that a page shows beside the targets and `grasps`.

    Args:
        hand: None: not known, it is shown open alone. judge: who ranked; None: the votes.
        rings_deg: (K, 2, cells, 2) of the prototypes, degrees; None: of another descriptor, or none.
        told: what is said in words.
    """
    return Beside(
        obstacles=scene.obstacles.double().numpy(),
        table=scene.table,
        sensed=scene.sensed,
        cameras=_cameras(scene),
        told=told or Told(notes=scene.notes),
        weighed=_weighed(grasps, judge),
        pictures={} if rings_deg is None else _pictures(grasps, rings_deg),
        closing=_closings(grasps, hand),
    )


def model_words(folder: Path) -> str:
    """A model or judge by the name of its folder and the beginning of its tensors' digest: `panda (3b6d4dc3)`."""
    for name in ("model.json", "judge.json"):
        if (path := folder / name).is_file():
            digest = str(json.loads(path.read_text(encoding="utf-8")).get(DIGEST, ""))[:SHORT]
            return f"{folder.resolve().name} ({digest})" if digest else folder.resolve().name
    return folder.resolve().name


def _closings(grasps: Sequence[Grasp], hand: Hand | None) -> dict[str, np.ndarray]:
    """Grasp type -> how the shapes of its hand move while it closes."""
    types = sorted({grasp.type for grasp in grasps})
    return {} if hand is None else {name: closing_poses(hand, name, fractions()) for name in types}


def _pictures(grasps: Sequence[Grasp], rings_deg: np.ndarray) -> dict[int, str]:
    """SVG of each prototype that voted, by number."""
    return {k: prototype_svg(rings_deg[k]) for k in sorted({k for grasp in grasps for k, _ in grasp.voted_by})}


def _weighed(grasps: Sequence[Grasp], judge: Judge | None) -> tuple[tuple[WeighedNumber, ...], ...]:
    if judge is None:
        return ()
    known = [grasp.numbers for grasp in grasps if grasp.numbers is not None]
    types = sorted(judge.grasp_types)
    return tuple(weighed_words(weights, types) for weights in weighed(judge, known))


def _cameras(scene: Scene) -> tuple[tuple[np.ndarray, np.ndarray | None, np.ndarray | None], ...]:
    """Of each view where it was, how it looked, and how far its image reaches 1 m ahead; else the places alone."""
    if scene.views:
        found = []
        for view in scene.views:
            (height, width), K = view.depth.shape, view.K.double().numpy()
            pixels = np.array([[-0.5, -0.5, 1.0], [width - 0.5, height - 0.5, 1.0]])
            reach = (pixels @ np.linalg.inv(K).T)[:, :2]
            found.append((view.eye.double().numpy(), view.rotation.double().numpy(), reach))
        return tuple(found)
    return tuple((place, None, None) for place in (() if scene.viewpoints is None else scene.viewpoints))
