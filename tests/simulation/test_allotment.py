"""Trials by a budget: which type is next, by hand; requests; tables over several calls; what readers take."""

from __future__ import annotations

import random
from dataclasses import asdict, replace
from pathlib import Path

import pytest
import torch
from generations import Calls, manifest, tables
from test_generation import Ending
from toys import TRIALS, WORDS, Toy, checksum, toss

from spgf_torch.errors import InputError
from spgf_torch.simulation.allotment import Allotted, Request, allot, told, uncertainty
from spgf_torch.simulation.config import Budget
from spgf_torch.simulation.execute import sample
from spgf_torch.simulation.executors import InlineExecutor, ProcessExecutor
from spgf_torch.simulation.table import TrialTable, read_table, write_table
from spgf_torch.simulation.worker import Case, episodes, try_chunk

S, C, M = "success", "collision", "missed"
# Six candidates of each of two types.
OUTCOMES = [C, S, S, M, S, C, S, S, S, C, S, S]


def test_uncertainty_by_hand() -> None:
    """Of no trial that of a uniform rate, sqrt(1/12); of Beta(3, 2), mean 0.6: sqrt(0.6 * 0.4 / 6)."""
    assert uncertainty([]) == uncertainty([C, C]) == pytest.approx(12**-0.5)
    assert uncertainty([S, C, M, S]) == pytest.approx(0.2)
    assert uncertainty(["dropped", None, S]) == pytest.approx((0.4 * 0.6 / 6) ** 0.5)


@pytest.mark.parametrize(
    ("budget", "rows"),
    [
        # Both unknown: two trials of the first, then of the second; both 2 of 2: the first again, with what is left.
        (Budget(5, 0.0, 2), (4, 2)),
        # Its next round has two, after which 3 of 4 (0.178) is known better than 2 of 2 (0.194).
        (Budget(7, 0.0, 2), (5, 3)),
        # 2 of 2 is known well enough.
        (Budget(7, 0.2, 2), (3, 2)),
        # There is no more: five trials of the second, and of the first its last candidate, which collides, too.
        (Budget(100, 0.0, 2), (6, 6)),
        # One round each, the second with the rest.
        (Budget(5, 0.0, 3), (4, 2)),
    ],
)
def test_rounds_by_hand(budget: Budget, rows: tuple[int, ...]) -> None:
    assert allot(OUTCOMES, 2, budget) == Allotted(rows, None)


def test_what_is_asked_for() -> None:
    """From the first candidate without an outcome to the next that has one; of a type; what is left of a round."""
    budget = Budget(5, 0.0, 2)
    assert allot([None] * 12, 2, budget) == Allotted((0, 0), Request(0, 6, 2))
    assert allot([*OUTCOMES[:3], *[None] * 9], 2, budget) == Allotted((3, 0), Request(6, 12, 2))
    assert allot([C, S, None, *OUTCOMES[3:]], 2, budget) == Allotted((0, 0), Request(2, 3, 1))


def test_a_trial_that_failed_counts_as_tried() -> None:
    """Row 2 has no outcome: 1 of 2 of the first type is known less (0.224) than 2 of 2 of the second."""
    failed = [C, S, None, *OUTCOMES[3:]]
    assert allot(failed, 2, Budget(4, 0.0, 2), {2}) == Allotted((3, 2), None)
    assert allot(failed, 2, Budget(6, 0.0, 2), {2}) == Allotted((5, 2), None)


