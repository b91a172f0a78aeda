"""Tables over several calls: what is kept, what failed and why, that place and order of trials do not matter."""

import errno
import json
import random
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from generations import Calls, manifest, tables
from toys import TRIALS, WORDS, Toy, checksum, toss

from spgf_torch.errors import InputError
from spgf_torch.simulation.execute import sample
from spgf_torch.simulation.executors import InlineExecutor, ProcessExecutor, Task
from spgf_torch.simulation.generation import _missing
from spgf_torch.simulation.run_state import RunState
from spgf_torch.simulation.table import read_table
from spgf_torch.simulation.worker import Case, ChunkResult, try_chunk

N = 12  # candidates of each type


def toys(*objects: Toy) -> Calls:
    return Calls(objects, TRIALS, toss, N)


class Shuffled:
    """As a cluster may do it: all at once, in any order."""

    def run(self, tasks: Iterable[Task]) -> Iterator[tuple[Task, ChunkResult]]:
        drawn = list(tasks)
        random.Random(0).shuffle(drawn)
        for task in drawn:
            yield task, try_chunk(task.case, task.T_object_tcp)


class Ending:
    """Ends a call after some tasks, as Ctrl-C does."""

    def __init__(self, tasks: int) -> None:
        self.tasks = tasks

    def run(self, tasks: Iterable[Task]) -> Iterator[tuple[Task, ChunkResult]]:
        for number, task in enumerate(tasks):
            if number == self.tasks:
                raise KeyboardInterrupt
            yield task, try_chunk(task.case, task.T_object_tcp)


def test_where_order_and_chunks_do_not_matter(tmp_path: Path) -> None:
    """One process and two, in order and shuffled, chunks of 5, 7 and 100: the same files."""
    calls = toys(Toy("a"), Toy("b"))
    ways = [(InlineExecutor(), 5), (ProcessExecutor(1), 7), (ProcessExecutor(2), 5), (Shuffled(), 100)]
    for number, (executor, chunk) in enumerate(ways):
        calls.make(tmp_path / str(number), executor, chunk)
        assert tables(tmp_path / str(number)) == tables(tmp_path / "0")
        left = {path.name for path in (tmp_path / str(number)).iterdir()}
        assert left == {"a.parquet", "b.parquet", "manifest.json"}
    table = read_table(tmp_path / "0/a.parquet")
    assert [WORDS[code] for code in table.outcome] == [WORDS[checksum(T.numpy()) % 6] for T in table.T_object_tcp]


def test_a_second_call_goes_on(tmp_path: Path) -> None:
    """Ended after 3 of 6 chunks of 5, 5, 2 candidates a type: 12 trials are kept, the other 36 of both objects run."""
    calls = toys(Toy("a"), Toy("b"))
    calls.make(tmp_path / "whole", InlineExecutor())
    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        calls.make(out, Ending(3))
    assert manifest(out)["trials"] == 12 and manifest(out)["objects"]["a"]["state"] == "open"
    assert [path.name for path in sorted((out / "shards/a").iterdir())] == [
        f"{first:08d}-{end:08d}.json" for first, end in ((0, 5), (5, 10), (10, 12))
    ]
    _, ran = calls.make(out, InlineExecutor(), chunk=4)
    assert ran == 36 and tables(out) == tables(tmp_path / "whole") and not (out / "shards").exists()
    _, ran = calls.make(out, InlineExecutor())
    assert ran == 0 and manifest(out)["trials"] == 48


