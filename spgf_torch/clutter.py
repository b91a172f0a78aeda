"""`python -m spgf_torch.clutter arrangement=pile`: tables full of things, cleared grasp by grasp in SAPIEN.

Scenes of objects, packed or in piles, follow from their seed alone. Each is sensed by noisy depth cameras; a method
plans a grasp; a free-flying hand approaches, closes and lifts in physics; and so on until the scene is clear, there is
no grasp, or two fail in a row. The run's folder holds `results.json`, `attempts.csv`, `scenes.csv`, page and pictures.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from spgf_torch.clearing.config import ClutterConfig
from spgf_torch.clearing.learned import Learned
from spgf_torch.cli.command import run_command
from spgf_torch.errors import IncompleteError
from spgf_torch.extras import installed, remedy
from spgf_torch.files.given_paths import check_folder
from spgf_torch.files.writing import check_place
from spgf_torch.progress import ProgressReporter, show

if TYPE_CHECKING:
    from collections.abc import Sequence

    from spgf_torch.objects.grasp_object import GraspObject


def run(config: ClutterConfig, folder: Path) -> None:
    """Clear the scenes and write what became of them into `out` (default: the run's folder); finished ones are kept.

    Raises IncompleteError where a scene could not be finished.
    """
    check_place("out", config.out)
    check_folder("objects", config.objects, "a folder of meshes or descriptions")
    learned = Learned.of(config)
    for name in config.beside or ():
        check_folder("beside", name, "the folder of another run of clutter")

    from spgf_torch.clearing.comparison import OtherRun, beside_lines
    from spgf_torch.clearing.processes import made_with
    from spgf_torch.clearing.scene_files import SceneFiles
    from spgf_torch.clearing.session import check_method, cleared, scene_tasks, write_files, write_pictures
    from spgf_torch.clearing.tables import cause_lines, clutter_table
    from spgf_torch.handcheck.standing import tried_hand

    stages, others = ProgressReporter(), [OtherRun.read(other) for other in config.beside or ()]
    for other in others:
        other.check(config)
    objects = _objects(config, stages)
    tasks = scene_tasks(config, learned, objects)
    taught = check_method(config, learned, sorted({task.fold for task in tasks}, key=str))
    hand = tried_hand(config.hand, config.episode)
    out = Path(config.out) if config.out else folder
    parts = [[obj.digest for obj in objects], learned.digests()]
    files = SceneFiles(out, made_with(config, parts), {obj.name: obj for obj in objects})
    with files.open():
        scenes, died = cleared(tasks, files, config, stages)
        results = write_files(scenes, others, config, out)
        pictures = write_pictures(scenes, results, others, hand, out)
    show(clutter_table(results))
    for line in (*cause_lines(results), *beside_lines(results), *_not_novel(objects, taught, config)):
        show(line)
    show(f"results, attempts, {', '.join(pictures)} in {out}" if pictures else f"results and attempts in {out}")
    if not installed("plotly"):
        show(f"no page, for which {remedy('plotly')} is needed")
    if died:
        raise IncompleteError(
            f"{len(died)} of {len(tasks)} scenes without an end: {died[0]}; the same call with out={out} tries again"
        )


def _objects(config: ClutterConfig, stages: ProgressReporter) -> Sequence[GraspObject]:
    """What lies in the folder; lines tell what it was taken for."""
    from spgf_torch.cache import Cache
    from spgf_torch.objects.folders import read_objects

    found = read_objects(config, stages, Cache.open(config.cache, config.cache_gb))
    for note in found.notes:
        show(note)
    return found.objects


def _not_novel(objects: Sequence[GraspObject], taught: set[str], config: ClutterConfig) -> list[str]:
    """What to say of rates on objects from which the model or judge has learned."""
    known = sum(obj.digest in taught for obj in objects)
    if not known or config.held_out:
        return []
    instead = "held_out=true asks those that have not seen them"
    return [f"not novel: what plans has learned from {known} of these {len(objects)} objects; {instead}"]


if __name__ == "__main__":
    run_command("clutter", ClutterConfig, run)
