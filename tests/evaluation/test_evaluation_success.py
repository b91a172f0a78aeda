"""Folds, success-rates, chance, ceiling and intervals: by hand, and as the contract of results.json says."""

import csv
import io
import json
from dataclasses import replace

import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml
from rich.console import Console

from spgf_torch.affordance.config import JUDGE, NESTED, RANKINGS, AffordanceConfig
from spgf_torch.errors import InputError
from spgf_torch.evaluation import paper, tables
from spgf_torch.evaluation.card import model_card
from spgf_torch.evaluation.executed import ObjectOutcome, executed_results
from spgf_torch.evaluation.files import write_json, write_per_object
from spgf_torch.evaluation.folds import classwise_folds, stratified_folds, stratified_order
from spgf_torch.evaluation.predictions import Predictions, read_predictions, write_predictions
from spgf_torch.evaluation.reliability import brier, by_flag_alone, predicted, reliability
from spgf_torch.evaluation.results import build_results, object_rates, read_results
from spgf_torch.evaluation.success import bootstrap_interval, ceiling, class_means, random_rate, top_n
from spgf_torch.experiment.config import EvaluateConfig, TrainConfig
from spgf_torch.features.config import FeatureConfig
from spgf_torch.hands.config import HandConfig
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.settings import settings

TYPES = ("NPG", "WPG")
CLASSES_OF_50 = ["containers"] * 20 + ["boxes"] * 14 + ["curved"] * 16


def test_folds_spread_every_class_evenly() -> None:
    fold = stratified_folds(CLASSES_OF_50, 5, seed=0)
    assert np.bincount(fold).tolist() == [10] * 5
    for name in set(CLASSES_OF_50):
        counts = np.bincount(fold[np.array(CLASSES_OF_50) == name], minlength=5)
        assert counts.max() - counts.min() <= 1
    assert np.array_equal(fold, stratified_folds(CLASSES_OF_50, 5, seed=0))
    assert not np.array_equal(fold, stratified_folds(CLASSES_OF_50, 5, seed=1))


def test_folds_of_each_class_are_its_own() -> None:
    """Sorted by name: boxes have folds 0 to 4, containers 5 to 9, curved 10 to 14; sizes differ by at most one."""
    fold, part = classwise_folds(CLASSES_OF_50, 5, seed=0)
    for number, (name, count) in enumerate([("boxes", 14), ("containers", 20), ("curved", 16)]):
        members = np.array(CLASSES_OF_50) == name
        sizes = np.bincount(fold[members] - 5 * number, minlength=5)
        assert sizes.sum() == count and len(sizes) == 5 and sizes.max() - sizes.min() <= 1
        assert (part[members] == number).all()


def test_every_beginning_of_the_order_has_the_proportions() -> None:
    """Of 40, 28 and 32 %, the first 10 hold 4, 2.8 and 3.2: at most one more or less of each."""
    order = stratified_order(CLASSES_OF_50, seed=0)
    assert sorted(order) == list(range(50))
    first = [CLASSES_OF_50[i] for i in order[:10]]
    for name, share in (("containers", 4.0), ("boxes", 2.8), ("curved", 3.2)):
        assert abs(first.count(name) - share) <= 1


def test_reliability_by_hand() -> None:
    """Two bins of 0.5: 0.1 and 0.3 with one success of two, 0.9 with one of one.

    Means 0.2 against 0.5 and 0.9 against 1: ECE = (2 * 0.3 + 1 * 0.1) / 3; Brier = (0.01 + 0.49 + 0.01) / 3.
    """
    p, held = np.array([0.1, 0.3, 0.9]), np.array([False, True, True])
    diagram = reliability(p, held, bins=2)
    assert diagram.count.tolist() == [2, 1]
    assert diagram.predicted == pytest.approx([0.2, 0.9]) and diagram.observed == pytest.approx([0.5, 1.0])
    assert diagram.ece == pytest.approx(0.7 / 3) and brier(p, held) == pytest.approx(0.17)
    assert reliability(np.ones(1), np.ones(1, bool), bins=4).count.tolist() == [0, 0, 0, 1]
    assert reliability(p[:0], held[:0]).ece == 0 and brier(p[:0], held[:0]) == 0


