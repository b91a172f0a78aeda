"""`python -m spgf_torch.simulate`: candidate grasps on objects, each tried in SAPIEN: the trial table."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from omegaconf import OmegaConf

from spgf_torch.cli.command import run_command
from spgf_torch.errors import IncompleteError, InputError
from spgf_torch.extras import needed
from spgf_torch.files.given_paths import check_folder
from spgf_torch.files.writing import check_place
from spgf_torch.progress import ProgressReporter, show
from spgf_torch.settings import plain
from spgf_torch.simulation.config import SimulateConfig

if TYPE_CHECKING:
    from spgf_torch.objects.grasp_object import GraspObject
    from spgf_torch.simulation.executors import Executor
    from spgf_torch.simulation.run_state import RunState

SHOWN = 5  # objects that failed and incidents printed one by one; the manifest has all


def run(config: SimulateConfig, folder: Path) -> None:
    """Write one Parquet file an object into `out` (default: the run's folder); what is there is kept.

    Raises IncompleteError where an object could not be finished; its manifest says why.
    """
    if config.runner == "dask":
        needed("runner: dask", "distributed")
    check_place("out", config.out)
    check_folder("objects", config.objects, "a folder of meshes or descriptions")

    from spgf_torch.files.digests import sealed_yaml
    from spgf_torch.files.writing import write_bytes
    from spgf_torch.handcheck.standing import tried_hand
    from spgf_torch.objects.folders import read_objects
    from spgf_torch.simulation.execute import made_with, provenance_of
    from spgf_torch.simulation.generation import Generation, Plan, finished, keep
    from spgf_torch.simulation.run_state import RunState
    from spgf_torch.simulation.worker import Trials

    share, out = share_of(config), Path(config.out) if config.out else folder
    stages, hand = ProgressReporter(), tried_hand(config.hand, config.episode)
    found = read_objects(config, stages)
    for note in found.notes:
        show(note)
    objects = found.objects[share[0] - 1 :: share[1]]
    trials = Trials(hand, config.episode)
    counts = (config.candidates, config.seed, config.budget)
    provenances = [provenance_of(obj, trials, config.sampler, *counts) for obj in objects]
    there = finished(out, provenances, trials.grasp_types)
    executor = executor_of(config)
    made = made_with(trials, config.sampler, *counts)
    run_state = RunState(out, share, made, len(trials.grasp_types))
    run_state.left_out = [note for note in found.notes if note.startswith("left out: ")]
    try:
        with run_state.open(provenances):
            write_bytes(out / "config.yaml", sealed_yaml(OmegaConf.to_yaml(OmegaConf.create(plain(config)))))
            for its in there:
                keep(run_state, its)
            waiting = [pair for pair in zip(objects, provenances, strict=True) if pair[1] not in there]
            with stages.stage("trials", sum(run_state.rows(its) for _, its in waiting), "candidates") as advance:
                generation = Generation(run_state, Plan(trials, config.chunk, config.failed_as), advance)
                generation.run(waiting, executor)
    except OSError as error:
        kept = f"{run_state.trials} candidates are kept there, the same call with out={out} goes on"
        raise IncompleteError(f"{out}: expected room to write, got {error.strerror or error}; {kept}") from error
    tables = _show_rates(out, objects, config)
    if generation.trials:
        show(f"{generation.trials / stages.seconds['trials']:.0f} candidates/s")
    show(f"{tables} files in {out}")
    _tell(run_state, objects)


def share_of(config: SimulateConfig) -> tuple[int, int]:
    """(i, n) of `shard`. Raises InputError for another key that does not go with what else is set, too."""
    from spgf_torch.simulation.executors import check_address
    from spgf_torch.simulation.table import OUTCOMES

    match = re.fullmatch(r"([1-9]\d{0,5})/([1-9]\d{0,5})", config.shard)
    if match is None or int(match[1]) > int(match[2]):
        raise InputError(f"shard: expected i/n with i from 1 to n, got {config.shard}")
    if int(match[2]) > 1 and not config.out:
        raise InputError("out: expected a folder, the same for all shards; got none")
    if config.failed_as not in (None, *OUTCOMES):
        raise InputError(f"failed_as: expected null or one of {', '.join(OUTCOMES)}; got {config.failed_as}")
    check_address(config.runner, config.address)
    return int(match[1]), int(match[2])


def executor_of(config: SimulateConfig) -> Executor:
    """Return the executor of the trials."""
    from spgf_torch.simulation.executors import DaskExecutor, ProcessExecutor

    if config.address:
        return DaskExecutor(config.address, config.time_limit)
    return ProcessExecutor(config.workers, config.time_limit)


def _show_rates(out: Path, objects: Sequence[GraspObject], config: SimulateConfig) -> int:
    """Chance on the objects that have their table, types that never held, and why; how many objects these are."""
    from spgf_torch.evaluation.endings import ending_lines
    from spgf_torch.evaluation.paper import is_papers_hand
    from spgf_torch.evaluation.tables import hopeless_types, random_rates
    from spgf_torch.simulation.table import read_table, table_path

    paths = {obj.name: table_path(out, obj.name) for obj in objects}
    there = [obj for obj in objects if paths[obj.name].exists()]
    tables = [read_table(paths[obj.name]) for obj in there]
    if tables:
        show(random_rates([obj.category for obj in there], tables, is_papers_hand(config.hand)))
        for line in (*hopeless_types(tables, config.hand.name), *ending_lines(tables)):
            show(line)
    return len(tables)


def _tell(run_state: RunState, objects: Sequence[GraspObject]) -> None:
    """What went wrong, a line each. Raises IncompleteError if anything did."""
    from spgf_torch.progress import console  # not above: submitit pickles this module's globals, a console has locks

    entries = {obj.name: run_state.objects.get(obj.name, {}) for obj in objects}
    failed = [f"{name}: {entry['reason']}" for name, entry in entries.items() if "reason" in entry]
    stood_for = sum(len(entry.get("failures", [])) for entry in entries.values() if entry.get("state") == "done")
    lines = [*run_state.left_out, *failed, *run_state.incidents]
    for line in lines[:SHOWN]:
        console.print(line)
    if len(lines) > SHOWN:
        console.print(f"and {len(lines) - SHOWN} more")
    if lines or stood_for:
        counts = {
            "objects left out": len(run_state.left_out),
            "objects without a table": len(failed),
            "trials without an outcome of their own": stood_for,
            "incidents": len(run_state.incidents),
        }
        words = ", ".join(f"{count} {what}" for what, count in counts.items() if count)
        again = f"the same call with out={run_state.folder} tries again what has no outcome"
        raise IncompleteError(f"{words}: {run_state.path} says why; {again}")


if __name__ == "__main__":
    run_command("simulate", SimulateConfig, run)
