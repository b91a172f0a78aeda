"""Work shared among threads: in order, few parts at once, errors and early ends leave nothing changed."""

from collections.abc import Iterator

import pytest
import torch

from spgf_torch.threads import in_parts, one_thread


@pytest.fixture(params=[1, 2])
def threads(request) -> Iterator[int]:
    before = torch.get_num_threads()
    torch.set_num_threads(request.param)
    yield request.param
    assert torch.get_num_threads() == request.param
    torch.set_num_threads(before)


@pytest.mark.parametrize("count", [0, 1, 2, 50])
def test_results_come_in_order(threads, count):
    assert list(in_parts(lambda i: (i, torch.get_num_threads()), range(count))) == [
        (i, 1 if count > 1 else threads) for i in range(count)
    ]


def test_parts_are_taken_as_they_are_needed(threads):
    taken = []
    results = in_parts(lambda i: i, (taken.append(i) or i for i in range(100)))
    assert next(results) == 0
    assert len(taken) <= threads + 3
    results.close()


def test_an_error_is_the_callers(threads):
    with pytest.raises(ZeroDivisionError):
        list(in_parts(lambda i: 1 // (3 - i), range(10)))


def test_work_within_work_does_not_wait_for_itself(threads):
    inner = lambda i: sum(in_parts(lambda j: i * j, range(4)))  # noqa: E731
    assert list(in_parts(inner, range(8))) == [6 * i for i in range(8)]


@pytest.mark.parametrize("rounds", [1, 20])
def test_parts_that_keep_torch_to_one_thread_leave_it_so(threads, rounds):
    """Else a later part would share its own parts among threads that all wait for theirs."""

    def inner(i):
        with one_thread():
            alone = torch.get_num_threads()
        return alone, torch.get_num_threads(), sum(in_parts(lambda j: i * j, range(4)))

    assert list(in_parts(inner, range(4 * rounds))) == [(1, 1, 6 * i) for i in range(4 * rounds)]
    with one_thread():
        with one_thread():
            pass
        assert torch.get_num_threads() == 1
