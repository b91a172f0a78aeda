"""Rates, intervals, causes and rows of rounds, against values worked out by hand."""

import csv
import json
import math
from dataclasses import replace

import numpy as np
import pytest
from clearing_cases import config, scene

from spgf_torch.clearing.outcomes import (
    Counts,
    attempt_rows,
    causes,
    clutter_results,
    csv_text,
    rates,
    resampled,
    scene_row,
    share,
)
from spgf_torch.clearing.tables import clutter_table

# Two of three tries took something from four objects; one of two from two; nothing was tried on three.
SCENES = [
    scene(0, [True, False, True], objects=4, causes=["dropped"], probability=0.75),
    scene(1, [False, True], objects=2, causes=["approach"], probability=0.25),
    scene(2, [], objects=3, ended="no grasp"),
]


def test_rates_are_of_all_attempts_and_all_objects():
    results = clutter_results(SCENES, config())
    assert results["gsr"] == pytest.approx(3 / 5) and results["dr"] == pytest.approx(3 / 9)
    assert (results["scenes"], results["objects"], results["attempts"]) == (3, 9, 5)
    assert results["ended"] == {"clear": 2, "no grasp": 1}
    assert results["seconds"] == {"sensing": 0.1, "planning": 0.3, "execution": 0.2}
    assert [row["cleared"] for row in results["per_scene"]] == [2, 1, 0]


def test_an_interval_is_that_of_scenes_drawn_with_replacement():
    """A slow loop over the same draws; draws of the scene without attempts alone have no rate."""
    counts = Counts.of(SCENES)
    rows = np.random.default_rng(0).integers(3, size=(1000, 3))
    expected = []
    for row in rows:
        taken, tried = sum(counts.taken[i] for i in row), sum(counts.tried[i] for i in row)
        expected.append(taken / tried if tried else math.nan)
    found = resampled(counts, Counts.gsr, config())
    np.testing.assert_array_equal(found, expected)
    assert np.isnan(found).any()
    its = share(counts, Counts.gsr, config())
    assert [its.low, its.high] == [1 / 2, 2 / 3] and its.value == 0.6  # every rate lies between those of the two scenes


def test_nothing_tried_has_no_rate():
    its = share(Counts.of([SCENES[2]]), Counts.gsr, config())
    assert math.isnan(its.value) and math.isnan(its.low)
    assert share(Counts.of([SCENES[2]]), Counts.dr, config()).value == 0
    nothing = clutter_results([SCENES[2]], config())
    assert nothing["gsr"] is None and nothing["gsr_interval95"] == [None, None] and nothing["dr"] == 0
    assert math.isnan(rates(nothing, "ours").success.value) and rates(nothing, "ours").cleared.value == 0
    assert "-" in [str(cell) for cell in clutter_table(nothing).columns[3].cells]
    assert clutter_results([], config())["attempts"] == 0
    assert set(nothing["probability"].values()) == {None}


def test_causes_of_failures_are_counted_the_most_frequent_first():
    more = scene(3, [False, False], causes=["dropped", "missed"])
    assert list(causes([*SCENES, more]).items()) == [("dropped", 2), ("approach", 1), ("missed", 1)]


def test_probabilities_are_held_to_what_happened():
    """Foretold: 0.75 held, 0.25 not, 0.25 held; 0.25 not, 0.75 held. Of the six pairs five are in order, or half."""
    said = clutter_results(SCENES, config())["probability"]
    pairs = [(p, q) for p in (0.75, 0.25, 0.75) for q in (0.25, 0.25)]
    assert said["auc"] == pytest.approx(np.mean([1.0 if p > q else 0.5 for p, q in pairs]))
    assert said["mean"] == pytest.approx(0.45)
    # Two of 0.75, both held: 0.25 off; three of 0.25, of which a third held: 1/12 off.
    assert said["ece"] == pytest.approx(2 / 5 * 0.25 + 3 / 5 / 12)
    assert clutter_results(SCENES, config(method="antipodal"))["probability"] is None


@pytest.mark.parametrize("held", [True, False])
def test_without_a_pair_there_is_no_auc(held):
    """Both held, or both failed, at 0.75 and 0.25: no order to be right or wrong, but an error of 0.5 on average."""
    results = clutter_results([scene(0, [held, held], causes=["missed", "missed"], probability=0.75)], config())
    assert results["probability"]["auc"] is None and results["probability"]["ece"] == pytest.approx(0.5)
    cells = [next(iter(column.cells)) for column in clutter_table(results).columns]
    assert cells[5:7] == ["-", "0.50"]


def test_names_of_a_scene_can_be_told_apart():
    """Whatever they are: `tall` and `flat cube` are not `tall flat` and `cube`."""
    its = scene(0, [True], objects=2)
    tall, flat = (replace(its.round.objects[0], name=name) for name in ("tall", "flat cube"))
    row = scene_row(replace(its, round=replace(its.round, objects=(tall, flat))))
    assert row["names"] == ["tall", "flat cube"]
    (cells,) = csv.DictReader(csv_text([row]).splitlines())
    assert json.loads(cells["names"]) == ["tall", "flat cube"]


def test_rows_of_attempts():
    rows = attempt_rows(scene(7, [False, True], causes=["table"], probability=math.nan))
    assert [row["left"] for row in rows] == [3, 3] and [row["object"] for row in rows] == ["", "tall"]
    assert rows[1]["cause"] == "none" and rows[0]["cause"] == "table" and rows[1]["x"] == pytest.approx(0.01)
    assert rows[0]["down"] == -1.0  # it points up
    lines = csv_text(rows).splitlines()
    assert lines[0].startswith("scene,seed,fold,attempt,left") and len(lines) == 3
    assert lines[1].startswith("7,7,,0,3,NPG,,0,table,,cube,0.0,0.02,0.03,-1.0,0.1,0.3,0.2,50,1,0")
