"""`python -m spgf_torch.export`: what it leaves, and what it says to bad input."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from composing import composed

from spgf_torch.errors import InputError
from spgf_torch.evaluation.folds import stratified_folds
from spgf_torch.export import run
from spgf_torch.formats.acronym import read_acronym
from spgf_torch.formats.card import check_card
from spgf_torch.formats.config import FORMATS, ExportConfig
from spgf_torch.formats.samples import read_samples
from spgf_torch.formats.shards import read_shards
from spgf_torch.settings import typed
from spgf_torch.simulation.table import TrialTable, read_table, write_table

ROOT = Path(__file__).parents[1]
NAMES = ("apple", "egg", "sponge")
SMALL = ["objects=objects", "trials=trials", "folds=2", "samples.points=16", "out=data"]
COARSE = ["sensing.width=160", "sensing.height=120", "sensing.focal=144"]


def export(*overrides: str) -> None:
    Path("run").mkdir(exist_ok=True)
    run(typed(ExportConfig, composed("export", *SMALL, *COARSE, *overrides)), Path("run"))


def says(*overrides: str) -> str:
    with pytest.raises(InputError) as error:
        export(*overrides)
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with three of the objects and the first hundred of their trials of each type."""
    monkeypatch.chdir(tmp_path)
    Path("objects").mkdir()
    Path("trials").mkdir()
    for name in NAMES:
        shutil.copy(ROOT / f"data/objects/{name}.yaml", "objects")
        write_table(Path(f"trials/{name}.parquet"), first(read_table(ROOT / f"data/trials/{name}.parquet"), 100))
    return tmp_path


def first(table: TrialTable, count: int) -> TrialTable:
    rows = [i for i in range(len(table)) if i % (len(table) // 2) < count]
    parts = {key: getattr(table, key)[rows] for key in ("position", "quaternion", "grasp_type", "outcome")}
    return replace(table, provenance=replace(table.provenance, candidates=count), **parts)


def test_everything_at_once(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    export(f"format=[{','.join(FORMATS)}]")
    said = capsys.readouterr().out
    known = check_card(Path("data"))  # every file has its checksum
    assert known["counts"]["trials"] == 600 and known["counts"]["objects"] == 3
    assert known["formats"] == list(FORMATS) and known["license"] == "not stated"
    held = sum(int(read_table(Path(f"trials/{name}.parquet")).success.sum()) for name in NAMES)
    assert known["counts"]["success"] == held == known["outcomes"]["success"]
    assert sum(block["trials"] for block in known["rates"]["all"].values()) == 600
    assert "600" in said and "README.md" in said and "acronym" in said
    folds = stratified_folds([entry["class"] for entry in known["objects"]], 2, 0).tolist()
    assert [entry["fold"] for entry in known["objects"]] == folds
    readme = Path("data/README.md").read_text()
    assert all(f"{name}/" in readme for name in FORMATS) and "not stated" in readme
    assert "size_categories: [n<1K]" in readme.split("---\n")[1] and "license:" not in readme.split("---\n")[1]
    _the_formats_agree()


def _the_formats_agree() -> None:
    shards = read_shards(Path("data/webdataset"))
    for kind in ("NPG", "WPG"):
        acronym = read_acronym(Path(f"data/acronym/sdh2_{kind}/curved_egg_1.0.h5"))
        rows = np.load(f"data/graspnet/sdh2_{kind}/egg.npy")
        np.testing.assert_allclose(shards[f"egg_{kind}"].transforms, acronym.transforms, atol=1e-9)
        np.testing.assert_array_equal(shards[f"egg_{kind}"].object_in_gripper, acronym.object_in_gripper == 1)
        np.testing.assert_array_equal(rows[:, 0], acronym.object_in_gripper)
        assert acronym.friction == 0.6 and len(rows) == 100
    samples = [s for path in Path("data/webdataset/samples").iterdir() for s in read_samples(path)]
    egg = [sample for sample in samples if sample.object == "egg"]
    held = sum(shards[f"egg_{kind}"].object_in_gripper.sum() for kind in ("NPG", "WPG"))
    assert len(samples) == 600 and len(egg) == 200 and sum(sample.label for sample in egg) == held


def test_a_folder_with_files_is_replaced_only_when_told_so(here: Path) -> None:
    Path("data").mkdir()
    Path("data/mine").write_text("mine")
    assert "overwrite=true" in says("format=graspnet")
    assert "export made" in says("format=graspnet", "overwrite=true")
    assert [path.name for path in Path("data").iterdir()] == ["mine"]
    Path("data/mine").unlink()
    export("format=graspnet")
    export("format=graspnet", "overwrite=true", "license=CC-BY-4.0")
    assert check_card(Path("data"))["license"] == "CC-BY-4.0"
    assert {path.name for path in Path("data").iterdir()} == {
        "README.md",
        "card.json",
        "clouds",
        "graspnet",
        "hand",
        "meshes",
    }
    changed = Path("data/graspnet/sdh2_NPG/egg.npy")
    changed.write_bytes(changed.read_bytes()[:-8])
    with pytest.raises(InputError, match=r"egg\.npy: expected the file of card\.json, got another"):
        check_card(Path("data"))
    assert json.loads(Path("data/card.json").read_text())["objects"][1]["name"] == "egg"


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["format=tfrecord"], [*FORMATS, "got tfrecord"]),
        (["format=[isaac,parquet]"], [*FORMATS, "got parquet"]),
        ([], [*FORMATS, "got none"]),
        (["format=isaac", "trials=nowhere"], ["nowhere", "simulate"]),
        (["format=isaac", "objects=nowhere"], ["nowhere"]),
        (["format=isaac", "hand=panda"], ["apple.parquet", "hand=panda"]),
        (["format=isaac", "out=objects", "overwrite=true"], ["out", "objects"]),
        (["format=isaac", "samples.points=0"], ["samples.points", "got 0"]),
    ],
)
def test_bad_input(overrides: list[str], words: list[str], here: Path) -> None:
    told = says(*overrides)
    assert all(word in told for word in words), told
    assert not Path("data").exists() and not list(here.glob(".*"))


def test_objects_and_tables_that_miss_each_other(here: Path) -> None:
    Path("objects/egg.yaml").rename("egg.yaml")
    told = says("format=isaac")
    assert "egg.parquet" in told and "objects=objects" in told
    Path("egg.yaml").rename("objects/egg.yaml")
    Path("trials/egg.parquet").rename("egg.parquet")
    assert "egg.parquet" in says("format=isaac")
    Path("trials/egg.parquet").write_bytes(Path("egg.parquet").read_bytes()[:4000])
    assert "damaged" in says("format=isaac")
    shutil.copy("trials/apple.parquet", "trials/egg.parquet")  # another object's trials
    assert "egg.parquet" in says("format=isaac") and not Path("data").exists()
