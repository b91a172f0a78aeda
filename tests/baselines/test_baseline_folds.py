"""Training fold by fold: what is learned, that a run that was killed goes on exactly, what the logs hold."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from tiny import RADIUS, TRIALS, config, tiny

from spgf_torch.baselines import fit as fitting
from spgf_torch.baselines.costs import costs
from spgf_torch.baselines.data import Data, provenance_of, taught_rows
from spgf_torch.baselines.folds import (
    JUDGED,
    MODEL,
    calibrated,
    inner_split,
    predictions_of,
    run_fold,
    run_folds,
    scores,
)
from spgf_torch.baselines.lightning_module import GraspClassifier
from spgf_torch.baselines.work_folder import claimed, hand_over
from spgf_torch.errors import InputError
from spgf_torch.experiment.described_object import sample_of_each_type
from spgf_torch.extras import installed
from spgf_torch.progress import ProgressReporter


def nothing() -> None:
    """Progress that nobody looks at."""


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Data:
    return tiny(tmp_path_factory.mktemp("tiny") / "samples")


@pytest.fixture(scope="module")
def done(data: Data, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Both folds, long enough to learn what the clouds tell."""
    work = tmp_path_factory.mktemp("work")
    run_folds(data, config(epochs=8, patience=8, grasps_per_epoch=256), work, "origin", ProgressReporter())
    return work


def test_it_learns_what_the_clouds_tell(data: Data, done: Path) -> None:
    logits = run_folds(data, config(epochs=8, patience=8, grasps_per_epoch=256), done, "origin", ProgressReporter())
    novel = predictions_of(data, logits, 5)
    assert [o.name for o in novel] == [o.name for o in data.objects]
    for found, fold in zip(novel, data.fold.tolist(), strict=True):
        assert found.fold == fold and set(found.scores) == {"calibrated", "log_odds", "log_odds_free", "nested"}
        best = np.argsort(-found.scores["calibrated"])[:5]
        assert found.success[best].all() and len(found.pose) == TRIALS
        assert found.probability.min() >= 0 and found.probability.max() <= 1
    spent = costs(data, logits, config(), done, 1.0)
    assert spent["model_bytes"] == (done / "fold0" / MODEL).stat().st_size and spent["prediction_ms"] > 0
    assert spent["training_s"] == pytest.approx(1.0 + sum(each.seconds for each in logits.values()))


def test_what_is_left(done: Path) -> None:
    for fold in (0, 1):
        names = {str(path.relative_to(done / f"fold{fold}")) for path in (done / f"fold{fold}").rglob("*")}
        assert {MODEL, JUDGED, "logs/csv/metrics.csv"} <= names and not any("ckpt" in name for name in names)
        with (done / f"fold{fold}/logs/csv/metrics.csv").open() as file:
            rows = list(csv.DictReader(file))
        losses = [float(row["inner_loss"]) for row in rows if row["inner_loss"]]
        assert len(losses) == 8 and losses[-1] < losses[0]
        assert bool(list((done / f"fold{fold}").rglob("events.out.tfevents*"))) == installed("tensorboard")


class Killed(BaseException):
    """Stands for SIGKILL: nobody catches it, nothing is tidied up."""