def hand_made() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Six grasps, three of each type; scores with a tie between grasps 1 and 4."""
    score = np.array([0.9, 0.5, 0.1, 0.8, 0.5, 0.2])
    success = np.array([True, False, True, False, True, True])
    return score, success, np.array([0, 0, 0, 1, 1, 1])


def test_top_n_by_hand() -> None:
    """Best two NPG: 0, 1 -> 1/2; WPG: 3, 4 -> 1/2; both together: 0, 3, and of the tie the earlier: 1 -> 1/3."""
    assert top_n(*hand_made(), 2, TYPES) == {"NPG": 0.5, "WPG": 0.5, "CG": 0.5}
    assert top_n(*hand_made(), 3, TYPES)["CG"] == pytest.approx(1 / 3)


def test_grasps_without_support_come_last() -> None:
    score, success, grasp_type = hand_made()
    score[0] = -np.inf
    assert top_n(score, success, grasp_type, 1, TYPES)["NPG"] == 0.0


def test_random_and_ceiling_by_hand() -> None:
    _, success, grasp_type = hand_made()
    assert random_rate(success, grasp_type, TYPES) == pytest.approx({"NPG": 2 / 3, "WPG": 2 / 3, "CG": 4 / 6})
    among = np.array([True, True, False, False, False, False])
    assert random_rate(success, grasp_type, TYPES, among) == {"NPG": 0.5, "WPG": 0.0, "CG": 0.5}
    assert ceiling(success, grasp_type, 4, TYPES) == {"NPG": 0.5, "WPG": 0.5, "CG": 1.0}


def test_all_is_the_mean_over_objects_as_in_table_1() -> None:
    """Paper, K = 20, NPG: (20 * 78.0 + 14 * 13.6 + 16 * 6.3) / 50 = 37.0; WPG 70.4; CG 83.8 (rounded inputs)."""
    row = paper.SUCCESS_RATE[20]
    means = class_means(CLASSES_OF_50, [row[name] for name in CLASSES_OF_50])
    assert means["all"] == pytest.approx(row["all"], abs=0.06)
    assert list(means) == ["containers", "boxes", "curved", "all"]


def test_interval_of_equal_objects_is_a_point() -> None:
    interval = bootstrap_interval(CLASSES_OF_50, [{"NPG": 0.3}] * 50, 200, seed=0)
    assert interval["all"]["NPG"] == pytest.approx([0.3, 0.3])


def test_interval_of_a_proportion() -> None:
    """100 objects, half of them 1: the mean's standard error is 0.05, so 95 % lie within 0.5 +- 0.098."""
    rates = [{"NPG": float(i % 2)} for i in range(100)]
    low, high = bootstrap_interval(["boxes"] * 100, rates, 20_000, seed=0)["boxes"]["NPG"]
    assert (low, high) == pytest.approx((0.402, 0.598), abs=0.012)


def predictions() -> list[Predictions]:
    """Ten objects in five folds: log_odds knows the outcome, probability is right by 0.9, before by 0.5."""
    rng = np.random.default_rng(0)
    objects = []
    for i, name in enumerate(["containers"] * 4 + ["boxes"] * 3 + ["curved"] * 3):
        success, grasp_type = rng.random(60) < 0.4, np.arange(60) % 2
        scores = {ranking: rng.random(60) for ranking in (*RANKINGS, NESTED)}
        scores["log_odds"] = success + 0.1 * rng.random(60)
        before, after = np.full(60, 0.5), np.where(success, 0.9, 0.1)
        votes, pose = rng.integers(0, 9, 60), rng.random((60, 7))
        chosen = "log_odds" if i % 5 else "paper"
        collides = rng.random(60) < 0.3
        objects.append(
            Predictions(
                f"o{i}", name, i % 5, chosen, scores, before, after, votes, success, grasp_type, collides, pose, TYPES
            )
        )
    return objects


@pytest.fixture
def config() -> TrainConfig:
    hand = settings(HandConfig)
    return TrainConfig(K=20, N=10, folds=5, seed=0, ranking="paper", bootstrap=200, hand=hand)


def test_results_keep_the_contract(config: TrainConfig) -> None:
    results = build_results(predictions(), config, "d1")
    blocks = {"success_rate": 3, "random": 2, "random_collision_free": 3, "ceiling": 3}
    for block, kinds in blocks.items():
        assert list(results[block]) == ["containers", "boxes", "curved", "all"]
        assert all(len(rates) == kinds for rates in results[block].values())
    assert results["schema"] == 1 and results["K"] == 20 and results["folds"] == 5
    assert results["success_rate"] == results["by_ranking"]["paper"]
    low, high = results["interval95"]["all"]["CG"]
    assert low <= results["success_rate"]["all"]["CG"] <= high
    assert results["by_ranking"]["log_odds"]["all"]["CG"] == 1.0  # its scores know the outcome
    assert results["chosen"] == {"0": "paper", "1": "log_odds", "2": "log_odds", "3": "log_odds", "4": "log_odds"}
    assert results["dataset"] == "d1"
    block = results["calibration"]["WPG"]
    assert block["brier_before"] == pytest.approx(0.25) and block["brier"] == pytest.approx(0.01)
    assert block["ece"] == pytest.approx(0.1) and block["candidates"] == 300
    free = results["calibration_free"]["WPG"]
    assert free["candidates"] == sum(int((~o.collides & (o.grasp_type == 1)).sum()) for o in predictions())
    assert free["brier"] == pytest.approx(0.01) and free["brier_flag"] > 0.2 and free["ece_flag"] < 0.1


