"""`python -m spgf_torch.baseline`: what it leaves from an export to the comparison, and what it says to bad input."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from composing import composed
from omegaconf import OmegaConf

from spgf_torch.baseline import run
from spgf_torch.baselines.config import BaselineConfig
from spgf_torch.errors import InputError
from spgf_torch.evaluation.folds import stratified_folds
from spgf_torch.export import run as export
from spgf_torch.files.digests import KEY, sealed_json
from spgf_torch.formats.card import checksums
from spgf_torch.formats.config import ExportConfig
from spgf_torch.reporting.data.runs import read_per_object, read_run
from spgf_torch.settings import plain, typed
from spgf_torch.simulation.table import TrialTable, read_table, write_table

ROOT = Path(__file__).parents[1]
NAMES = ("apple", "box_tea", "egg", "sponge")
COARSE = ["sensing.width=160", "sensing.height=120", "sensing.focal=144", "objects=objects", "trials=trials", "folds=2"]
TINY = [
    "export=data",
    "checkpoints=checkpoints",
    "cache=kept",
    "bootstrap=100",
    "network.widths=[8]",
    "network.head=[]",
    "augment.points=16",
    "learning.grasps_per_epoch=64",
    "learning.epochs=2",
    "learning.inner_share=0.5",
]


def baseline(changes: dict[str, Any], folder: str = "run") -> BaselineConfig:
    values = OmegaConf.create(composed("baseline", *COARSE, *TINY))
    for key, value in changes.items():
        OmegaConf.update(values, key, value)
    config = typed(BaselineConfig, values)
    Path(folder).mkdir(exist_ok=True)
    (Path(folder) / "config.yaml").write_text(OmegaConf.to_yaml(OmegaConf.create(plain(config))))
    run(config, Path(folder))
    return config


def first(table: TrialTable, count: int) -> TrialTable:
    rows = [i for i in range(len(table)) if i % (len(table) // 2) < count]
    parts = {key: getattr(table, key)[rows] for key in ("position", "quaternion", "grasp_type", "outcome")}
    return replace(table, provenance=replace(table.provenance, candidates=count), **parts)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four objects, fifty of their trials of each type, and their samples."""
    folder = tmp_path_factory.mktemp("made")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        Path("objects").mkdir()
        Path("trials").mkdir()
        for name in NAMES:
            shutil.copy(ROOT / f"data/objects/{name}.yaml", "objects")
            write_table(Path(f"trials/{name}.parquet"), first(read_table(ROOT / f"data/trials/{name}.parquet"), 50))
        settings = json.dumps({"candidates": 50, "seed": read_table(Path("trials/egg.parquet")).provenance.seed})
        Path("trials/config.yaml").write_text(settings)
        small = ["format=webdataset", "out=data", "samples.points=20", "samples.per_shard=120"]
        export(typed(ExportConfig, composed("export", *COARSE, *small)), Path("run"))
    return folder


