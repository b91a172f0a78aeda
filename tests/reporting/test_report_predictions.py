"""Single grasps: rankings, precision at N, intervals of curves, pictures' geometry."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from report_runs import write_run

from spgf_torch.errors import InputError
from spgf_torch.evaluation.predictions import Predictions, read_predictions, write_predictions
from spgf_torch.evaluation.success import bootstrap_interval
from spgf_torch.reporting.data.predictions import ceilings_at, class_curves, precision_at, predictions_of
from spgf_torch.reporting.data.runs import read_run

TYPES = ("NPG", "WPG", "CG")


def predictions(score: list[float], success: list[int], grasp_type: list[int]) -> Predictions:
    n = len(score)
    scores = {"paper": np.array(score), "log_odds": -np.array(score)}
    outcome, zeros, pose = np.array(success, dtype=bool), np.zeros(n), np.tile([0, 0, 0, 1.0, 0, 0, 0], (n, 1))
    types = np.array(grasp_type)
    return Predictions("a", "boxes", 0, "", scores, zeros, zeros, zeros, outcome, types, outcome, pose, ("NPG", "WPG"))


def test_nested_ranks_by_the_ranking_of_the_objects_fold(tmp_path: Path) -> None:
    one = predictions([3, 1, 2], [1, 0, 1], [0, 0, 0])
    assert one.ranked("paper", "CG", 2).tolist() == [0, 2]
    write_predictions(tmp_path / "predictions.parquet", [replace(one, fold=4), replace(one, name="b", fold=5)])
    first, second = read_predictions(tmp_path / "predictions.parquet", {4: "log_odds"})
    assert first.ranked("nested", "CG", 2).tolist() == [1, 2] and first.chosen == "log_odds"
    assert "nested" not in second.scores and second.chosen == ""


def test_precision_at_n() -> None:
    """By score: held, failed, held (NPG: the first and third, held and held; WPG: the second alone, failed)."""
    one = predictions([3, 2, 1], [1, 0, 1], [0, 1, 0])
    npg, wpg, cg = precision_at([one], "paper", TYPES, 4)[0]
    assert npg.tolist() == [1, 1, 1, 1]
    assert wpg.tolist() == [0, 0, 0, 0]
    assert cg == pytest.approx([1, 1 / 2, 2 / 3, 2 / 3])  # of fewer than N grasps the share is that of all
    assert ceilings_at([one], TYPES, 4)[0, 2] == pytest.approx([1, 1, 2 / 3, 2 / 4])


def test_ties_go_to_the_earlier_grasp_and_silence_comes_last() -> None:
    one = predictions([-np.inf, 1, 1, -np.inf], [0, 0, 0, 0], [0, 0, 0, 0])
    assert one.ranked("paper", "NPG", 4).tolist() == [1, 2, 0, 3]


def test_intervals_of_curves_are_those_of_the_table() -> None:
    """The same resampling of objects within classes: equal up to the noise of two thousand draws."""
    rng = np.random.default_rng(0)
    classes = ["boxes"] * 8 + ["curved"] * 4
    values = rng.random((12, 1))
    theirs = bootstrap_interval(classes, [{"CG": float(v[0])} for v in values], 2000, 0)
    for name, (mean, low, high) in class_curves(classes, values, 2000, 1).items():
        members = [i for i, c in enumerate(classes) if name in ("all", c)]
        assert mean == pytest.approx(values[members].mean(axis=0))
        assert (low[0], high[0]) == pytest.approx(theirs[name]["CG"], abs=0.02)


def test_poses_become_matrices() -> None:
    """90 deg about z (w first) takes x to y; the length of a quaternion does not matter."""
    at = replace(predictions([1.0], [1], [0]), pose=np.array([[0.1, 0.2, 0.3, 2.0, 0, 0, 2.0]])).T_object_tcp[0]
    assert at @ [1, 0, 0, 1] == pytest.approx([0.1, 1.2, 0.3, 1]) and at @ [0, 0, 1, 0] == pytest.approx([0, 0, 1, 0])


def test_predictions_are_read_as_they_were_written(tmp_path: Path) -> None:
    run = read_run(write_run(tmp_path / "run", model=False))
    objects = predictions_of(run, "nested")
    assert [c.name for c in objects] == ["mug_coffee", "box_tea", "egg"] and len(objects[0].success) == 40
    for name, kinds in run.by_ranking["nested"].items():
        shown = [c for c in objects if name in ("all", c.category)]
        rates = precision_at(shown, "nested", TYPES, run.N)[:, :, -1].mean(axis=0)
        assert rates == pytest.approx([kinds[kind] for kind in ("NPG", "WPG", "CG")], abs=1e-6)
    with pytest.raises(InputError, match=r"predictions\.parquet.*ranking best"):
        predictions_of(run, "best")


@pytest.mark.parametrize("content", [b"", b"PAR1 and then nothing"])
def test_damaged_predictions_are_told_in_a_line(tmp_path: Path, content: bytes) -> None:
    run = read_run(write_run(tmp_path / "run", model=False))
    (run.folder / "predictions.parquet").write_bytes(content)
    with pytest.raises(InputError, match=r"predictions\.parquet") as error:
        predictions_of(run, "nested")
    assert "\n" not in str(error.value)
