"""Generate a trial table over any number of calls: each resumes where the one before was cut off.

An object's candidates follow from the seed and its name alone, and no trial depends on another: the table is the same
wherever, in what order and in how many calls its trials ran.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.simulation.allotment import Geometry, allotted, free_candidates, open_hand, told
from spgf_torch.simulation.execute import Poses, ended_table, sample
from spgf_torch.simulation.executors import Executor, Task
from spgf_torch.simulation.run_state import RunState
from spgf_torch.simulation.table import Provenance, read_table, read_tables, table_path, write_table
from spgf_torch.simulation.worker import Case, ChunkResult, TrialFunction, Trials, error_line, physics


@dataclass
class Plan:
    """Settings of a generation.

    Attributes:
        trials: hand and episode.
        chunk: candidates of a shard.
        failed_as: outcome of a trial that crashed or did not end; None: its object gets no table.
        make: makes the trial on an object; tests replace physics.
        geometry: what of a trial geometry alone tells, for a budget; tests replace that, too.
    """

    trials: Trials
    chunk: int
    failed_as: str | None = None
    make: Callable[[GraspObject, Trials, str], TrialFunction] = physics
    geometry: Callable[[GraspObject, Trials, str], Geometry] = open_hand


@dataclass
class OpenObject:
    """An object whose trials are running.

    Attributes:
        outcomes: of each row of its table how it ended, None where there is none yet.
        left: rows whose trial has not ended.
        tried: rows that have an outcome.
        reasons: row -> why a trial of this call has no outcome.
        unbuilt: why the object could not be loaded, or "".
    """

    obj: GraspObject
    provenance: Provenance
    poses: Poses
    outcomes: list[str | None]
    left: int = 0
    tried: int = 0
    reasons: dict[int, str] = field(default_factory=dict)
    unbuilt: str = ""

    @property
    def of_each_type(self) -> int:
        """How many rows each grasp type has."""
        return len(self.poses) // len(self.poses.grasp_types)

    def pose_checksum(self, first: int, count: int) -> int:
        """Return the checksum of the stored poses of rows first to first + count."""
        rows = slice(first, first + count)
        return zlib.crc32(self.poses.position[rows].numpy().tobytes() + self.poses.quaternion[rows].numpy().tobytes())


class Generation:
    """The trials of objects that have no table yet, into the folder of `run_state`, which is open."""

    def __init__(self, run_state: RunState, plan: Plan, progress: Callable[[int], None] = lambda done: None) -> None:
        self.run_state, self.plan, self.progress = run_state, plan, progress
        self.trials = 0  # tried in this call
        self._open: dict[str, OpenObject] = {}

    def run(self, objects: Sequence[tuple[GraspObject, Provenance]], executor: Executor) -> None:
        """Run the missing trials; each object then has its table or, with the reason, a failure in `run_state`.

        `progress(done)` is called when the outcomes of `done` more candidates are on disk.
        """
        with closing(executor.run(self._tasks(objects))) as ended:  # type: ignore[type-var]
            for task, result in ended:
                name, first = task.name
                self._take(self._open[name], first, result)

    def _tasks(self, objects: Iterable[tuple[GraspObject, Provenance]]) -> Iterator[Task]:
        for obj, provenance in objects:
            try:
                poses = self._candidates(obj, provenance)
            except Exception as error:  # a failure of one object must not stop the others
                self._fail(provenance, f"no candidates: {error_line(error)}")
                self.progress(self.run_state.rows(provenance))
                continue
            it = OpenObject(obj, provenance, poses, [])
            it.outcomes = self.run_state.known(provenance, it.pose_checksum, len(poses))
            chunks = list(_missing(it.outcomes, it.of_each_type, self.plan.chunk))
            it.left = sum(end - first for first, end in chunks)
            it.tried = len(it.outcomes) - it.left
            self.progress(self.run_state.rows(provenance) - it.left)
            self._open[obj.name] = it
            for first, end in chunks:
                if it.unbuilt:
                    break
                grasp_type = poses.grasp_types[first // it.of_each_type]
                case = Case.of(obj, self.plan.trials, grasp_type, self.plan.make)
                yield Task((obj.name, first), case, poses.T_object_tcp(first, end))
            if not chunks:
                self._close(it)

    def _candidates(self, obj: GraspObject, provenance: Provenance) -> Poses:
        """Sample what is tried on an object: all candidates, or those that its budget allots."""
        poses = sample(obj, provenance, self.plan.trials.samplers)
        if provenance.budget is None:
            return poses
        return poses.first(
            allotted(free_candidates(obj, poses, self.plan.trials, self.plan.geometry), provenance.budget)
        )

    def _take(self, it: OpenObject, first: int, ended: ChunkResult) -> None:
        """Persist the outcomes before reporting progress."""
        if it.unbuilt:
            return
        if ended.incident:
            self.run_state.incidents.append(ended.incident)
        count = len(ended.outcomes)
        if ended.unbuilt:
            it.unbuilt = ended.unbuilt
            self._fail(it.provenance, f"cannot be made: {ended.unbuilt}", it.tried)
            self.progress(it.left)
            return
        if any(ended.outcomes):
            self.run_state.add(it.provenance, first, it.pose_checksum(first, count), ended.outcomes)
        it.outcomes[first : first + count] = ended.outcomes
        it.reasons |= {first + index: reason for index, reason in ended.reasons.items()}
        it.left -= count
        it.tried += count - ended.outcomes.count(None)
        self.trials += count
        self.progress(count)
        self.run_state.note(it.provenance, "open", it.tried, failures=_failures(it))
        if not it.left:
            self._close(it)

    def _close(self, it: OpenObject) -> None:
        """Write the table of an object whose trials ended, if each has an outcome."""
        del self._open[it.obj.name]
        self.run_state.note(it.provenance, "open", it.tried, failures=_failures(it))
        if it.reasons and self.plan.failed_as is None:
            self._fail(it.provenance, f"{len(it.reasons)} trials without an outcome", it.tried, _failures(it))
            return
        ended = [word or str(self.plan.failed_as) for word in it.outcomes]
        table = ended_table(it.provenance, it.poses, ended)
        write_table(table_path(self.run_state.folder, it.obj.name), table)
        self.run_state.done(it.provenance, told(table))

    def _fail(self, provenance: Provenance, reason: str, trials: int = 0, failures: Sequence[dict] = ()) -> None:
        self.run_state.note(provenance, "failed", trials, reason, failures)


def finished(folder: Path, provenances: Sequence[Provenance], grasp_types: tuple[str, ...]) -> list[Provenance]:
    """Select the objects that have their table, of the hand's grasp types.

    Raises InputError for a table that is damaged, of other provenance or of other types.
    """
    there = [provenance for provenance in provenances if table_path(folder, provenance.object_name).exists()]
    for provenance in there:
        read_tables(folder, [provenance], grasp_types)
    return there


def keep(run_state: RunState, provenance: Provenance) -> None:
    """Note that an object has its table, from an earlier call."""
    path = table_path(run_state.folder, provenance.object_name)
    run_state.done(provenance, told(read_table(path)) if provenance.budget is not None else None)


def _missing(outcomes: Sequence[str | None], candidates: int, chunk: int) -> Iterator[tuple[int, int]]:
    """Yield (first, end) of rows without an outcome, at most `chunk` together, of one grasp type each."""
    row = 0
    while row < len(outcomes):
        if outcomes[row] is not None:
            row += 1
            continue
        end, stop = row, min(row + chunk, (row // candidates + 1) * candidates)
        while end < stop and outcomes[end] is None:
            end += 1
        yield row, end
        row = end


def _failures(it: OpenObject) -> list[dict]:
    """Return the failures of an object as entries of the manifest."""
    n, names = it.of_each_type, it.poses.grasp_types
    return [{"type": names[row // n], "index": row, "reason": reason} for row, reason in sorted(it.reasons.items())]