@pytest.fixture
def here(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    shutil.copytree(made, tmp_path / "here")
    monkeypatch.chdir(tmp_path / "here")
    return tmp_path / "here"


def test_it_leaves_what_train_leaves(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config = baseline({})
    told = capsys.readouterr()
    results = json.loads(Path("run/results.json").read_text())
    assert results["ranking"] == "calibrated" and results["N"] == 10 and results["folds"] == 2
    assert list(results["by_ranking"]) == ["calibrated", "log_odds", "log_odds_free", "nested"]
    assert results["success_rate"] == results["by_ranking"]["calibrated"]
    assert set(results["success_rate"]) == {"boxes", "curved", "all"} and set(results["chosen"]) == {"0", "1"}
    assert {"reading", "learning", "total"} <= set(results["seconds"])
    assert set(results["costs"]) == {"model_bytes", "prediction_ms", "training_s"}
    assert Path("run/fold1/model.safetensors").stat().st_size == results["costs"]["model_bytes"]
    assert Path("run/fold0/logs/csv/metrics.csv").is_file() and not list(Path("checkpoints").iterdir())
    assert "all CG" in told.out and "random" in told.out and "2 epochs" not in told.out and "shards" in told.err
    known = read_run(Path("run"))  # as compare reads it
    rows = read_per_object(known)
    folds = stratified_folds([row.category for row in rows], 2, 0).tolist()
    assert [row.name for row in rows] == list(NAMES) and [row.fold for row in rows] == folds
    assert known.dataset and known.settings["trials_per_object"] == config.trials_per_object


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"device": "abacus"}, ["device", "abacus"]),
        ({"export": "nowhere"}, ["export", "nowhere", "python -m spgf_torch.export"]),
        ({"export": "objects"}, ["export", "objects", "card.json"]),
        ({"folds": 3}, ["card.json", "folds=3", "got 2"]),
        ({"seed": 1}, ["card.json", "seed=1", "got 0"]),
        ({"sensing.cameras": 3}, ["card.json", "sensing.cameras=3", "got 4"]),
        ({"trials": "nowhere"}, ["nowhere", "simulate"]),
        ({"network.widths": []}, ["network.widths", "got []"]),
        ({"learning.rate": 7}, ["learning.rate", "got 7"]),
        ({"ranking": "paper"}, ["ranking", "calibrated", "got paper"]),
    ],
)
def test_bad_settings(changes: dict[str, Any], words: list[str], made: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(made)
    refused(words, changes)


def refused(words: list[str], changes: dict[str, Any] | None = None) -> None:
    with pytest.raises(InputError) as error:
        baseline(changes or {}, folder="refused")
    assert "\n" not in str(error.value) and all(word in str(error.value) for word in words), error.value
    assert {path.name for path in Path("refused").iterdir()} <= {"config.yaml"}


def test_shards_and_cards_that_are_not_right(here: Path) -> None:
    folder = Path("data/webdataset/samples")
    shards = sorted(folder.iterdir())
    assert [path.name for path in shards] == [f"fold{f}-00{n}.tar" for f in (0, 1) for n in (0, 1)]
    whole = shards[1].read_bytes()
    shards[1].write_bytes(whole[: len(whole) // 2])
    refused(["fold0-001.tar", "cut off"])
    shards[1].write_bytes(shards[3].read_bytes())
    refused(["fold0-001.tar", "card.json", "damaged or another"])
    listed(shards)
    refused(["fold0-001.tar", "class and fold", "of fold 1"])
    shards[1].write_bytes(shards[0].read_bytes())
    listed(shards)
    refused(["fold0-001.tar", "each trial once", "second"])
    shards[1].unlink()
    refused(["samples of all 400 trials", "got"])
    shards[0].rename(shards[1])
    refused(["fold0-000.tar", "no such file"])
    shards[1].rename(shards[0])
    shards[1].write_bytes(whole)
    card = json.loads(Path("data/card.json").read_text())
    del card[KEY]
    for change, words in (
        ({"formats": ["isaac"]}, ["card.json", "webdataset", "isaac"]),
        ({"objects": card["objects"][1:]}, ["card.json", "apple", "none of this name"]),
        ({"objects": [{**card["objects"][0], "digest": "x"}, *card["objects"][1:]]}, ["apple", "another"]),
        ({"objects": 7}, ["card.json", "objects", "7"]),
    ):
        Path("data/card.json").write_bytes(sealed_json({**card, **change}))
        refused(words)


def listed(shards: list[Path]) -> None:
    """Write the checksums of the shards as they are onto the card."""
    card = json.loads(Path("data/card.json").read_text())
    known = checksums(Path("data"))
    card["files"] = {file: known.get(file, about) for file, about in card["files"].items()}
    Path("data/card.json").write_bytes(sealed_json({key: card[key] for key in card if key != KEY}))


def test_trials_that_ended_otherwise(here: Path) -> None:
    table = read_table(Path("trials/egg.parquet"))
    write_table(Path("trials/egg.parquet"), replace(table, outcome=(table.outcome + 1) % 2))
    refused([".tar: egg_", "as trials= has it"])
