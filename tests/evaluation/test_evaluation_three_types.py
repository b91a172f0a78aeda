"""Rates of a hand of three grasp types, of unlike numbers; and the paper's beside those of its own hand alone."""

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from rich.console import Console
from trial_tables import trial_table

from spgf_torch.affordance.config import NESTED, RANKINGS, AffordanceConfig
from spgf_torch.errors import InputError
from spgf_torch.evaluation import paper, tables
from spgf_torch.evaluation.card import model_card
from spgf_torch.evaluation.executed import ObjectOutcome, executed_results
from spgf_torch.evaluation.files import write_per_object
from spgf_torch.evaluation.predictions import Predictions, read_predictions, write_predictions
from spgf_torch.evaluation.results import build_results
from spgf_torch.evaluation.success import ceiling, random_rate, top_n
from spgf_torch.experiment.config import EvaluateConfig, TrainConfig
from spgf_torch.features.config import FeatureConfig
from spgf_torch.hands.config import HandConfig, PreshapeConfig
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.settings import settings
from spgf_torch.simulation.table import OUTCOMES, TrialTable

TYPES = ("claw", "hook", "pinch")
SCORE = np.array([0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3])
SUCCESS = np.array([False, True, True, False, True, False, False])
GRASP_TYPE = np.array([2, 0, 2, 1, 2, 0, 2])


def test_top_n_by_hand() -> None:
    """Best two claws: 1, 5 -> 1/2; the hook: 3 -> 0; best two pinches: 0, 2 -> 1/2; of all: 0, 1 -> 1/2.

    With 2 as the third of all, 2/3; the best three pinches are 0, 2 and 4 -> 2/3.
    """
    assert top_n(SCORE, SUCCESS, GRASP_TYPE, 2, TYPES) == {"claw": 0.5, "hook": 0.0, "pinch": 0.5, "CG": 0.5}
    three = top_n(SCORE, SUCCESS, GRASP_TYPE, 3, TYPES)
    assert three == pytest.approx({"claw": 1 / 2, "hook": 0, "pinch": 2 / 3, "CG": 2 / 3})


def test_random_and_ceiling_by_hand() -> None:
    """One of two claws, none of one hook, two of four pinches, three of seven; two best by outcome: 1/2, 0, 1, 1."""
    rates = random_rate(SUCCESS, GRASP_TYPE, TYPES)
    assert rates == pytest.approx({"claw": 1 / 2, "hook": 0, "pinch": 2 / 4, "CG": 3 / 7})
    assert ceiling(SUCCESS, GRASP_TYPE, 2, TYPES) == {"claw": 0.5, "hook": 0.0, "pinch": 1.0, "CG": 1.0}


def predictions() -> list[Predictions]:
    """Two objects in two folds, with the grasps above."""
    zeros, pose = np.zeros(7), np.tile([0.1, 0, 0, 1.0, 0, 0, 0], (7, 1))
    scores = dict.fromkeys((*RANKINGS, NESTED), SCORE)
    outcomes = (zeros, SCORE, zeros, SUCCESS, GRASP_TYPE, zeros > 0, pose, TYPES)
    one = Predictions("bowl", "containers", 0, "paper", scores, *outcomes)
    return [one, replace(one, name="brick", category="boxes", fold=1)]


@pytest.fixture
def config() -> TrainConfig:
    made = TrainConfig(K=20, N=2, folds=2, seed=0, ranking="paper", bootstrap=100, objects="mine", trials="ours")
    preshapes = {name: PreshapeConfig() for name in TYPES}
    made.hand = replace(settings(HandConfig), name="gripper", preshapes=preshapes)
    made.affordance, made.sensing = settings(AffordanceConfig), settings(SensingConfig)
    made.features = settings(FeatureConfig)
    return made


def test_predictions_come_back(tmp_path: Path) -> None:
    write_predictions(tmp_path / "predictions.parquet", predictions())
    back = read_predictions(tmp_path / "predictions.parquet", {0: "paper", 1: "paper"})
    assert [each.grasp_types for each in back] == [TYPES, TYPES]
    assert all(np.array_equal(each.grasp_type, GRASP_TYPE) for each in back)
    assert back[1].ranked("paper", "pinch", 3).tolist() == [0, 2, 4]
    assert back[1].ranked("paper", "CG", 2).tolist() == [0, 1]


def test_objects_of_unlike_types_are_refused(tmp_path: Path) -> None:
    one, other = predictions()
    write_predictions(tmp_path / "predictions.parquet", [one, replace(other, grasp_types=("claw", "hook", "scoop"))])
    with pytest.raises(InputError, match="grasps of each of claw, hook, pinch, scoop on every object"):
        read_predictions(tmp_path / "predictions.parquet", {})


