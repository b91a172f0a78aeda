"""Means and intervals over seeds and objects together, against a count of all draws by hand."""

from itertools import product

import numpy as np
import pytest

from spgf_torch.evaluation.seeds import interval_over_seeds, mean_over_seeds
from spgf_torch.evaluation.success import bootstrap_interval

# Of three seeds: two boxes, one of which is hard under the last seed alone, and a curved object.
RATES = [[0.9, 0.5, 0.2], [0.8, 0.6, 0.2], [0.1, 0.7, 0.5]]
CLASSES = ["boxes", "boxes", "curved"]


def of_seeds(values: list[list[float]]) -> list[list[dict[str, float]]]:
    return [[{"CG": value} for value in row] for row in values]


def all_draws(values: np.ndarray) -> np.ndarray:
    """The mean of every way to draw as many rows and as many columns as there are."""
    seeds, objects = (list(product(range(n), repeat=n)) for n in values.shape)
    return np.array([values[np.ix_(s, o)].mean() for s in seeds for o in objects])


def test_mean_by_hand() -> None:
    """Boxes: (0.9 + 0.5 + 0.8 + 0.6 + 0.1 + 0.7) / 6 = 0.6; curved: 0.9 / 3 = 0.3; all: (3.6 + 0.9) / 9 = 0.5."""
    means = mean_over_seeds(CLASSES, of_seeds(RATES))
    assert {name: row["CG"] for name, row in means.items()} == pytest.approx({"boxes": 0.6, "curved": 0.3, "all": 0.5})


def test_interval_is_that_of_all_draws() -> None:
    """27 draws of seeds and 4 of boxes, each as likely: the interval is neither that of seeds nor that of boxes."""
    exact = np.quantile(all_draws(np.array(RATES)[:, :2]), (0.025, 0.975))
    found = interval_over_seeds(CLASSES, of_seeds(RATES), 40_000, seed=0)
    assert found["boxes"]["CG"] == pytest.approx(exact, abs=0.011)
    # One curved object: what is left is the draw of seeds, of which 1 in 27 is the last one thrice.
    assert found["curved"]["CG"] == pytest.approx((0.2, 0.5))
    over_objects = bootstrap_interval(CLASSES, of_seeds(RATES)[0], 1000, 0)["boxes"]["CG"]
    assert exact[0] < over_objects[0] - 0.1


def test_seeds_move_all_objects_together() -> None:
    """100 objects, two seeds, one 0.2 better on each: a seed is drawn twice half of the time, so 0.4 to 0.6 stays.

    Drawn for each object by itself, the seeds would cancel, and the interval be a tenth as wide.
    """
    found = interval_over_seeds(["boxes"] * 100, of_seeds([[0.4] * 100, [0.6] * 100]), 1000, seed=0)
    assert found["boxes"]["CG"] == pytest.approx((0.4, 0.6)) and found["all"]["CG"] == pytest.approx((0.4, 0.6))


def test_classes_are_drawn_with_the_same_seeds() -> None:
    """The two classes of one object move in opposite directions: their mean does not move."""
    found = interval_over_seeds(["boxes", "curved"], of_seeds([[0.1, 0.9], [0.9, 0.1]]), 500, seed=0)
    assert found["boxes"]["CG"] == pytest.approx((0.1, 0.9)) and found["all"]["CG"] == pytest.approx((0.5, 0.5))


def test_one_seed_is_the_bootstrap_over_objects() -> None:
    rates = of_seeds([[i / 30 for i in range(30)]])
    found = interval_over_seeds(["boxes"] * 30, rates, 20_000, seed=1)["all"]["CG"]
    assert found == pytest.approx(bootstrap_interval(["boxes"] * 30, rates[0], 20_000, 2)["all"]["CG"], abs=0.005)
