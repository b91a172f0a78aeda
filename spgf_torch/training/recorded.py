"""What recorded trials teach: the table, what its clouds or the objects' meshes show, and what cannot be learned."""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence

import numpy as np
import torch

from spgf_torch.cache import Cache
from spgf_torch.errors import InputError
from spgf_torch.experiment.config import TrainConfig
from spgf_torch.experiment.describe import Seen
from spgf_torch.experiment.recorded_view import RecordedView
from spgf_torch.formats.recorded_rows import Recording
from spgf_torch.formats.recorded_trials import RecordedTable, RecordedTrials, read_recorded
from spgf_torch.hands.hand import load_hand
from spgf_torch.objects.config import CLASSES
from spgf_torch.objects.folders import LISTED, read_objects
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.paths import find
from spgf_torch.progress import ProgressReporter
from spgf_torch.scene.assembly import read_scene
from spgf_torch.scene.config import SceneConfig
from spgf_torch.settings import settings
from spgf_torch.training.taught import Taught, Tell, counts

# m from the box around what was grasped: a TCP farther out is in another frame, or in mm.
NEAR = 0.2


def recorded(config: TrainConfig, cache: Cache, stages: ProgressReporter, tell: Tell) -> Taught:
    """The trials in the file `config.trials`, with what was grasped. InputError for what cannot be learned from."""
    table = read_recorded(find(config.trials), load_hand(config.hand))
    if table.ignored:
        tell(f"{table.path}: nothing is done with the columns {', '.join(table.ignored)}")
    bodies = _bodies(table, config, cache, stages, tell)
    seen: list[Seen] = []
    with stages.stage("recordings", len(table.views), "objects and clouds") as advance:
        for number, (recording, trials) in enumerate(table.views):
            its = bodies[recording.object_name] if recording.cloud is None else _view(table, number, config)
            _check_near(table, its, trials)
            seen.append(its)
            advance(1)
    taught = Taught(seen, [trials for _, trials in table.views])
    counts(taught.tables, tell)
    return Taught(seen, taught.tables, _unlearned(table, taught, config.N, tell))


def _bodies(
    table: RecordedTable, config: TrainConfig, cache: Cache, stages: ProgressReporter, tell: Tell
) -> Mapping[str, GraspObject]:
    """The meshes in `objects` that the trials are on, by name; none are read where all have clouds."""
    wanted = {recording.object_name: recording for recording, _ in table.views if recording.cloud is None}
    if not wanted:
        return {}
    found = read_objects(config, stages, cache)
    for note in found.notes:
        tell(note)
    bodies = {obj.name: obj for obj in found.objects}
    for name, recording in wanted.items():
        if name not in bodies:
            raise InputError(
                f"{table.path}: row {recording.row}: object: expected one of objects={config.objects}, or a cloud, "
                f"got {name!r}"
            )
    return bodies


def _view(table: RecordedTable, number: int, config: TrainConfig) -> RecordedView:
    """What a recorded cloud shows."""
    recording = table.views[number][0]
    assert recording.cloud is not None  # others are bodies
    views = [each for each, _ in table.views if each.object_name == recording.object_name]
    suffix = f".{views.index(recording) + 1}" if len(views) > 1 else ""
    name = recording.object_name + suffix
    given = {} if recording.viewpoint is None else {"viewpoints": [list(recording.viewpoint)]}
    where = f"{table.path}: row {recording.row}"
    try:
        scene_config = settings(SceneConfig, **{**config.recorded, "input": str(recording.cloud), **given})
    except InputError as error:
        raise InputError(f"recorded.{error}") from None
    generator = np.random.default_rng([config.seed, zlib.crc32(name.encode())])
    try:
        scene = read_scene(scene_config, config.sensing, generator)
    except InputError as error:
        raise InputError(f"{where}: cloud: {error}") from None
    if scene.no_grasp is not None:
        raise InputError(f"{where}: cloud: expected an object's surface in {recording.cloud}, got {scene.no_grasp}")
    return RecordedView(name, recording.object_name, _category(recording, where, config), scene.texlets)


def _category(recording: Recording, where: str, config: TrainConfig) -> str:
    if recording.category is not None:
        return recording.category
    if config.category == LISTED:
        raise InputError(
            f"{where}: class: expected one for the folds, or category={'|'.join(CLASSES)} for all; got none"
        )
    return config.category


def _check_near(table: RecordedTable, its: Seen, trials: RecordedTrials) -> None:
    """InputError for a pose that has nothing to do with what was grasped."""
    points = its.texlets.positions if isinstance(its, RecordedView) else torch.tensor(its.mesh.bounds.tolist())
    low, high = points.min(dim=0).values, points.max(dim=0).values
    position = trials.T_object_tcp[:, :3, 3]
    away = (torch.maximum(low - position, position - high).clamp_min(0)).norm(dim=1)
    if float(away.max()) > NEAR:
        row = trials.rows[int(away.argmax())]
        raise InputError(
            f"{table.path}: row {row}: x: expected a TCP within {NEAR:g} m of {its.name}, "
            f"got one {float(away.max()):.3g} m away; another frame, or mm?"
        )


def _unlearned(table: RecordedTable, taught: Taught, n: int, tell: Tell) -> str:
    """Tell what cannot be learned, type by type; why there can be no rates, if so.

    Raises InputError where nothing can be: none succeeded, or none failed.
    """
    success = torch.cat([trials.success for trials in taught.tables])
    if bool(success.all()) or not bool(success.any()):
        kind, lacks = ("held", "failed") if bool(success.all()) else ("failed", "held")
        raise InputError(
            f"{table.path}: success: expected trials that {lacks}, too: what tells the two apart is learned; got "
            f"{len(success)} that all {kind}"
        )
    by_object, types = taught.by_object(), taught.tables[0].grasp_types
    grasp_type = torch.cat([trials.grasp_type for trials in taught.tables])
    for code, name in enumerate(types):
        own = success[grasp_type == code]
        if not len(own):
            tell(f"{name}: no trials: no grasp of this type will be proposed")
        elif bool(own.all()) or not bool(own.any()):
            held = "held" if bool(own.all()) else "failed"
            tell(f"{name}: all {len(own)} trials {held}: nothing is learned of which grasps of this type hold")
    return _why_unmeasured(by_object, list(taught.members), types, n, tell)


def _why_unmeasured(by_object: Sequence[object], names: Sequence[str], types: Sequence[str], n: int, tell: Tell) -> str:
    few: list[str] = []
    for name, trials in zip(names, by_object, strict=True):
        assert isinstance(trials, RecordedTrials)  # of a table that was recorded
        for code, grasp_type in enumerate(types):
            tried = int((trials.grasp_type == code).sum())
            if not tried:
                return f"{name} has no trials of {grasp_type}, whose rate would be that of other objects"
            if tried < n:
                few.append(f"{name} {tried} of {grasp_type}")
    if few:
        tell(
            f"fewer than N={n} trials, whose best are then all of them: {', '.join(few[:3])}{' ...' if few[3:] else ''}"
        )
    return ""