@pytest.mark.parametrize("seed", range(20))
def test_answering_requests_ends_where_all_outcomes_do(seed: int) -> None:
    """What is asked for in turn is what the rounds of all outcomes use: no trial more, and none beyond the budget."""
    draw = random.Random(seed)
    types, size = draw.randint(1, 3), draw.randint(1, 30)
    budget = Budget(draw.randint(1, 40), draw.choice([0.0, 0.1]), draw.randint(1, 7))
    truth = [draw.choice([S, C, C, M]) for _ in range(types * size)]
    outcomes: list[str | None] = [None] * len(truth)
    while (request := allot(outcomes, types, budget).request) is not None:
        assert request.most > 0 and request.first // size == (request.end - 1) // size
        for row in range(request.first, request.end):
            if episodes(truth[request.first : row]) == request.most:
                break
            outcomes[row] = truth[row]
    rows = allot(outcomes, types, budget).rows
    assert rows == allot(truth, types, budget).rows
    used = [code * size + row for code, count in enumerate(rows) for row in range(count)]
    assert [row for row, word in enumerate(outcomes) if word is not None] == used
    assert episodes([truth[row] for row in used]) <= budget.trials


def test_a_chunk_ends_after_so_many_episodes() -> None:
    """Of poses whose words are known the first ones, up to the second that is no collision; a failure is one."""
    obj = Toy("a")
    T = sample(obj, calls(obj).provenance(obj), TRIALS.samplers).T_object_tcp(0, N)
    words = [WORDS[checksum(one) % 6] for one in T]
    end = [row for row, word in enumerate(words) if word != C][1] + 1
    assert try_chunk(Case.of(obj, TRIALS, "NPG", toss), T, most=2).outcomes == words[:end]
    bad = Toy("bad", {checksum(T[row]): "raise" for row in range(N) if words[row] != C})
    failed = try_chunk(Case.of(bad, TRIALS, "NPG", toss), T, most=2)
    assert failed.outcomes == [None if word != C else C for word in words[:end]] and len(failed.reasons) == 2


N = 12
BUDGET = Budget(9, 0.0, 2)


def calls(*objects: Toy) -> Calls:
    return Calls(objects, TRIALS, toss, N, BUDGET)


def rows_of(table: TrialTable, code: int) -> list[list[float]]:
    rows = table.grasp_type == code
    return torch.cat([table.position, table.quaternion, table.outcome[:, None]], dim=1)[rows].tolist()


def test_a_table_of_a_budget_is_the_beginning_of_the_whole_one(tmp_path: Path) -> None:
    """Of each type, in one process and in two; and its manifest says what was allotted, and why no more."""
    objects = [Toy("a"), Toy("b"), Toy("c")]
    Calls(objects, TRIALS, toss, N).make(tmp_path / "whole", InlineExecutor())
    told_by = []
    for number, executor in enumerate((InlineExecutor(), ProcessExecutor(2), ProcessExecutor(1))):
        advanced: list[int] = []
        out = tmp_path / str(number)
        run_state, ran = calls(*objects).make(out, executor, chunk=3 + number, progress=advanced.append)
        assert tables(out) == tables(tmp_path / "0") and not (out / "shards").exists()
        assert run_state.trials == ran and sum(advanced) == len(objects) * 2 * N
        told_by.append(manifest(out)["objects"])
    assert told_by[0] == told_by[1] == told_by[2]
    for obj in objects:
        whole, part = (read_table(tmp_path / f"{place}/{obj.name}.parquet") for place in ("whole", "0"))
        words = [WORDS[code] for code in whole.outcome.tolist()]
        counts = allot(words, 2, BUDGET).rows
        for code, count in enumerate(counts):
            assert rows_of(part, code) == rows_of(whole, code)[:count]
        its = manifest(tmp_path / "0")["objects"][obj.name]["allotted"]
        assert its == told(part) and [its[name]["candidates"] for name in ("NPG", "WPG")] == list(counts)
        assert sum(entry["physics"] for entry in its.values()) == BUDGET.trials
        assert {entry["ended"] for entry in its.values()} == {"budget"}


