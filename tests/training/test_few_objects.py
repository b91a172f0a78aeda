"""One to three objects: a model without cross-validation, and no rate that nobody measured."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file
from small_trainings import SMALL, objects_in, trained

import spgf_torch
from spgf_torch.affordance.calibration import uncalibrated
from spgf_torch.command_settings import command_settings
from spgf_torch.errors import InputError
from spgf_torch.evaluation.results import RATES, read_results
from spgf_torch.experiment.config import TrainConfig
from spgf_torch.experiment.design import Design
from spgf_torch.judging.config import JudgeConfig
from spgf_torch.judging.settings import with_folds_for
from spgf_torch.predictor import block
from spgf_torch.reporting.data.runs import load_runs
from spgf_torch.settings import typed
from spgf_torch.train import run as train
from spgf_torch.training.folds import design_of

TRIALS = str(Path(__file__).parents[2] / "data/trials")


def config(**changes: object) -> TrainConfig:
    return typed(TrainConfig, command_settings("train", {**SMALL, "trials": TRIALS, **changes}))


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The run of two objects, by the command's own function."""
    folder = tmp_path_factory.mktemp("pair")
    (folder / "run").mkdir()
    train(config(objects=str(objects_in(folder / "objects", "mug_coffee", "sponge"))), folder / "run")
    return folder


def test_two_objects_leave_a_model_and_no_rate(pair: Path) -> None:
    results = json.loads((pair / "run/results.json").read_text())
    assert results["no_rates"] == "2 objects, too few for a cross-validation, which takes 4"
    assert {results[key] for key in RATES} == {None} and results["folds"] == 0
    assert {path.name for path in (pair / "run").iterdir()} == {
        "hand",
        "results.json", "model.json", "model.safetensors", "README.md"
    }  # fmt: skip
    card = (pair / "run/README.md").read_text()
    assert "Not measured: 2 objects, too few" in card and "each held out once" in card and "%" not in card
    model = spgf_torch.load(pair / "run")
    assert model.predict(block(model.sensing.spacing), top=3)


def test_a_function_leaves_what_the_command_leaves(pair: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """To the bit; it prints nothing, and tells each step of each stage."""
    heard: dict[str, list[int]] = {}
    model = trained(
        pair / "objects", pair / "other", progress=lambda name, done, total: heard.setdefault(name, []).append(done)
    )
    assert capsys.readouterr() == ("", "")
    assert heard["sensing"] == [1, 2] and heard["voting"] == [1, 2, 3]  # each held out, and both together
    for name in ("model.json", "model.safetensors", "README.md"):
        assert (pair / "run" / name).read_bytes() == (pair / "other" / name).read_bytes(), name
    assert model.model is not None and (pair / "other/config.yaml").is_file()
    told = json.loads((pair / "other/results.json").read_text())
    assert told["dataset"] == json.loads((pair / "run/results.json").read_text())["dataset"]


def test_those_who_read_rates_say_why_there_are_none(pair: Path) -> None:
    with pytest.raises(
        InputError, match=r"success_rate: expected rates on novel objects, got none: 2 objects, too few"
    ):
        read_results(pair / "run/results.json")
    told: list[str] = []
    (pair / "run/config.yaml").write_text("{}")
    with pytest.raises(InputError, match=r"^runs: expected at least one finished run of train, got none in "):
        load_runs(str(pair / "run"), told.append)
    assert len(told) == 1 and "got none: 2 objects, too few" in told[0]


def test_of_one_object_probabilities_are_not_calibrated(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = trained(objects_in(tmp_path / "objects", "mug_coffee"), tmp_path / "run", progress=True).model
    out = capsys.readouterr().out
    assert "no rates: 1 object, too few for a cross-validation, which takes 4; a model is learned all the same" in out
    assert model is not None
    assert torch.equal(model.calibration.numbers, uncalibrated(model.condensed.base_rate).numbers)
    assert "Its probabilities are not calibrated" in (tmp_path / "run/README.md").read_text()


def test_of_two_objects_each_is_held_out_once(pair: Path) -> None:
    tensors = load_file(pair / "run/model.safetensors")
    assert not torch.equal(tensors["calibration"], uncalibrated(tensors["base_rate"]).numbers)
    assert Design(np.array([-1, -1]), np.array([1, 0]), 9).inner_folds() == {(1,): [(None, 0)], (0,): [(None, 1)]}
    alone = Design(np.array([-1]), np.array([0]), 9)
    assert alone.inner_folds() == {} and alone.training(None) == [0] and alone.tests == [] == alone.asking


def test_four_objects_are_cross_validated() -> None:
    design, why = design_of(["boxes"] * 4, config())
    assert sorted(design.fold.tolist()) == [0, 1, 2, 3] and not why
    design, why = design_of(["boxes"] * 3, config(folds=3))
    assert sorted(design.fold.tolist()) == [0, 1, 2] and not why


@pytest.mark.parametrize(
    ("objects", "changes", "words"),
    [
        (3, {"folds": 4}, "folds: expected at most one for each of the 3 objects, got 4"),
        (6, {"folds": 7}, "folds: expected at most one for each of the 6 objects, got 7"),
        (2, {"folds": 2}, "objects: expected two at least to learn from in each of the folds (2), got 1"),
        (2, {"final_model": False}, "final_model: expected true with fewer than 4 objects (2), got false"),
        (3, {"fold_models": True}, "fold_models: expected false with fewer than 4 objects (3), got true"),
        (1, {"ranking": "judge"}, "ranking: expected one of votes with fewer than 4 objects (1), got judge"),
    ],
)
def test_what_wants_a_cross_validation_is_refused(objects: int, changes: dict[str, object], words: str) -> None:
    with pytest.raises(InputError) as error:
        design_of(["boxes"] * objects, config(**changes))
    assert str(error.value).startswith(words) and "\n" not in str(error.value)


def test_a_judge_has_a_fold_for_each_of_few_objects() -> None:
    settings = typed(JudgeConfig, command_settings("judge", {"objects": "mine"}))
    assert with_folds_for(settings, 3).folds == 3 and with_folds_for(settings, 6).folds == 5
    assert with_folds_for(typed(JudgeConfig, command_settings("judge", {"folds": 4})), 3).folds == 4  # refused later
    with pytest.raises(InputError, match=r"^objects: expected two at least to learn a judge, .* got 1 in mine; "):
        with_folds_for(settings, 1)
