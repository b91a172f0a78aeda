"""`python -m spgf_torch.judge hand=panda`: a hand's judge of grasp hypotheses, from trials of its own choosing.

`python -m spgf_torch.train hand=panda judge=learn` learns it together with a votes' model.
"""

from __future__ import annotations

from pathlib import Path

from spgf_torch.cli.command import run_command
from spgf_torch.errors import InputError
from spgf_torch.extras import needed
from spgf_torch.files.given_paths import check_folder
from spgf_torch.judging.config import JudgeConfig
from spgf_torch.progress import ProgressReporter, show

TABLES = {"trials": "the trial tables that simulate leaves", "own_trials": "the tables of own trials that judge leaves"}


def run(config: JudgeConfig, folder: Path) -> None:
    """Sense the objects, try random and then chosen grasps, learn, measure; write judge and trials into `folder`."""
    needed("learning", "sklearn")
    if config.runner == "dask":
        needed("runner: dask", "distributed")
    check_folder("objects", config.objects, "a folder of meshes or descriptions")
    for key, what in TABLES.items():
        if getattr(config, key) is not None:
            check_folder(key, getattr(config, key), what)

    from spgf_torch.cache import Cache
    from spgf_torch.evaluation.tables import hopeless_types
    from spgf_torch.handcheck.standing import tried_hand
    from spgf_torch.judging.judge_training import Course
    from spgf_torch.judging.making_trials import TRIALS, write_tables
    from spgf_torch.judging.scene_validation import scenes_table
    from spgf_torch.judging.settings import stages as plan
    from spgf_torch.judging.validation import executed_table
    from spgf_torch.objects.folders import read_objects
    from spgf_torch.paths import find

    _check_scenes(config)
    tried_hand(config.hand, config.episode)
    stages, cache = ProgressReporter(plan(config, config.trials is not None)), Cache.open(config.cache, config.cache_gb)
    found = read_objects(config, stages, cache)
    for note in found.notes:
        show(note)
    course = Course.of(found.objects, config, cache, stages)
    with cache.going_on():
        if config.known is not None:
            lessons = course.in_scenes(course.known(find(config.known)))
        else:
            tables = course.tables()
            for line in hopeless_types(tables, config.hand.name):
                show(line)
            lessons = course.judge(tables)
            if config.trials is None:
                write_tables(tables, folder / TRIALS)
    size = course.save(lessons, folder, "README.md")
    show(executed_table(dict(lessons.judge.results["executed"]), config.best))
    if lessons.scenes is not None:
        show(scenes_table(dict(lessons.judge.results["in_scenes"])))
    show(f"judge of {size / 1e6:.2f} MB, trials and settings in {folder}, which predict and evaluate take as model=")


def _check_scenes(config: JudgeConfig) -> None:
    """InputError for settings of learning in scenes without scenes."""
    given = {"known": config.known, "scene_trials": config.scene_trials}
    for key, value in given.items():
        if value is not None and config.context is None:
            raise InputError(f"{key}: expected with +context=tabletop, got it without scenes")
    if (scenes := config.context) is None:
        return
    if scenes.proposing.neighbours is None:
        raise InputError("context.proposing: expected neighbours, as conf/proposing/clutter.yaml has them; got none")
    if not scenes.views or not 1 <= min(scenes.views) <= max(scenes.views) <= 24:
        raise InputError(f"context.views: expected numbers of cameras from 1 to 24, got {scenes.views}")
    learned = range(scenes.first, scenes.first + scenes.rounds * scenes.number)
    measured = range(scenes.first_measured, scenes.first_measured + scenes.measured)
    if learned and measured and learned.start < measured.stop and measured.start < learned.stop:
        raise InputError(
            f"context.first_measured: expected seeds beside those that teach, {learned.start} to {learned.stop - 1}, "
            f"got {measured.start} to {measured.stop - 1}"
        )


if __name__ == "__main__":
    run_command("judge", JudgeConfig, run)