@pytest.mark.parametrize("epoch", [1, 4])
def test_a_killed_fold_goes_on_as_if_nothing_had_happened(
    epoch: int, data: Data, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Killed behind an epoch's checkpoint, also the last one's: the same networks to the bit."""
    whole = run_fold(data, config(), 0, tmp_path / "whole", "origin", nothing)
    save, saved = fitting.WholeCheckpoints.save_checkpoint, []

    def killing(self: object, checkpoint: dict, path: object, storage_options: object = None) -> None:
        save(self, checkpoint, path, storage_options)  # type: ignore[arg-type]
        saved.append(path)
        if Path(str(path)).name == fitting.LAST and checkpoint["epoch"] == epoch - 1:
            raise Killed

    with monkeypatch.context() as patch, pytest.raises(Killed):
        patch.setattr(fitting.WholeCheckpoints, "save_checkpoint", killing)
        run_fold(data, config(), 0, tmp_path / "cut", "origin", nothing)
    assert not (tmp_path / "cut" / MODEL).exists() and (tmp_path / "cut" / fitting.LAST).exists()
    epochs = []
    monkeypatch.setattr(GraspClassifier, "on_train_epoch_end", lambda self: epochs.append(self.current_epoch))
    again = run_fold(data, config(), 0, tmp_path / "cut", "origin", nothing)
    assert epochs == list(range(epoch, 4))
    with (tmp_path / "cut/logs/csv/metrics.csv").open() as file:
        assert [row["epoch"] for row in csv.DictReader(file) if row["inner_loss"]] == ["0", "1", "2", "3"]
    assert (tmp_path / "cut" / MODEL).read_bytes() == (tmp_path / "whole" / MODEL).read_bytes()
    assert all(torch.equal(again.novel[i], whole.novel[i]) for i in whole.novel)


@pytest.mark.parametrize("change", ["cut", "another"])
def test_other_checkpoints_are_begun_anew(change: str, data: Data, tmp_path: Path) -> None:
    whole = run_fold(data, config(), 0, tmp_path / "whole", "origin", nothing)
    folder = tmp_path / "fold"
    folder.mkdir()
    torch.save({"origin": "another"}, folder / fitting.LAST)
    if change == "cut":
        (folder / fitting.LAST).write_bytes((folder / fitting.LAST).read_bytes()[:100])
    again = run_fold(data, config(), 0, folder, "origin", nothing)
    assert all(torch.equal(again.novel[i], whole.novel[i]) for i in whole.novel)


@pytest.mark.parametrize("file", [fitting.LAST, fitting.BEST, JUDGED])
def test_a_damaged_file_of_a_fold_is_refused(
    file: str, data: Data, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One bit of what a call left that was cut off behind its last epoch, or was finished."""
    folder = tmp_path / "fold"
    if file != JUDGED:
        with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
            patch.setattr("spgf_torch.baselines.folds._keep", cut_off)
            run_fold(data, config(), 0, folder, "origin", nothing)
    else:
        run_fold(data, config(), 0, folder, "origin", nothing)
    content = bytearray((folder / file).read_bytes())
    content[len(content) // 2] ^= 1
    (folder / file).write_bytes(content)
    with pytest.raises(InputError, match=f"{file}: expected .*remove it, and its fold is learned again"):
        run_fold(data, config(), 0, folder, "origin", nothing)
    (folder / file).unlink()
    run_fold(data, config(), 0, folder, "origin", nothing)


def cut_off(*_: object) -> None:
    raise KeyboardInterrupt


def test_it_stops_early(data: Data, tmp_path: Path) -> None:
    """At a rate of 1 the loss does not fall: two epochs after the best one it is over."""
    told = []
    run_fold(data, config(rate=0.9, epochs=40, patience=2), 0, tmp_path / "fold", "origin", lambda: told.append(1))
    assert 3 <= len(told) < 40


def test_a_network_that_diverges_is_refused(data: Data, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bad = torch.tensor([torch.nan])
    monkeypatch.setattr("spgf_torch.baselines.folds.grasp_logits", lambda *_: bad)
    with pytest.raises(InputError, match=r"learning\.rate: .* got 0\.01"):
        run_fold(data, config(epochs=1), 0, tmp_path / "fold", "origin", nothing)


def test_nothing_of_the_fold_teaches(data: Data) -> None:
    classes = [obj.category for obj in data.objects]
    for test in (0, 1):
        teach, inner = inner_split(classes, data.fold, test, 0.34, 0)
        assert sorted([*teach, *inner]) == np.flatnonzero(data.fold != test).tolist() and len(inner) == 1
    with pytest.raises(InputError, match="two at least"):
        inner_split(["boxes"] * 2, np.array([0, 1]), 0, 0.2, 0)


def test_fewer_trials_are_those_that_train_takes(data: Data) -> None:
    rows = taught_rows(data.tables, data.samples.start, 7, 3)
    generator = torch.Generator().manual_seed(3)
    for own, first, table in zip(rows, data.samples.start, data.tables, strict=False):
        assert torch.equal(own - first, sample_of_each_type(table.grasp_type, 7, generator))
        assert torch.bincount(table.grasp_type[own - first]).tolist() == [7, 7]


def test_rankings_by_hand(data: Data, done: Path) -> None:
    logits = run_folds(data, config(), done, "origin", ProgressReporter())
    calibration, chosen = calibrated(data, logits[0], 5)
    logit, kind = torch.tensor([0.0, 2.0, 1.0]), torch.tensor([0, 0, 1])
    ranked = scores(logit, kind, torch.tensor([False, True, False]), calibration)
    assert torch.equal(ranked["log_odds"], logit) and ranked["log_odds_free"].argsort().tolist() == [1, 0, 2]
    assert chosen in ranked and ((ranked["calibrated"] > 0) & (ranked["calibrated"] < 1)).all()


def test_the_provenance_names_all_that_counts(data: Data) -> None:
    first = provenance_of(data, config())
    assert first == provenance_of(data, replace(config(), N=7, bootstrap=100))  # scored by the same networks
    changed = replace(data.samples, cloud=data.samples.cloud + 0.001)
    others = [provenance_of(data, config(rate=0.02)), provenance_of(replace(data, samples=changed), config())]
    others.append(provenance_of(data, replace(config(), seed=1)))
    assert len({first, *others}) == 4


def test_work_is_claimed_and_handed_over(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with claimed(tmp_path / "work", "a" * 64) as work:
        (work / "fold0").mkdir()
        with pytest.raises(InputError, match="no other run"), claimed(tmp_path / "work", "a" * 64):
            pass
    with claimed(tmp_path / "work", "a" * 64) as work:
        (tmp_path / "run").mkdir()
        hand_over(work, tmp_path / "run")
    assert "going on" in capsys.readouterr().err
    assert (tmp_path / "run/fold0").is_dir() and not list((tmp_path / "work").iterdir())
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="checkpoints: expected a folder"), claimed(tmp_path / "file", "b" * 64):
        pass


def test_samples_are_the_trials(data: Data) -> None:
    known = data.samples
    assert known.cloud.dtype == torch.float16 and known.radius == RADIUS and known.start[-1] == len(known.success)
    for i, table in enumerate(data.tables):
        rows = known.rows([i])
        kind, collides, success = data.of(i, rows)
        assert torch.equal(success, table.success) and torch.equal(known.success[rows], success)
        assert torch.equal(known.grasp_type[rows], kind) and len(collides) == TRIALS
        farthest = known.cloud[rows].float().norm(dim=2).amax(1)
        torch.testing.assert_close(farthest, torch.where(success, 0.08, 0.02), atol=1e-4, rtol=0)
    assert json.dumps(known.start) == json.dumps([TRIALS * i for i in range(7)])