def test_what_fails_is_told_and_the_rest_goes_on(tmp_path: Path) -> None:
    """Of one object three trials crash, hang and raise; two objects cannot be made; the last is as ever.

    A crash that does not come again costs nothing but a line.
    """
    T = sample(Toy("bad"), toys().provenance(Toy("bad")), TRIALS.samplers).T_object_tcp(0, 2 * N)
    hazards = {checksum(T[1]): "crash", checksum(T[7]): "hang", checksum(T[13]): "raise"}
    again = {checksum(T[20]): f"crash once {tmp_path / 'crashed'}"}
    objects = [Toy("bad", {**hazards, **again}), Toy("lethal", unmade="crash"), Toy("odd", unmade="raise"), Toy("well")]
    out = tmp_path / "out"
    run_state, _ = toys(*objects).make(out, ProcessExecutor(2, limit=0.3))
    assert set(tables(out)) == {"well.parquet"}
    told = manifest(out)["objects"]
    assert {name: entry["state"] for name, entry in told.items()} == {
        "bad": "failed", "lethal": "failed", "odd": "failed", "well": "done"
    }  # fmt: skip
    assert told["bad"]["trials"] == 2 * N - 3 and told["bad"]["failures"] == [
        {"type": "NPG", "index": 1, "reason": "its process died (signal SIGKILL)"},
        {"type": "NPG", "index": 7, "reason": "did not end within 0.3 s"},
        {"type": "WPG", "index": 13, "reason": "ValueError: no such thing"},
    ]
    assert told["lethal"]["reason"] == "cannot be made: its process died (signal SIGKILL)"
    assert told["odd"]["reason"] == "cannot be made: ValueError: no such thing"
    assert sorted(line.split(":")[0] for line in run_state.incidents) == ["bad NPG", "bad NPG", "bad WPG", "lethal NPG"]

    _, ran = toys(Toy("bad"), Toy("well")).make(out, InlineExecutor())  # the crashes were the machine's
    assert ran == 3
    toys(Toy("bad"), Toy("well")).make(tmp_path / "whole", InlineExecutor())
    assert tables(out) == tables(tmp_path / "whole")


def test_a_word_can_stand_for_what_failed(tmp_path: Path) -> None:
    T = sample(Toy("a"), toys().provenance(Toy("a")), TRIALS.samplers).T_object_tcp(0, 2 * N)
    toys(Toy("a", {checksum(T[3]): "raise"})).make(tmp_path, InlineExecutor(), failed_as="dropped")
    assert WORDS[read_table(tmp_path / "a.parquet").outcome[3]] == "dropped"
    assert manifest(tmp_path)["objects"]["a"]["failures"][0]["index"] == 3


def test_damaged_shards_and_those_of_other_settings(tmp_path: Path) -> None:
    """A damaged shard is tried again; what was begun with another seed or version is refused, and stays."""
    calls = toys(Toy("a"))
    with pytest.raises(KeyboardInterrupt):
        calls.make(tmp_path, Ending(4))
    shards = sorted((tmp_path / "shards/a").iterdir())
    content = json.loads(shards[0].read_text())
    content["outcomes"][0] = next(word for word in WORDS if word != content["outcomes"][0])
    shards[0].write_text(json.dumps(content))
    shards[1].write_bytes(b"\x00")
    before = {path: path.read_bytes() for path in (*shards, tmp_path / "manifest.json")}
    other = RunState(tmp_path, (1, 1), {**calls.made_with, "seed": 1, "versions": {"physics": "1"}}, types=2)
    with pytest.raises(InputError, match=r"manifest.json: expected trials made with seed 1, got 0"):
        other.open([calls.provenance(Toy("a"), seed=1)]).__enter__()
    with pytest.raises(InputError, match=r"manifest.json: expected trials made with physics 2, got 1; finish with"):
        calls.make(tmp_path, InlineExecutor(), versions="2")
    assert {path: path.read_bytes() for path in before} == before
    run_state, ran = calls.make(tmp_path, InlineExecutor())
    assert ran == 2 * N - 17 + 10 and len(run_state.incidents) == 2


