"""Trials by a budget: how many, by hand; tables over several calls; what readers take; on a real object."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from generations import Calls, manifest, tables, tossed_collision
from test_generation import Ending
from toys import TRIALS, WORDS, Toy, checksum, toss

from spgf_torch.errors import InputError
from spgf_torch.simulation.allotment import allotted, free_candidates, told
from spgf_torch.simulation.execute import sample
from spgf_torch.simulation.executors import InlineExecutor, ProcessExecutor
from spgf_torch.simulation.table import TrialTable, read_table, write_table

N, BUDGET = 12, 9
COLLISION = WORDS.index("collision")


def calls(*objects: Toy, budget: int | None = BUDGET) -> Calls:
    return Calls(objects, TRIALS, toss, N, budget)


# Free candidates of two types: 1 after the first of each, 1, 3, 3, 4, 6 after the following ones.
FREE = np.array([[1, 0, 1, 0, 1, 1], [0, 0, 1, 0, 0, 1]], dtype=bool)


@pytest.mark.parametrize(("budget", "count"), [(1, 1), (2, 3), (3, 3), (4, 5), (5, 6), (6, 6), (7, 6), (10**6, 6)])
def test_how_many_by_hand(budget: int, count: int) -> None:
    """Until so many of both types together are free; there are six and no more."""
    assert allotted(FREE, budget) == count


def test_nothing_is_free() -> None:
    """Geometry tells of all, so all are tried."""
    assert allotted(np.zeros((2, 6), dtype=bool), 1) == 6


def test_the_first_candidates_of_each_type() -> None:
    poses = sample(Toy("a"), calls().provenance(Toy("a")), TRIALS.samplers)
    few = poses.first(3)
    assert len(few) == 6 and few.grasp_type.tolist() == [0, 0, 0, 1, 1, 1]
    rows = [0, 1, 2, N, N + 1, N + 2]
    assert torch.equal(few.position, poses.position[rows]) and torch.equal(few.quaternion, poses.quaternion[rows])
    assert np.array_equal(few.T_object_tcp(2, 4), poses.T_object_tcp(0, 2 * N)[[2, N]])


def test_what_is_free_is_asked_of_each_type_by_its_own_hand() -> None:
    """Of three types the second's hand cuts where x is positive, the others' where z is."""
    types = ("claw", "hook", "pinch")
    trials: Any = SimpleNamespace(samplers=dict.fromkeys(types, "surface_pairs"))
    poses = sample(Toy("a"), calls().provenance(Toy("a")), trials.samplers)
    free = free_candidates(
        Toy("a"), poses, trials, lambda obj, trials, name: lambda T: T[0 if name == "hook" else 2, 3] > 0
    )
    expected = [(poses.position[i * N : (i + 1) * N, axis] <= 0).tolist() for i, axis in enumerate((2, 0, 2))]
    assert free.tolist() == expected and 0 < free.sum() < free.size


def test_a_table_of_a_budget_is_the_beginning_of_the_whole_one(tmp_path: Path) -> None:
    """Of each type, in one process and in two; and its manifest says what was allotted, and why no more."""
    objects = [Toy("a"), Toy("b"), Toy("c")]
    calls(*objects, budget=None).make(tmp_path / "whole", InlineExecutor())
    for number, executor in enumerate((InlineExecutor(), ProcessExecutor(2), ProcessExecutor(1))):
        advanced: list[int] = []
        out = tmp_path / str(number)
        run_state, ran = calls(*objects).make(out, executor, chunk=3 + number, progress=advanced.append)
        assert tables(out) == tables(tmp_path / "0") and not (out / "shards").exists()
        assert run_state.trials == ran and sum(advanced) == len(objects) * 2 * N
        assert manifest(out)["objects"] == manifest(tmp_path / "0")["objects"]
    counts = []
    for obj in objects:
        whole, part = (read_table(tmp_path / f"{place}/{obj.name}.parquet") for place in ("whole", "0"))
        its = manifest(tmp_path / "0")["objects"][obj.name]
        count = its["allotted"]["candidates"]
        rows = [*range(count), *range(N, N + count)]
        for name in ("position", "quaternion", "grasp_type", "outcome"):
            assert torch.equal(getattr(part, name), getattr(whole, name)[rows])
        free = (part.outcome != COLLISION).reshape(2, count)
        assert BUDGET <= int(free.sum()) <= BUDGET + 1 and int(free[:, :-1].sum()) < BUDGET
        of_types = {"NPG": int(free[0].sum()), "WPG": int(free[1].sum())}
        assert its["allotted"] == {"candidates": count, "physics": of_types, "ended": "budget"}
        assert its["trials"] == len(part) == 2 * count
        counts.append(count)
    assert len(set(counts)) > 1  # each object has its own number


def test_what_is_told_of_an_object(tmp_path: Path) -> None:
    """With more budget than candidates all of them are tried, and that is why there are no more."""
    calls(Toy("a"), budget=1000).make(tmp_path, InlineExecutor())
    table = read_table(tmp_path / "a.parquet")
    its = told(table)
    assert (its["candidates"], its["ended"]) == (N, "candidates")
    assert sum(its["physics"].values()) == int((table.outcome != COLLISION).sum())
    assert told(replace(table, provenance=replace(table.provenance, budget=None))) == {}


@pytest.mark.parametrize("tasks", [0, 1, 3])
def test_a_second_call_goes_on(tasks: int, tmp_path: Path) -> None:
    """Also one that has lost the manifest: what was allotted is told from the tables."""
    objects = [Toy("a"), Toy("b")]
    _, needed = calls(*objects).make(tmp_path / "whole", InlineExecutor())
    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        calls(*objects).make(out, Ending(tasks))
    kept = manifest(out)["trials"]
    assert (kept > 0) == (tasks > 0)
    _, ran = calls(*objects).make(out, InlineExecutor())
    assert ran == needed - kept and tables(out) == tables(tmp_path / "whole")
    (out / "manifest.json").unlink()
    _, ran = calls(*objects).make(out, InlineExecutor())
    assert ran == 0 and manifest(out)["objects"] == manifest(tmp_path / "whole")["objects"]


def test_a_trial_that_failed_is_tried_again_by_the_next_call(tmp_path: Path) -> None:
    T = sample(Toy("a"), calls().provenance(Toy("a")), TRIALS.samplers).T_object_tcp(0, 2 * N)
    free = [row for row in range(N, 2 * N) if not tossed_collision(Toy("a"), TRIALS, "WPG")(T[row])]
    calls(Toy("a")).make(tmp_path / "whole", InlineExecutor())
    out = tmp_path / "out"
    calls(Toy("a", {checksum(T[free[0]]): "crash"})).make(out, ProcessExecutor(1))
    assert not tables(out)
    assert [(it["type"], it["index"]) for it in manifest(out)["objects"]["a"]["failures"]] == [
        ("WPG", free[0] - N + len(read_table(tmp_path / "whole/a.parquet")) // 2)
    ]
    _, ran = calls(Toy("a")).make(out, InlineExecutor())
    assert ran == 1 and tables(out) == tables(tmp_path / "whole")


def test_another_budget_is_refused(tmp_path: Path) -> None:
    calls(Toy("a")).make(tmp_path, InlineExecutor())
    for budget, words in ((None, "budget None, got 9"), (11, "budget 11, got 9")):
        with pytest.raises(InputError, match=rf"a.parquet: expected trials made with {words}"):
            calls(Toy("a"), budget=budget).make(tmp_path, InlineExecutor())


def changed(table: TrialTable, path: Path, rows: list[int], **provenance: Any) -> Path:
    """The table with these rows alone, and with another provenance, in a file."""
    columns = {name: getattr(table, name)[rows] for name in ("position", "quaternion", "grasp_type", "outcome")}
    write_table(path, replace(table, provenance=replace(table.provenance, **provenance), **columns))
    return path


def test_how_many_trials_a_table_may_have(tmp_path: Path) -> None:
    """With a budget as many of each type, but no more than candidates; without one, which it then does not tell of,
    as many as candidates."""
    calls(Toy("a")).make(tmp_path, InlineExecutor())
    table = read_table(tmp_path / "a.parquet")
    count, path = len(table) // 2, tmp_path / "b.parquet"
    every = list(range(2 * count))
    assert read_table(changed(table, path, [0, count])).provenance.budget == BUDGET
    with pytest.raises(InputError, match=rf"expected {count - 1} trials of each grasp type, got {count} of NPG"):
        read_table(changed(table, path, every, candidates=count - 1))
    with pytest.raises(InputError, match=rf"expected {count} trials of each grasp type, got {count} of NPG, 1 of WPG"):
        read_table(changed(table, path, every[: count + 1]))
    with pytest.raises(InputError, match=rf"expected {N} trials of each grasp type, got {count} of NPG"):
        read_table(changed(table, path, every, budget=None))
    assert b"budget" not in path.read_bytes()
    with pytest.raises(InputError, match="expected"):
        read_table(changed(table, path, []))
