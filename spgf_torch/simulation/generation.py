"""A trial table from beginning to end, over as many calls as it takes: each goes on where the one before was cut off.

An object's candidates follow from the seed and its name alone, and no trial depends on another: the table is the same
wherever, in what order and in how many calls its trials ran.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path

from spgf_torch.hands.config import GRASP_TYPES
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.simulation.attempts import Attempt, Case, Ended, Trials, physics, told
from spgf_torch.simulation.execute import Poses, codes, sample, table_of
from spgf_torch.simulation.executors import Runner, Task
from spgf_torch.simulation.run_state import Journal, rows_of
from spgf_torch.simulation.table import Origin, read_tables, table_path, write_table


@dataclass
class Plan:
    """What is to be tried, and how.

    Attributes:
        trials: hand and episode.
        chunk: candidates of a shard.
        failed_as: outcome that stands for a trial that crashed or did not end; None = its object gets no table.
        make: what an attempt on an object is; another than physics is for tests.
    """

    trials: Trials
    chunk: int
    failed_as: str | None = None
    make: Callable[[GraspObject, Trials, str], Attempt] = physics


@dataclass
class Open:
    """An object whose trials are under way.

    Attributes:
        outcomes: of each row of its table, None where there is none yet.
        left: rows that wait for an answer.
        tried: rows that have an outcome.
        reasons: row -> why a trial of this call has no outcome.
        unbuilt: why the object could not be made, if it could not.
    """

    obj: GraspObject
    origin: Origin
    poses: Poses
    outcomes: list[str | None]
    left: int = 0
    tried: int = 0
    reasons: dict[int, str] = field(default_factory=dict)
    unbuilt: str = ""

    def pose_checksum(self, first: int, count: int) -> int:
        """Of the stored poses of rows first to first + count."""
        rows = slice(first, first + count)
        return zlib.crc32(self.poses.position[rows].numpy().tobytes() + self.poses.quaternion[rows].numpy().tobytes())


class Campaign:
    """The trials of objects that have no table yet, into the folder of `journal`, which is open."""

    def __init__(self, journal: Journal, plan: Plan, progress: Callable[[int], None] = lambda done: None) -> None:
        self.journal, self.plan, self.progress = journal, plan, progress
        self.trials = 0  # tried in this call
        self._open: dict[str, Open] = {}

    def run(self, objects: Sequence[tuple[GraspObject, Origin]], runner: Runner) -> None:
        """Try what is not yet done; what comes of an object is in its table or, with the reason, in the journal.

        `progress(done)` is called when `done` more candidates need no more work: their outcomes are on disk.
        """
        with closing(runner.run(self._tasks(objects))) as ended:  # type: ignore[type-var]
            for task, result in ended:
                name, first = task.name
                self._take(self._open[name], first, result)

    def _tasks(self, objects: Iterable[tuple[GraspObject, Origin]]) -> Iterator[Task]:
        for obj, origin in objects:
            try:
                poses = sample(obj, origin)
            except Exception as error:  # whatever is wrong with one object, the others go on
                self._fail(origin, f"no candidates: {told(error)}")
                self.progress(rows_of(origin))
                continue
            it = Open(obj, origin, poses, [])
            it.outcomes = self.journal.known(origin, it.pose_checksum)
            chunks = list(_missing(it.outcomes, origin.candidates, self.plan.chunk))
            it.left = sum(end - first for first, end in chunks)
            it.tried = len(it.outcomes) - it.left
            self.progress(it.tried)
            self._open[obj.name] = it
            for first, end in chunks:
                if it.unbuilt:
                    break
                kind = GRASP_TYPES[first // origin.candidates]
                case = Case.of(obj, self.plan.trials, kind, self.plan.make)
                yield Task((obj.name, first), case, poses.T_object_tcp(first, end))
            if not chunks:
                self._close(it)

    def _take(self, it: Open, first: int, ended: Ended) -> None:
        """First onto the disk, then told."""
        if it.unbuilt:
            return
        if ended.incident:
            self.journal.incidents.append(ended.incident)
        count = len(ended.outcomes)
        if ended.unbuilt:
            it.unbuilt = ended.unbuilt
            self._fail(it.origin, f"cannot be made: {ended.unbuilt}", it.tried)
            self.progress(it.left)
            return
        if any(ended.outcomes):
            self.journal.add(it.origin, first, it.pose_checksum(first, count), ended.outcomes)
        it.outcomes[first : first + count] = ended.outcomes
        it.reasons |= {first + index: reason for index, reason in ended.reasons.items()}
        it.left -= count
        it.tried += count - ended.outcomes.count(None)
        self.trials += count
        self.progress(count)
        self.journal.note(it.origin, "open", it.tried, failures=_failures(it))
        if not it.left:
            self._close(it)

    def _close(self, it: Open) -> None:
        """All candidates were tried: the table, if each has an outcome."""
        del self._open[it.obj.name]
        self.journal.note(it.origin, "open", it.tried, failures=_failures(it))
        if it.reasons and self.plan.failed_as is None:
            self._fail(it.origin, f"{len(it.reasons)} trials without an outcome", it.tried, _failures(it))
            return
        outcome = codes([word or self.plan.failed_as for word in it.outcomes])
        write_table(table_path(self.journal.folder, it.obj.name), table_of(it.origin, it.poses, outcome))
        self.journal.done(it.origin)

    def _fail(self, origin: Origin, reason: str, trials: int = 0, failures: Sequence[dict] = ()) -> None:
        self.journal.note(origin, "failed", trials, reason, failures)


def finished(folder: Path, origins: Sequence[Origin]) -> list[Origin]:
    """Those that have their table. Raises InputError for one that is damaged or was made from something else."""
    there = [origin for origin in origins if table_path(folder, origin.object_name).exists()]
    for origin in there:
        read_tables(folder, [origin])
    return there


def _missing(outcomes: Sequence[str | None], candidates: int, chunk: int) -> Iterator[tuple[int, int]]:
    """(first, end) of rows without an outcome, at most `chunk` together, none across grasp types."""
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


def _failures(it: Open) -> list[dict]:
    """As the manifest tells them."""
    n = it.origin.candidates
    return [
        {"type": GRASP_TYPES[row // n], "index": row, "reason": reason} for row, reason in sorted(it.reasons.items())
    ]
