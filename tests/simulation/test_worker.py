"""One process: what it answers, how it ends, how long it waits, and what it keeps from chunk to chunk."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from toys import TRIALS, Toy

from spgf_torch.simulation import worker
from spgf_torch.simulation.worker import Case, error_line, try_chunk
from spgf_torch.simulation.worker_process import WorkerClosedError, WorkerDiedError, WorkerProcess

T = np.tile(np.eye(4, dtype=np.float32), (3, 1, 1))


@pytest.fixture
def process() -> Iterator[WorkerProcess]:
    its = WorkerProcess()
    yield its
    its.close()


def test_one_process_answers_until_it_dies(process: WorkerProcess) -> None:
    """Its answers come from one process, another one from then on, and none once it is closed."""
    first = process.call(os.getpid)
    assert process.call(os.getpid) == first != os.getpid()
    with pytest.raises(RuntimeError, match=r"ZeroDivisionError"):
        process.call(divmod, 1, 0)
    assert process.call(os.getpid) == first
    with pytest.raises(WorkerDiedError, match=r"^its process died \(status 3\)$") as died:
        process.call(os._exit, 3)
    assert not died.value.overdue and process.call(os.getpid) not in (first, os.getpid())
    process.kill()
    with pytest.raises(WorkerClosedError):
        process.call(os.getpid)


def test_how_a_process_died() -> None:
    """A negative status is a signal; status 1 is the watch over the time."""
    told = {code: (str(WorkerDiedError(code)), WorkerDiedError(code).overdue) for code in (-signal.SIGSEGV, 0, 1, 2)}
    assert told == {
        -11: ("its process died (signal SIGSEGV)", False),
        0: ("its process died (status 0)", False),
        1: ("did not end in time", True),
        2: ("its process died (status 2)", False),
    }


def test_a_process_uses_one_thread(process: WorkerProcess, monkeypatch: pytest.MonkeyPatch) -> None:
    """Unless the caller's environment says otherwise."""
    monkeypatch.delenv("OMP_NUM_THREADS", raising=False)
    assert process.call(os.getenv, "OMP_NUM_THREADS") == "1"


def test_an_error_in_one_line() -> None:
    assert error_line(ValueError("first\nsecond\nthird")) == "ValueError: first"
    assert error_line(KeyError()) == "KeyError"
    assert error_line(OSError("x" * 300)) == "OSError: " + 200 * "x"


def counted(built: list[str], outcome: str = "success") -> Callable[..., Any]:
    """Trials that all end alike; an object that is loaded is noted."""

    def make(obj: Toy, trials: Any, kind: str) -> Callable[[np.ndarray], str]:
        built.append(f"{obj.name} {kind}")
        return lambda T: outcome

    return make


def test_loading_may_take_ten_times_as_long_as_a_trial(monkeypatch: pytest.MonkeyPatch) -> None:
    waited: list[float | None] = []

    @contextmanager
    def limited(seconds: float | None) -> Iterator[None]:
        waited.append(seconds)
        yield

    monkeypatch.setattr(worker, "limited", limited)
    worker._trial_function.cache_clear()
    case = Case.of(Toy("a"), TRIALS, "NPG", counted([]))
    assert try_chunk(case, T[:2], 0.25).outcomes == ["success"] * 2
    assert try_chunk(case, T[:1]).outcomes == ["success"]
    assert waited == [2.5, 0.25, 0.25, None, None]


def test_the_last_two_objects_stay_loaded() -> None:
    """A case is an object with a grasp type: of a, b, a, c, a, b only the last b is loaded again."""
    worker._trial_function.cache_clear()
    built: list[str] = []
    make = counted(built)
    for name in "abacab":
        result = try_chunk(Case.of(Toy(name), TRIALS, "WPG", make), T)
        assert result.outcomes == ["success"] * 3 and not result.reasons
    assert built == ["a WPG", "b WPG", "c WPG", "b WPG"]


def test_cases_differ_by_what_decides_about_outcomes() -> None:
    """Object, hand, episode, grasp type and the kind of trial; the object itself is not compared."""
    other: Any = [
        SimpleNamespace(hand=SimpleNamespace(digest="another"), episode=TRIALS.episode),
        SimpleNamespace(hand=TRIALS.hand, episode="another"),
    ]
    make = counted([])
    cases = [Case.of(Toy("a"), trials, "NPG", make) for trials in (TRIALS, *other)]
    cases += [Case.of(Toy("b"), TRIALS, "NPG", make), Case.of(Toy("a"), TRIALS, "WPG", make)]
    cases.append(Case.of(Toy("a"), TRIALS, "NPG"))
    assert len({*cases}) == 6 and Case.of(Toy("a", seconds=9.0), TRIALS, "NPG", make) == cases[0]


def test_one_trial_that_raises_costs_its_own_outcome_alone() -> None:
    worker._trial_function.cache_clear()

    def make(obj: Toy, trials: Any, kind: str) -> Callable[[np.ndarray], str]:
        def attempt(its: np.ndarray) -> str:
            if its[0, 3] == 1:
                raise ValueError("no such thing")
            return "missed"

        return attempt

    moved = T.copy()
    moved[:, 0, 3] = [0, 1, 2]
    result = try_chunk(Case.of(Toy("a"), TRIALS, "NPG", make), moved)
    assert result.outcomes == ["missed", None, "missed"] and result.reasons == {1: "ValueError: no such thing"}


def test_a_process_ends_with_its_caller(process: WorkerProcess) -> None:
    """Even where the caller is killed: its end of the connection is closed then."""
    process.call(os.getpid)
    assert process._process is not None and process._connection is not None
    process._connection.close()
    assert process._process.wait(timeout=5) == 0