def test_a_full_disk_leaves_nothing_half_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The fifth file does not fit: what was there is whole, nothing else is there, and a second call ends as ever."""
    calls, files = toys(Toy("a")), 0

    def fsync(handle: int) -> None:
        nonlocal files
        files += 1
        if files == 9:
            raise OSError(errno.ENOSPC, "No space left on device")

    calls.make(tmp_path / "whole", InlineExecutor())
    with monkeypatch.context() as patch:
        patch.setattr("os.fsync", fsync)
        with pytest.raises(OSError, match="No space"):
            calls.make(tmp_path / "out", InlineExecutor())
    shards = list((tmp_path / "out/shards/a").iterdir())
    assert shards and all(json.loads(path.read_text())["outcomes"] for path in shards)
    assert not list((tmp_path / "out").rglob("*.part"))
    calls.make(tmp_path / "out", InlineExecutor())
    assert tables(tmp_path / "out") == tables(tmp_path / "whole")


def test_two_calls_do_not_share_a_folder(tmp_path: Path) -> None:
    made_with = {**toys().made_with, "versions": {}}
    with RunState(tmp_path, (1, 2), made_with, 2).open([]):
        with pytest.raises(InputError, match="no other simulate"), RunState(tmp_path, (1, 1), made_with, 2).open([]):
            pass
        with pytest.raises(InputError, match="no other simulate"), RunState(tmp_path, (1, 2), made_with, 2).open([]):
            pass
        with RunState(tmp_path, (2, 2), made_with, 2).open([]):
            pass
    with RunState(tmp_path, (1, 1), made_with, 2).open([]):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["manifest.json"]


def test_a_hand_of_three_types(tmp_path: Path) -> None:
    """Twelve candidates of each, cut off after four chunks of five at most, then taken up again."""
    types = ("claw", "hook", "pinch")
    three = SimpleNamespace(**{**vars(TRIALS), "grasp_types": types, "samplers": dict.fromkeys(types, "surface_pairs")})
    calls = Calls([Toy("a")], three, toss, N)
    with pytest.raises(KeyboardInterrupt):
        calls.make(tmp_path, Ending(4))
    run_state, ran = calls.make(tmp_path, InlineExecutor())
    assert (run_state.trials, ran) == (3 * N, 3 * N - 17)
    table = read_table(tmp_path / "a.parquet")
    assert table.grasp_types == types and table.grasp_type.tolist() == [0] * N + [1] * N + [2] * N
    T = sample(Toy("a"), calls.provenance(Toy("a")), three.samplers).T_object_tcp(2 * N, 3 * N)
    assert [WORDS[code] for code in table.outcome[2 * N :].tolist()] == [
        toss(Toy("a"), three, "pinch")(one) for one in T
    ]
    with pytest.raises(InputError, match="expected trials of the hand's grasp types NPG, WPG; got claw, hook, pinch"):
        toys(Toy("a")).make(tmp_path, InlineExecutor())


def test_a_manifest_of_something_else(tmp_path: Path) -> None:
    for content in (b"[1", b"{}", b'{"schema": 1}', b'{"schema": 2, "made_with": {}, "objects": {}}'):
        (tmp_path / "manifest.json").write_bytes(content)
        with pytest.raises(InputError, match=r"manifest.json: expected a manifest of simulate"):
            toys(Toy("a")).make(tmp_path, InlineExecutor())
        assert [path.name for path in tmp_path.iterdir()] == ["manifest.json"]


@pytest.mark.parametrize(
    ("chunk", "expected"),
    [
        (1, [(0, 1), (1, 2), (3, 4), (4, 5), (6, 7), (7, 8)]),
        (2, [(0, 2), (3, 4), (4, 5), (6, 8)]),
        (100, [(0, 2), (3, 4), (4, 5), (6, 8)]),
    ],
)
def test_chunks_are_of_missing_rows_of_one_type(chunk: int, expected: list[tuple[int, int]]) -> None:
    """Four candidates a type; rows 2 and 5 have an outcome, so 3 and 4 stand together, but are of two types."""
    rows = [None, None, "missed", None, None, "dropped", None, None]
    assert list(_missing(rows, 4, chunk)) == expected
    assert list(_missing(["missed"] * 8, 4, chunk)) == []


def test_progress_counts_every_candidate_once(tmp_path: Path) -> None:
    """Of what runs chunk by chunk, what cannot be made, what has no candidates, and what is there already."""

    class Bare(Toy):
        @property
        def mesh(self) -> None:
            raise ValueError("no surface")

    told: list[int] = []
    calls = toys(Toy("a"), Toy("odd", unmade="raise"), Bare("bare"))
    run_state, ran = calls.make(tmp_path, InlineExecutor(), progress=told.append)
    assert told == [0, 5, 5, 2, 5, 5, 2, 0, 24, 24] and ran == 24
    assert run_state.objects["bare"]["reason"] == "no candidates: ValueError: no surface"
    told.clear()
    with pytest.raises(KeyboardInterrupt):
        toys(Toy("b")).make(tmp_path / "b", Ending(2), progress=told.append)
    toys(Toy("b")).make(tmp_path / "b", InlineExecutor(), chunk=100, progress=told.append)
    assert told == [0, 5, 5, 10, 2, 12]


def test_few_tasks_are_taken_ahead(tmp_path: Path) -> None:
    """Two for each process: of six tasks one process has two when the first ends, and a third at most then."""
    taken: list[int] = []

    def tasks() -> Iterator[Task]:
        for number in range(6):
            taken.append(number)
            case = Case.of(Toy("a"), TRIALS, "NPG", toss)
            yield Task(number, case, np.eye(4, dtype=np.float32)[None])

    results = ProcessExecutor(1).run(tasks())
    assert next(results)[0].name == 0 and len(taken) == 2
    assert next(results)[0].name == 1 and len(taken) <= 3
    results.close()
    assert len(taken) <= 3