def test_what_is_told_of_a_type() -> None:
    """All three candidates of the first type, one a collision: 1 of 2 held; of the second one of three."""
    made = calls().provenance(Toy("a"), candidates=3)
    outcome = torch.tensor([WORDS.index(word) for word in (C, S, M, S)])
    poses = torch.zeros(4, 3), torch.tensor([[1.0, 0, 0, 0]] * 4)
    table = TrialTable(made, *poses, torch.tensor([0, 0, 0, 1]), outcome, {}, ("NPG", "WPG"))
    assert told(table) == {
        "NPG": {"candidates": 3, "physics": 2, "success": 1, "uncertainty": 0.2236, "ended": "candidates"},
        "WPG": {"candidates": 1, "physics": 1, "success": 1, "uncertainty": 0.2357, "ended": "budget"},
    }
    assert told(replace(table, provenance=replace(made, budget=None))) == {}


@pytest.mark.parametrize("tasks", [0, 1, 4, 7])
def test_a_second_call_goes_on(tasks: int, tmp_path: Path) -> None:
    objects = [Toy("a"), Toy("b")]
    _, needed = calls(*objects).make(tmp_path / "whole", InlineExecutor())
    with pytest.raises(KeyboardInterrupt):
        calls(*objects).make(tmp_path / "out", Ending(tasks))
    kept = manifest(tmp_path / "out")["trials"]
    assert (kept > 0) == (tasks > 0)
    _, ran = calls(*objects).make(tmp_path / "out", InlineExecutor())
    assert ran == needed - kept and tables(tmp_path / "out") == tables(tmp_path / "whole")
    _, ran = calls(*objects).make(tmp_path / "out", InlineExecutor())
    assert ran == 0 and manifest(tmp_path / "out")["trials"] == needed


def test_a_trial_that_failed_is_tried_again_by_the_next_call(tmp_path: Path) -> None:
    T = sample(Toy("a"), calls().provenance(Toy("a")), TRIALS.samplers).T_object_tcp(0, N)
    first = next(row for row in range(N) if WORDS[checksum(T[row]) % 6] != C)
    calls(Toy("a")).make(tmp_path / "whole", InlineExecutor())
    out = tmp_path / "out"
    calls(Toy("a", {checksum(T[first]): "crash"}), Toy("b", unmade="raise")).make(out, ProcessExecutor(1))
    entries = manifest(out)["objects"]
    assert not tables(out) and entries["a"]["failures"][0]["index"] == first
    assert entries["b"]["reason"] == "cannot be made: ValueError: no such thing"
    calls(Toy("a")).make(out, InlineExecutor())
    assert tables(out) == tables(tmp_path / "whole")


def test_another_budget_is_refused(tmp_path: Path) -> None:
    calls(Toy("a")).make(tmp_path, InlineExecutor())
    with pytest.raises(InputError, match=r"a.parquet: expected trials made with budget None, got"):
        Calls([Toy("a")], TRIALS, toss, N).make(tmp_path, InlineExecutor())
    more = Calls([Toy("a")], TRIALS, toss, N, replace(BUDGET, trials=11))
    with pytest.raises(InputError, match=r"a.parquet: expected trials made with budget.trials 11, got 9"):
        more.make(tmp_path, InlineExecutor())


def test_a_table_may_have_fewer_trials_but_not_more(tmp_path: Path) -> None:
    """Than candidates, of each type; one without a budget does not tell of it, as older ones."""
    calls(Toy("a")).make(tmp_path, InlineExecutor())
    path = tmp_path / "a.parquet"
    table = read_table(path)
    assert table.provenance.budget == asdict(BUDGET)
    write_table(path, replace(table, provenance=replace(table.provenance, candidates=3)))
    with pytest.raises(InputError, match=r"a.parquet: expected at most 3 trials of each grasp type, got \d+ of NPG"):
        read_table(path)
    write_table(path, replace(table, provenance=replace(table.provenance, budget=None)))
    with pytest.raises(InputError, match=r"a.parquet: expected 12 trials of each grasp type, got \d+ of NPG"):
        read_table(path)
    assert b"budget" not in path.read_bytes()