def shown(content: object) -> str:
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(content)
    return console.export_text()


def test_results_are_of_each_type(config: TrainConfig, tmp_path: Path) -> None:
    results = build_results(predictions(), config, "d1")
    assert results["grasp_types"] == list(TYPES) and results["hand"] == "gripper"
    assert results["by_ranking"]["paper"]["all"] == {"claw": 0.5, "hook": 0.0, "pinch": 0.5, "CG": 0.5}
    assert list(results["random"]["boxes"]) == list(TYPES) and list(results["calibration"]) == list(TYPES)
    assert [results["calibration"][name]["candidates"] for name in TYPES] == [4, 2, 8]
    write_per_object(tmp_path / "rates.csv", predictions(), 2)
    assert "paper_claw,paper_hook,paper_pinch,paper_CG" in (tmp_path / "rates.csv").read_text().splitlines()[0]


def test_the_papers_rates_stand_beside_its_own_hand_alone(config: TrainConfig) -> None:
    """Not beside other types of a hand of that name, nor beside two types of those names of another hand."""
    results = build_results(predictions(), config, "d1")
    table, card = (
        shown(tables.results_table(results)),
        model_card(results, config, objects=2, trials=14, size=2_000_000),
    )
    for text in (table, shown(tables.results_table({**results, "hand": "sdh2"})), card):
        assert "RobWorkSim" not in text and "83.8" not in text and "50.0" in text
    assert "boxes pinch" in table and "boxes CG" in table and "…" not in table
    assert "| class | claw | hook | pinch | CG | random claw | random hook | random pinch |\n|---|---|" in card
    own = settings(HandConfig)
    assert paper.is_papers_hand(own) and not paper.is_papers_hand(replace(own, name="panda"))
    assert not paper.is_papers_hand(replace(config.hand, name="sdh2"))


def table(outcome: list[str]) -> TrialTable:
    """Trials of the types claw, hook, hook, pinch, pinch, pinch that ended so."""
    T, codes = torch.eye(4).repeat(6, 1, 1), torch.tensor([OUTCOMES.index(word) for word in outcome])
    return replace(trial_table(T, torch.tensor([0, 1, 1, 2, 2, 2]), codes), grasp_types=TYPES)


def test_chance_of_each_type() -> None:
    """Of two boxes claws hold one in two, hooks never, pinches three in six; the paper's stand beside its own types."""
    both = [
        table(["success", "missed", "dropped", "success", "success", "missed"]),
        table(["collision", "collision", "slipped", "missed", "collision", "success"]),
    ]
    text = shown(tables.random_rates(["boxes", "boxes"], both, papers=False))
    rows = [line.split() for line in text.splitlines() if line.strip().startswith("boxes")]
    assert rows == [["boxes", "claw", "50.0"], ["boxes", "hook", "0.0"], ["boxes", "pinch", "50.0"]]
    assert "paper" not in text
    paired = [replace(each, grasp_type=each.grasp_type.clamp(max=1), grasp_types=("NPG", "WPG")) for each in both]
    assert "46.6" in shown(tables.random_rates(["boxes", "boxes"], paired, papers=True))


def test_a_type_that_never_held_is_told() -> None:
    """Hooks fail on both objects, two of the four in a collision; claws and pinches hold on one object."""
    both = [
        table(["success", "missed", "collision", "missed", "missed", "missed"]),
        table(["missed", "collision", "slipped", "missed", "missed", "success"]),
    ]
    assert tables.hopeless_types(both, "gripper") == [
        "NO SUCCESS with the grasp type hook: of 4 trials none held its object, in 2 the open hand cut it; "
        "check gripper, given as here: python -m spgf_torch.hand hand=..."
    ]
    (only,) = tables.hopeless_types([table(["success", "success", "missed", *["collision"] * 3])], "gripper")
    assert "type pinch: of 3 trials none held its object, in 3 the open hand cut it" in only
    assert tables.hopeless_types([table(["success"] * 6)], "gripper") == []


def test_executed_rates_of_each_type() -> None:
    """A column for each type and one for all, and as many of random candidates."""
    best = {"claw": 1.0, "hook": 0.25, "pinch": 0.5, "CG": 0.75}
    outcome = ObjectOutcome("bowl", "containers", best, dict.fromkeys(best, 0.125), 0.5)
    results = executed_results([outcome], EvaluateConfig(N=4, ranking="paper", bootstrap=100, seed=0))
    assert results["grasp_types"] == list(TYPES)
    columns = tables.executed_table(results).columns[2:]
    assert [str(column.header) for column in columns] == [*best, *(f"random {name}" for name in best)]
    assert [column._cells[0] for column in columns[:4]] == ["100.0", "25.0", "50.0", "75.0"]
