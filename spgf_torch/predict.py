"""`python -m spgf_torch.predict input=FILE`: ranked grasps for what a camera or a mesh shows."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from spgf_torch import __version__
from spgf_torch.cli.batch import run_each
from spgf_torch.cli.command import command_line, run_command
from spgf_torch.compiled import loops_kept, loops_wanted, spare_loops
from spgf_torch.errors import InputError
from spgf_torch.files.given_paths import check_files, model_and_judge
from spgf_torch.progress import ProgressReporter, show
from spgf_torch.scene.config import PredictConfig

if TYPE_CHECKING:
    from spgf_torch.hands.records import Grasp
    from spgf_torch.predictor import Predictor
    from spgf_torch.scene.scene import Scene

# Bytes of input from which compiled loops are worth half a minute: a cloud of 12,000 points has 0.3 MB, one of 100,000
# 2.4 MB (`SPGF_OPS=torch` with tests/benchmarks/prediction.py, and without).
_LOOPS_FROM = 2_000_000


def by_type(grasps: Sequence[Grasp], grasp_types: Iterable[str]) -> str:
    """How many there are of each type: `10 NPG, 10 WPG`."""
    counted = Counter(grasp.type for grasp in grasps)
    return ", ".join(f"{counted[grasp_type]} {grasp_type}" for grasp_type in sorted(grasp_types))


def _ranking(predictor: Predictor, votes: Path | None, judge: Path | None, scene: Scene) -> list[str]:
    """What was loaded, which model it is, which of it ranks, and what the judge knows: a line each."""
    from spgf_torch.proposing.model_folder import Identity

    lines = []
    if votes is not None and predictor.model is not None:
        ranks = "its votes rank" if judge is None else "its votes are shown beside each grasp"
        which, K = Identity.of(predictor.model).words(), len(predictor.model.centres)
        lines.append(f"model: {which}, K = {K}; {ranks}; in {votes.resolve()}")
    if judge is not None and predictor.judged is not None:
        which = Identity.of(predictor.judged.judge).words()
        lines.append(f"judge: {which}, which ranks, {scene.unseen or 'without unseen space'}; in {judge.resolve()}")
    return lines


def _doubts(grasps: Sequence[Grasp], predictor: Predictor, scene: Scene) -> str | None:
    """Why there is no grasp, or that none is sure."""
    judged = predictor.judged
    if not grasps:
        nothing = "no shape here votes for any" if judged is None else "there is nothing to close on"
        away = "" if scene.borders is None else ", away from the borders of what was seen"
        return f"no grasp: {scene.no_grasp or f'{nothing} that the open hand could reach freely{away}'}"
    if judged is None or grasps[0].probability >= judged.judge.sure:
        return None
    best, sure = grasps[0].probability, judged.judge.sure
    return f"nothing sure: the best holds with a probability of {best:.0%}, less than {sure:.0%}"


def _head(config: PredictConfig, predictor: Predictor) -> list[tuple[str, str]]:
    """What a page says of itself: file, model, date, version, command."""
    from spgf_torch.grasps.page import head_of

    files = config.input if isinstance(config.input, list) else [config.input]
    names = ", ".join(Path(str(file)).name for file in files)
    return head_of(predictor, names, version=f"spgf_torch {__version__}", command=command_line())


def _files(folder: Path, anything: bool) -> str:
    """What there is in `folder`; `anything`: something was seen that can be shown."""
    return f"files{' and page' if anything else ''} in {folder}"


def run(config: PredictConfig, folder: Path) -> None:
    """Read the scene, propose grasps, write them into `folder` in every format, with a page and a picture.

    Of a batch, each file has a folder in it; the model is loaded once.
    """
    loaded = cache(lambda: _loaded(config))
    files = [str(file) for file in (config.input if isinstance(config.input, list) else [config.input])]
    if not loops_kept() and _size(files) < _LOOPS_FROM:
        spare_loops()
    if not config.batch:
        _predict(config, folder, loaded)
        return
    if not files:
        raise InputError("input: expected a list of files (input=[FILE,FILE]), got an empty one")
    model_and_judge(config.model, config.judge)

    def one(file: str, place: Path) -> None:
        show(f"{file}:")
        _predict(replace(config, input=file), place, loaded)

    run_each("predict", files, folder, one)


def _size(files: Sequence[str]) -> int:
    """Bytes of those that exist."""
    return sum(Path(file).stat().st_size for file in files if Path(file).is_file())


def _loaded(config: PredictConfig) -> Predictor:
    """The predictor; what it builds and compiles at its first prediction is the time of the first scene."""
    from spgf_torch.predictor import Predictor

    if loops_wanted() and not loops_kept():
        show("compiling inner loops, once on this machine: some half a minute")
    with ProgressReporter().stage("model", 1, "model") as advance:
        how = (config.device, config.proposing, config.retreat, config.judge)
        predictor = Predictor.load(config.model, *how)
        advance(1)
    return predictor


def _predict(config: PredictConfig, folder: Path, loaded: Callable[[], Predictor]) -> None:
    """Grasps of one scene, with the predictor that `loaded` gives, into `folder`."""
    check_files(config, "input", "intrinsics", "poses", "mask", "segments")
    votes, judge = model_and_judge(config.model, config.judge)

    import numpy as np

    from spgf_torch.affordance.model import check_device
    from spgf_torch.grasps.page import write_page
    from spgf_torch.grasps.saving import left_out, save
    from spgf_torch.predictor import sensing_of
    from spgf_torch.scene.assembly import read_scene

    stages = ProgressReporter()
    check_device(config.device)
    sensing = sensing_of(votes, judge)
    with stages.stage("scene", 1, "input") as advance:
        scene = read_scene(config, sensing, np.random.default_rng(config.seed))
        advance(1)
    predictor = loaded()
    for line in (*(ranking := _ranking(predictor, votes, judge, scene)), *scene.notes):
        show(line)
    start = time.perf_counter()
    with stages.stage("grasps", len(scene.texlets), "texlets") as advance:
        grasps = predictor.predict(scene, config.N)
        advance(len(scene.texlets))
    seconds = time.perf_counter() - start

    doubts = _doubts(grasps, predictor, scene)
    save(grasps, folder)
    told = _head(config, predictor), ranking, [doubts] if doubts else ()
    write_page(grasps, folder, *told)
    _tell(grasps, predictor, scene, config.N, (doubts, left_out(grasps)))
    counted = by_type(grasps, predictor.grippers)
    show(f"{len(grasps)} grasps ({counted}) from {len(scene.texlets)} texlets in {seconds:.2f} s")
    show(_files(folder, bool(len(scene.texlets))))


def _tell(
    grasps: Sequence[Grasp], predictor: Predictor, scene: Scene, top: int, beside: tuple[str | None, str | None]
) -> None:
    """Show the `top` first grasps, then doubts, what graspnet.npy lacks, and how many each target has."""
    from spgf_torch.drawing.grasp_table import grasp_table

    doubts, left = beside
    if grasps:
        show(grasp_table(grasps[:top], predictor.names, targets=len(scene.targets) > 1))
    if doubts:
        show(doubts)
    if left:
        show(left)
    for note in scene.notes:
        if note.startswith("warning: "):  # once more, where it is seen: a long table has followed the first time
            show(note)
    for target in scene.targets if len(scene.targets) > 1 else ():
        show(f"target {target}: {sum(grasp.target == target for grasp in grasps)} grasps")


if __name__ == "__main__":
    run_command("predict", PredictConfig, run)