def test_the_flag_alone_is_learned_on_other_folds() -> None:
    """Fold 0 learns from fold 1: of two without the flag one succeeds, of one with it none; fold 1 from fold 0.

    There three of four without it succeed, and none has it: 0.
    """
    flag = np.array([False, False, False, False, False, False, True])
    success = np.array([True, True, True, False, False, True, False])
    fold = np.array([0, 0, 0, 0, 1, 1, 1])
    assert by_flag_alone(flag, success, fold).tolist() == [0.5] * 4 + [0.75, 0.75, 0.0]
    assert by_flag_alone(~flag, success, fold).tolist() == [0.5] * 4 + [0.75, 0.75, 0.0]


def test_what_is_said_of_free_candidates_is_of_these_alone() -> None:
    objects = predictions()
    free, success = predicted(objects, 1, free=True)
    everything, _ = predicted(objects, 1, free=False)
    kept = np.concatenate([~o.collides[o.grasp_type == 1] for o in objects])
    assert np.array_equal(everything["_flag"][kept], free["_flag"]) and len(success) == kept.sum() < len(kept)
    assert np.array_equal(free[""], np.where(success, 0.9, 0.1)) and set(free["_before"]) == {0.5}


def test_files_round_trip(config: TrainConfig, tmp_path) -> None:
    objects = predictions()
    write_json(tmp_path / "results.json", build_results(objects, config, "d1"))
    assert read_results(tmp_path / "results.json")["success_rate"]["all"].keys() == {"NPG", "WPG", "CG"}
    write_per_object(tmp_path / "per_object.csv", objects, 10)
    rows = list(csv.DictReader((tmp_path / "per_object.csv").read_text().splitlines()))
    assert [row["object"] for row in rows] == [f"o{i}" for i in range(10)]
    expected = object_rates(objects[3], 10).by_ranking["paper"]["CG"]
    assert float(rows[3]["paper_CG"]) == pytest.approx(expected)
    write_predictions(tmp_path / "predictions.parquet", objects)
    table = pq.read_table(tmp_path / "predictions.parquet").to_pydict()
    assert len(table["object"]) == 600 and table["object"][60] == "o1" and table["type"][61] == "WPG"
    assert table["score_calibrated"][65] == pytest.approx(objects[1].scores["calibrated"][5], rel=1e-6)
    assert table["qz"][599] == pytest.approx(objects[9].pose[59, 6], rel=1e-6)
    back = read_predictions(tmp_path / "predictions.parquet", {o.fold: o.chosen for o in objects[1:]})
    for read, made in zip(back, objects, strict=True):
        assert (read.name, read.category, read.fold, set(read.scores)) == (
            made.name, made.category, made.fold, set(made.scores),
        )  # fmt: skip
        for name in ("success", "grasp_type", "collides", "votes"):
            assert np.array_equal(getattr(read, name), getattr(made, name))
        assert read.chosen == made.chosen or read.fold == 0
        assert read.scores[NESTED] is read.scores[read.chosen]
    assert not list(tmp_path.glob("*.part"))


def test_the_model_card_says_what_was_measured(config: TrainConfig) -> None:
    for room, values in (("features", FeatureConfig), ("affordance", AffordanceConfig)):
        setattr(config, room, settings(values))
    config.sensing, config.objects, config.trials = settings(SensingConfig), "data/objects", "data/trials"
    results = build_results(predictions(), config, "d1")
    card = model_card(results, config, objects=10, trials=600, size=2_000_000)
    rate = f"{100 * results['by_ranking']['nested']['all']['CG']:.1f}"
    assert rate in card and "600 simulated trials" in card and "2 MB" in card
    by_paper = f"{100 * results['by_ranking']['paper']['boxes']['CG']:.1f}"
    assert card.index("Ranked as in the paper") < card.index(by_paper) < card.index("knows more than the paper's")
    assert rate in card[card.index("knows more than the paper's") :]
    assert yaml.safe_load(card.split("---\n")[1])["pipeline_tag"] == "robotics" and card.startswith("---\n")
    assert "One seed (0)" in card and "RobWorkSim" in card and "83.8" in card
    assert "log_odds in 4 of 5 folds" in card and "| WPG, all | 0.010 | " in card and "## Limits" in card


