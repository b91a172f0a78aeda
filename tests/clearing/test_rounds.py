"""Rounds with a method and a simulator that do what the test says; sensing is real."""

import numpy as np
import pytest
from clearing_cases import OBJECTS, PLACED, config

from spgf_torch.clearing.methods import Chosen
from spgf_torch.clearing.rounds import Bench
from spgf_torch.simulation.attempts import Attempt
from spgf_torch.simulation.touching import TABLE


class Planned:
    """A method that chooses x = 0.01, 0.02, ... m; None in the place of the last of `many`."""

    def __init__(self, many=100):
        self.many, self.avoided, self.seen = many, [], []

    def choose(self, sensed, avoid):
        self.avoided.append(avoid[:, 0].round(6).tolist())
        self.seen.append(sensed)
        if len(self.avoided) > self.many:
            return None
        T = np.eye(4)
        T[0, 3] = 0.01 * len(self.avoided)
        return Chosen("WPG", T, 0.75, seconds=10.0)


class Simulated:
    """An executor: of each attempt the index that is taken, None for a failure, and those that are lost."""

    def __init__(self, *ends):
        self.ends, self.given = list(ends), []

    def run(self, placed, T_world_tcp, grasp_type, film):
        self.given.append([each.obj.name for each in placed])
        taken, lost = self.ends.pop(0)
        left = tuple(each for k, each in enumerate(placed) if k != taken and k not in lost)
        cause = "none" if taken is not None else "table"
        touched = (0, TABLE) if cause == "table" else ()
        return Attempt("failed" if touched else "success", cause, taken, touched, (), (), lost, left)


def cleared(simulated, planned=None, placed=PLACED, **changes):
    return Bench(config(**changes), planned or Planned(), simulated).clear(placed, 5, False)


def test_a_round_ends_when_the_scene_is_clear():
    simulated = Simulated((1, ()), (1, ()), (0, ()))
    its, measured = cleared(simulated)
    assert simulated.given == [["tall", "flat", "cube"], ["tall", "cube"], ["tall"]]
    assert (its.ended, its.cleared, its.last) == ("clear", 3, None)
    assert [each.taken for each in its.attempts] == [1, 2, 0]  # of the objects that the scene began with
    assert [each.view.present for each in its.attempts] == [(0, 1, 2), (0, 2), (0,)]
    assert all(each.planning >= 10.0 > each.sensing for each in measured)


def test_two_failures_in_a_row_end_it_and_a_success_between_them_does_not():
    planned = Planned()
    its, _ = cleared(Simulated((None, ()), (0, ()), (None, ()), (None, ())), planned)
    assert its.ended == "failures in a row" and [each.success for each in its.attempts] == [False, True, False, False]
    assert planned.avoided == [[], [0.01], [], [0.03]]
    assert its.attempts[0].touched == "tall, table" and its.attempts[0].cause == "table"


def test_places_of_failures_are_forgotten_where_that_is_asked_for():
    planned = Planned()
    cleared(Simulated((None, ()), (None, ()), (None, ())), planned, remember=False, failures=3)
    assert planned.avoided == [[], [], []]


def test_what_is_lost_counts_as_not_cleared():
    its, measured = cleared(Simulated((0, (2,)), (None, (0,))))
    assert (its.ended, its.cleared, len(its.objects)) == ("clear", 1, 3)
    assert [each.lost for each in measured] == [1, 1] and its.attempts[1].view.present == (1,)


def test_without_a_grasp_what_is_left_is_shown():
    its, _ = cleared(Simulated((0, ())), Planned(1))
    assert its.ended == "no grasp" and its.last.present == (1, 2) and len(its.last.points) > 20


def test_what_nobody_sees_ends_a_round():
    far = PLACED[0].T_world_object.copy()
    far[0, 3] = 3.0
    its, measured = cleared(Simulated(), placed=(type(PLACED[0])(OBJECTS[0], far),))
    assert its.ended == "nothing seen" and not its.attempts and not measured


@pytest.mark.parametrize("table", ["given", "find"])
def test_the_same_scene_is_sensed_the_same_and_each_attempt_with_noise_of_its_own(table):
    bench = Bench(config(table=table), None, None)
    first, again, other = (bench.sense(PLACED, (5, k)) for k in (0, 0, 1))
    np.testing.assert_array_equal(first.views[0].depth, again.views[0].depth)
    assert first.scene.texlets.positions.equal(again.scene.texlets.positions) and first.seed == again.seed
    assert (first.views[0].depth != other.views[0].depth).any() and first.seed != other.seed
    points = first.scene.texlets.positions
    assert 0.1 < points[:, 2].max() < 0.13 and points[:, 2].min() > 0.007 and not len(first.scene.obstacles)
    np.testing.assert_allclose(first.scene.table, [0, 0, 1, 0], atol=0 if table == "given" else 5e-3)
