"""A run over scenes: which there are, those that are kept, those that are cleared now; and its files."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf

from spgf_torch.clearing.comparison import OtherRun, beside, beside_lines
from spgf_torch.clearing.config import NETWORK, OURS, ClutterConfig
from spgf_torch.clearing.contact_graspnet import ContactGraspNet
from spgf_torch.clearing.learned import Learned
from spgf_torch.clearing.methods import Ours
from spgf_torch.clearing.outcomes import RESULTS, attempt_rows, clutter_results, csv_text, rates, scene_row
from spgf_torch.clearing.processes import NOT_OF_SCENES, SceneTask, cleared_scenes
from spgf_torch.clearing.rounds import ClearedScene
from spgf_torch.clearing.scene_files import SceneFiles
from spgf_torch.clearing.tables import cause_lines, causes_picture
from spgf_torch.drawing.clutter_page import write_clutter_page
from spgf_torch.drawing.clutter_records import Summary
from spgf_torch.drawing.film import write_film
from spgf_torch.errors import InputError
from spgf_torch.evaluation.files import rounded
from spgf_torch.extras import installed
from spgf_torch.files.digests import sealed_json, sealed_yaml
from spgf_torch.files.reading import yaml_values
from spgf_torch.files.writing import write_bytes, write_text
from spgf_torch.hands.hand import Hand
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.progress import ProgressReporter, console
from spgf_torch.settings import plain
from spgf_torch.simulation.arrangements import fitting

ATTEMPTS, PER_SCENE, CAUSES = "attempts.csv", "scenes.csv", "causes.png"
PAGE, FILM = "index.html", "film.gif"
SETTINGS = "config.yaml"


def scene_tasks(config: ClutterConfig, learned: Learned, objects: Sequence[GraspObject]) -> list[SceneTask]:
    """The scenes in order: number k has the seed `config.seed` + k, and its objects are of the pool of that number.

    Raises InputError for pools from which no scene can be arranged, and for a film of none of the scenes.
    """
    if config.film is not None and config.film >= config.scenes:
        raise InputError(f"film: expected a scene from 0 to {config.scenes - 1}, or null; got {config.film}")
    pools = learned.pools(objects)
    for _, pool in pools:
        fitting(pool, config.arrangement)
    tasks = []
    for number in range(config.scenes):
        seed = config.seed + number
        fold, pool = pools[seed % len(pools)]
        filmed = number == config.film
        tasks.append(SceneTask(number, seed, tuple(pool), fold, learned.folders(fold), filmed))
    return tasks


def check_method(config: ClutterConfig, learned: Learned, folds: Sequence[int | None]) -> set[str]:
    """Load what plans, once, so that what is wrong with it is told before anything is begun.

    Returns the digests of the objects that it has learned from. Raises InputError.
    """
    if config.method == NETWORK:
        ContactGraspNet.of(str(config.cgn))
    taught: set[str] = set()
    for fold in folds if config.method == OURS else ():
        predictor = Ours.of(learned.folders(fold), config).predictor
        its = predictor.judged.judge.taught if predictor.judged else predictor.model.settings.get("taught")  # type: ignore[union-attr]
        taught |= set(dict(its or {}).values())
    return taught


def cleared(
    tasks: Sequence[SceneTask], files: SceneFiles, config: ClutterConfig, stages: ProgressReporter
) -> tuple[list[ClearedScene], list[str]]:
    """All scenes that have an end, in order, kept ones and those cleared now; and a line on each that has none.

    The settings are written beside them. Interrupted, it says what is kept. Raises InputError where kept scenes were
    made with other settings.
    """
    done = _kept(tasks, files, config)
    write_bytes(files.folder / SETTINGS, sealed_yaml(OmegaConf.to_yaml(OmegaConf.create(plain(config)))))
    died: dict[int, str] = {}
    left = [task for task in tasks if task.number not in done]
    if done and left:
        console.print(f"{len(done)} of {len(tasks)} scenes are kept in {files.folder}")
    try:
        with stages.stage("scenes", len(left), "scenes") as advance, closing(cleared_scenes(left, config)) as ended:
            for task, result in ended:
                if isinstance(result, ClearedScene):
                    files.write(result)
                    done[task.number] = result
                else:
                    died[task.number] = f"scene {task.number}: {result}"
                advance(1)
    except KeyboardInterrupt:
        if done:
            kept = f"{len(done)} of {len(tasks)} scenes are kept"
            console.print(f"{kept}: the same call with out={files.folder} goes on")
        raise
    return [done[number] for number in sorted(done)], [died[number] for number in sorted(died)]


def _kept(tasks: Sequence[SceneTask], files: SceneFiles, config: ClutterConfig) -> dict[int, ClearedScene]:
    """Number -> finished scene. Raises InputError for those of other settings, with the first that differs."""
    try:
        return {task.number: scene for task in tasks if (scene := files.read(task.number)) is not None}
    except InputError as error:
        raise _changed(files.folder, config) or error from None


def _changed(folder: Path, config: ClutterConfig) -> InputError | None:
    """That a setting is not that of the kept scenes; None where none is known to differ, as of another version."""
    with suppress(InputError):
        before = dict(_flat(yaml_values(folder / SETTINGS, "settings of clutter", sealed=True)))
        for key, got in _flat(plain(config)):
            if key.split(".")[0] not in NOT_OF_SCENES and key in before and before[key] != got:
                return InputError(f"{key}: expected {before[key]}, as the scenes kept in {folder} have; got {got}")
    return None


def _flat(values: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Settings as (dotted key, value)."""
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value


def write_files(
    scenes: Sequence[ClearedScene], others: Sequence[OtherRun], config: ClutterConfig, folder: Path
) -> dict[str, Any]:
    """Write CSV, picture and results, those of other runs beside; return the results.

    Raises InputError for a run of other scenes.
    """
    results = clutter_results(scenes, config)
    if others:
        results["beside"] = beside(results, others, config)
    write_text(folder / ATTEMPTS, csv_text([row for scene in scenes for row in attempt_rows(scene)]))
    write_text(folder / PER_SCENE, csv_text([scene_row(scene) for scene in scenes]))
    if results["causes"]:
        write_bytes(folder / CAUSES, causes_picture(results["causes"], results["attempts"]))
    write_bytes(folder / RESULTS, sealed_json(rounded(results), indent=1))
    return results


def write_pictures(
    scenes: Sequence[ClearedScene], results: Mapping[str, Any], others: Sequence[OtherRun], hand: Hand, folder: Path
) -> list[str]:
    """Write the film of the scene that was filmed, and the page where plotly is installed; their names.

    The page lists other runs beside this one, and the worst scenes of this one.
    """
    films = [scene.round for scene in scenes if any(each.clip is not None for each in scene.round.attempts)]
    for each in films[:1]:
        write_film(folder / FILM, each, hand)
    written = [FILM] * bool(films)
    if not installed("plotly"):
        return written
    names = [f"{other.results['method']} ({other.folder.name})" for other in others]
    methods = [rates(results, results["method"])]
    methods += [rates(other.results, name) for other, name in zip(others, names, strict=True)]
    views = f"{results['views']} view{'s' * (results['views'] > 1)}"
    lines = [f"{results['arrangement']}, {views}, {results['hand']}, scenes of seeds from {results['seed']} on"]
    summary = Summary("Clutter", methods, [*lines, *cause_lines(results)], beside_lines(results))
    film = folder / FILM if films else None
    write_clutter_page(folder / PAGE, summary, [scene.round for scene in scenes], hand, film=film)
    return [PAGE, *written]
