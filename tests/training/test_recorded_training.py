"""Recorded trials teach what the same trials of simulation teach, to the bit; clouds take the place of meshes."""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import torch
import trimesh
from safetensors.torch import load_file
from small_trainings import SMALL, objects_in, rows_of, trained, written

import spgf_torch
from spgf_torch.affordance.joined_pairs import JoinedPairs
from spgf_torch.affordance.pairs import CellPairs
from spgf_torch.command_settings import command_settings
from spgf_torch.errors import InputError
from spgf_torch.experiment.config import TrainConfig
from spgf_torch.objects.library import load_objects
from spgf_torch.predictor import block
from spgf_torch.settings import typed
from spgf_torch.training.checks import check_recorded

NAMES = ("mug_coffee", "sponge")


@pytest.fixture(scope="module")
def objects(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return objects_in(tmp_path_factory.mktemp("recorded") / "objects", *NAMES)


def tensors(run: Path) -> dict[str, torch.Tensor]:
    return load_file(run / "model.safetensors")


def test_a_table_of_ones_own_teaches_what_ours_does(
    objects: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As text, and as Parquet with the rows of both objects mixed; the digest of the data is the same, too."""
    rows = [row for name in NAMES for row in rows_of(name)]
    table = written(tmp_path / "mine.csv", [{**row, "operator": "me"} for row in rows])
    trained(objects, tmp_path / "ours")
    trained(objects, tmp_path / "theirs", trials=table, progress=True)
    ours, theirs = tensors(tmp_path / "ours"), tensors(tmp_path / "theirs")
    assert ours.keys() == theirs.keys() and all(torch.equal(ours[name], theirs[name]) for name in ours)
    digests = [json.loads((tmp_path / run / "results.json").read_text())["dataset"] for run in ("ours", "theirs")]
    assert digests[0] == digests[1]
    out = capsys.readouterr().out
    assert "nothing is done with the columns operator" in out
    assert "4,000 trials: NPG " in out and " of 2,000 held (" in out
    assert "4,000 recorded trials" in (tmp_path / "theirs/README.md").read_text()


def test_parquet_in_any_order_teaches_the_same(objects: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Trials of one object keep their order, between which those of others may stand. Without `out` nothing is left."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    rows = {name: rows_of(name, range(900, 1100)) for name in NAMES}
    mixed = [row for pair in zip(*rows.values(), strict=True) for row in pair]
    pq.write_table(pa.Table.from_pylist(mixed), tmp_path / "mixed.parquet")
    written(tmp_path / "apart.csv", [row for own in rows.values() for row in own])
    first, second = (trained(objects, None, trials=tmp_path / name).model for name in ("mixed.parquet", "apart.csv"))
    assert first is not None and second is not None
    assert torch.equal(first.condensed.probability, second.condensed.probability)
    assert not list(tmp_path.glob("spgf_torch_*"))


def clouds(folder: Path, name: str, cameras: int, rows: list[dict]) -> list[dict]:
    """Rows of trials on an object, seen by so many recordings in turn, each of which lies elsewhere."""
    (obj,) = [each for each in load_objects(Path(__file__).parents[2] / "data/objects") if each.name == name]
    points, faces = trimesh.sample.sample_surface(obj.mesh, 8_000, seed=0)
    for k in range(cameras):
        shift = np.array([0.5 * k, 0.0, 0.0])
        np.savez(folder / f"{name}{k}.npz", points=points + shift, normals=obj.mesh.face_normals[faces])
    return [
        {**row, "x": row["x"] + 0.5 * (i % cameras), "cloud": f"{name}{i % cameras}.npz", "class": "curved"}
        for i, row in enumerate(rows)
    ]


def test_a_recorded_cloud_takes_the_place_of_a_mesh(tmp_path: Path) -> None:
    """Two recordings of one object, half a metre apart, teach together; those of the other alone."""
    rows = clouds(tmp_path, "mug_coffee", 2, rows_of("mug_coffee", range(800, 1200)))
    rows += clouds(tmp_path, "sponge", 1, rows_of("sponge", range(800, 1200)))
    table = written(tmp_path / "mine.csv", rows)
    model = trained(None, tmp_path / "run", trials=table)
    results = json.loads((tmp_path / "run/results.json").read_text())
    assert results["no_rates"].startswith("2 objects") and model.model is not None
    assert model.model.settings["taught"].keys() == {"mug_coffee", "sponge"}
    assert len(model.model.condensed.cell) and spgf_torch.load(tmp_path / "run").predict(block(0.005), top=2)


def test_pairs_of_several_clouds_are_numbered_through() -> None:
    """Cloud 0: features 0, 1 and grasps 0, 1, 2; cloud 1: features 2, 3, 4 and grasps 3, 4."""

    def pairs(feature: list[int], grasp: list[int], types: list[int]) -> CellPairs:
        cells = [10 * f + g for f, g in zip(feature, grasp, strict=True)]
        return CellPairs(*(torch.tensor(each, dtype=torch.int32) for each in (feature, grasp, cells)),
                         torch.tensor(types))  # fmt: skip

    both = JoinedPairs([pairs([0, 1, 1], [2, 0, 1], [0, 1, 0]), pairs([0, 2], [1, 0], [1, 1])], [2, 3])
    listed = both.listed()
    assert listed.feature.tolist() == [0, 1, 1, 2, 4] and listed.grasp.tolist() == [2, 0, 1, 4, 3]
    assert listed.cell.tolist() == [2, 10, 11, 1, 20] and both.grasp_type.tolist() == [0, 1, 0, 1, 1]
    assert both.listed(torch.tensor([False, True, False, False, True])).feature.tolist() == [1, 1, 4]
    assert both.most(5).tolist() == [1, 2, 1, 0, 1]
    some = both.of_grasps(torch.tensor([1, 2, 3]))
    assert some.grasp_type.tolist() == [1, 0, 1]
    assert some.listed().feature.tolist() == [0, 1, 4] and some.listed().grasp.tolist() == [1, 0, 2]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"object": "teapot"}, "row 1: object: expected one of objects="),
        ({"x": 700.0, "y": 0.0}, "row 1: x: expected metres, 10 at most, got '700.0'"),
        ({"x": 0.9}, ": x: expected a TCP within 0.2 m of sponge, got one 0."),
        ({"cloud": "none.pcd"}, "row 1: cloud: expected a file in "),
    ],
)
def test_rows_that_have_nothing_to_do_with_an_object(objects: Path, change: dict, words: str, tmp_path: Path) -> None:
    rows = rows_of("sponge", range(3))
    table = written(tmp_path / "mine.csv", [{**row, **change} for row in rows])
    with pytest.raises(InputError) as error:
        trained(objects, tmp_path / "run", trials=table)
    assert words in str(error.value) and str(table) in str(error.value) and "\n" not in str(error.value)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(("held", "words"), [(1, "expected trials that failed, too"), (0, "expected trials that held")])
def test_of_one_outcome_nothing_is_learned(objects: Path, held: int, words: str, tmp_path: Path) -> None:
    rows = [{**row, "success": held} for row in rows_of("sponge", range(4))]
    with pytest.raises(InputError, match=rf"mine.csv: success: {words}.*got 4 that all {'held' if held else 'failed'}"):
        trained(objects, tmp_path / "run", trials=written(tmp_path / "mine.csv", rows))


def test_what_a_type_cannot_teach_is_told(objects: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """WPG was never tried, and NPG on one object: an object without trials has no rate."""
    rows = rows_of("mug_coffee", range(600)) + rows_of("sponge", range(300))
    trained(objects, tmp_path / "run", trials=written(tmp_path / "mine.csv", rows), progress=True)
    out = capsys.readouterr().out
    assert "WPG: no trials: no grasp of this type will be proposed" in out
    results = json.loads((tmp_path / "run/results.json").read_text())
    assert results["no_rates"] and results["success_rate"] is None
    proposed = spgf_torch.load(tmp_path / "run").predict(block(0.005), top=3)
    assert {grasp.type for grasp in proposed} <= {"NPG"}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"judge": "learn"}, "judge: expected none with recorded trials"),
        ({"ranking": "judge"}, "ranking: expected one of votes with recorded trials"),
        ({"runner": "dask"}, "runner: expected local with recorded trials"),
    ],
)
def test_what_does_not_go_with_recorded_trials(changes: dict, words: str) -> None:
    config = typed(TrainConfig, command_settings("train", {**SMALL, "trials": "mine.csv", **changes}))
    with pytest.raises(InputError, match=rf"^{words}"):
        check_recorded(config)