@pytest.mark.parametrize("content", [None, "", "{", "[]", '{"schema": 2}', json.dumps({"schema": 1})])
def test_foreign_results_are_refused(content: str | None, tmp_path) -> None:
    path = tmp_path / "results.json"
    if content is not None:
        path.write_text(content)
    with pytest.raises(InputError, match=r"results\.json") as error:
        read_results(path)
    assert "\n" not in str(error.value)


def test_the_table_shows_the_paper_beside_ours(config: TrainConfig) -> None:
    console = Console(width=80, record=True, file=io.StringIO())
    results = build_results(predictions(), config, "d1")
    console.print(tables.results_table(results))
    console.print(tables.chosen_line(results), *tables.calibration_lines(results), sep="\n", soft_wrap=True)
    text = console.export_text()
    assert (
        "log_odds in 4 of 5 folds, paper in 1 of 5 folds" in text and "collision: NPG calibrated 0.010 / 0.100" in text
    )
    assert "83.8" in text and "nested" in text and "100.0" in text and "…" not in text
    assert "of one seed (0)" in text and "RobWorkSim" in text and "sensed" in text


def test_a_judge_stands_beside_the_votes(config: TrainConfig) -> None:
    """It knows the outcome of what it judges: nothing fails among its best, and p = 1 or 0 is calibrated."""
    objects = [
        replace(o, scores={**o.scores, JUDGE: np.where(o.collides, -1.0, o.success.astype(float))})
        for o in predictions()
    ]
    results = build_results(objects, config, "d1")
    assert results["by_ranking"][JUDGE]["all"]["CG"] == 1.0
    nested = results["by_ranking"][NESTED]["all"]["CG"]
    assert results["judge_minus_nested"]["mean"]["all"]["CG"] == pytest.approx(1 - nested)
    block = results["calibration_by_ranking"][JUDGE]["NPG"]
    free = sum(int((~o.collides & (o.grasp_type == 0)).sum()) for o in objects)
    assert block == {"candidates": free, "brier": 0.0, "ece": 0.0}
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(tables.results_table(results))
    text = console.export_text()
    assert "judge" in text and "nested" in text and "…" not in text and max(map(len, text.splitlines())) <= 80
    assert f"judge minus nested, CG, all: {100 * (1 - nested):+.1f} points" in tables.judge_lines(results)[1]
    assert tables.judge_lines(build_results(predictions(), config, "d1")) == []


def test_executed_results_keep_the_contract() -> None:
    kinds = ("NPG", "WPG", "CG")
    outcomes = [
        ObjectOutcome(f"o{i}", name, dict.fromkeys(kinds, rate), dict.fromkeys(kinds, 0.1), 0.5)
        for i, (name, rate) in enumerate([("containers", 1.0), ("boxes", 0.5), ("curved", 0.0)])
    ]
    results = executed_results(outcomes, EvaluateConfig(N=10, ranking="paper", bootstrap=200, seed=0))
    assert results["success_rate"]["all"]["CG"] == pytest.approx(0.5)
    assert results["per_object"][1] | {"seconds": 0} == {
        "object": "o1", "class": "boxes", "NPG": 0.5, "WPG": 0.5, "CG": 0.5,
        "random": dict.fromkeys(kinds, 0.1), "seconds": 0,
    }  # fmt: skip
    assert "o2" in str(tables.executed_table(results).columns[0]._cells)


def test_the_sizes_of_the_classes_are_no_chance() -> None:
    """Every container succeeds, no other object does: each resample has 20 of 50, so the interval of all is a point."""
    rates = [{"CG": float(name == "containers")} for name in CLASSES_OF_50]
    assert bootstrap_interval(CLASSES_OF_50, rates, 200, seed=0)["all"]["CG"] == pytest.approx([0.4, 0.4])


def test_intervals_follow_the_seed() -> None:
    rates = [{"CG": (i * 7 % 11) / 11} for i in range(50)]
    first, again, other = (bootstrap_interval(CLASSES_OF_50, rates, 200, seed) for seed in (0, 0, 1))
    assert first == again != other
