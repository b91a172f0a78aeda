"""`python -m spgf_torch.predict input=FILE`: ranked grasps for what a camera or a mesh shows."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from spgf_torch.cli import door
from spgf_torch.config import GRASP_TYPES, PredictConfig
from spgf_torch.given import check_files, model_and_judge
from spgf_torch.progress import Stages, show

if TYPE_CHECKING:
    from spgf_torch.exporting.records import Grasp
    from spgf_torch.predictor import Predictor
    from spgf_torch.scene.scene import Scene


UNKNOWN = "without unseen space, which only depth images tell: behind what is seen nothing is known to be there"


def by_type(grasps: Sequence[Grasp]) -> str:
    """How many there are of each type: `10 NPG, 10 WPG`."""
    counted = Counter(grasp.type for grasp in grasps)
    return ", ".join(f"{counted[kind]} {kind}" for kind in GRASP_TYPES)


def _tell_ranking(predictor: Predictor, votes: Path | None, judge: Path | None, scene: Scene) -> None:
    """What was loaded, which of it ranks, and what the judge knows."""
    if votes is not None and predictor.model is not None:
        ranks = "its votes rank" if judge is None else "its votes are told beside each grasp"
        show(f"model: {votes.resolve()}, K = {len(predictor.model.centres)}; {ranks}")
    if judge is not None:
        known = f"unseen space from {len(scene.views)} depth images" if scene.views else UNKNOWN
        show(f"judge: {judge.resolve()}, which ranks, {known}")


def _tell_doubts(grasps: Sequence[Grasp], predictor: Predictor, scene: Scene) -> None:
    """Why there is no grasp, or that none is sure."""
    judged = predictor.judged
    if not grasps:
        nothing = "no shape here votes for any" if judged is None else "there is nothing to close on"
        show(f"no grasp: {scene.no_grasp or f'{nothing} that the open hand could reach freely'}")
    elif judged is not None and grasps[0].probability < judged.judge.sure:
        best, sure = grasps[0].probability, judged.judge.sure
        show(f"nothing sure: the best holds with a probability of {best:.0%}, less than {sure:.0%}")


def run(config: PredictConfig, folder: Path) -> None:
    """Read the scene, propose grasps, write them into `folder` in every format, with a page and a picture."""
    check_files(config, "input", "intrinsics", "poses", "mask", "segments")
    votes, judge = model_and_judge(config.model, config.judge)

    import numpy as np

    from spgf_torch.affordance.model import check_device
    from spgf_torch.exporting.graspnet import write_graspnet
    from spgf_torch.exporting.grasps_json import write_grasps
    from spgf_torch.exporting.isaac import write_isaac
    from spgf_torch.exporting.scene_page import write_scene_page
    from spgf_torch.exporting.table import grasp_table
    from spgf_torch.predictor import Predictor, sensing_of
    from spgf_torch.scene.assembly import read_scene

    stages = Stages()
    check_device(config.device)
    sensing = sensing_of(votes, judge)
    with stages.stage("scene", 1, "input") as advance:
        scene = read_scene(config, sensing, np.random.default_rng(config.seed))
        advance(1)
    for note in scene.notes:
        show(note)
    with stages.stage("model", 1, "model") as advance:
        how = (config.device, config.proposing, config.retreat, config.judge)
        predictor = Predictor.load(config.model, *how).ready()
        advance(1)
    _tell_ranking(predictor, votes, judge, scene)
    start = time.perf_counter()
    with stages.stage("grasps", len(scene.texlets), "texlets") as advance:
        grasps = predictor.predict(scene, config.N)
        advance(len(scene.texlets))
    seconds = time.perf_counter() - start

    write_grasps(folder / "grasps.json", grasps, predictor.grippers)
    write_isaac(folder / "isaac_grasp.yaml", grasps, predictor.grippers)
    write_graspnet(folder / "graspnet.npy", grasps, predictor.grippers)
    positions, normals = (t.double().numpy() for t in (scene.texlets.positions, scene.texlets.normals))
    names, pictures = predictor.names, (folder / "index.html", folder / "grasps.png")
    if len(positions):
        write_scene_page(*pictures, positions, normals, grasps, predictor.grippers, names)
    if grasps:
        show(grasp_table(grasps[: config.N], names, targets=len(scene.targets) > 1))
    _tell_doubts(grasps, predictor, scene)
    for target in scene.targets if len(scene.targets) > 1 else ():
        show(f"target {target}: {sum(grasp.target == target for grasp in grasps)} grasps")
    show(f"{len(grasps)} grasps ({by_type(grasps)}) from {len(scene.texlets)} texlets in {seconds:.2f} s")
    show(f"files{' and page' if len(positions) else ''} in {folder}")


if __name__ == "__main__":
    door("predict", PredictConfig, run)
