"""The command from settings to files: in physics, with one process, on scenes of two things."""

import csv
import json
from pathlib import Path

import pytest
from clearing_cases import config
from commands import ROOT, call

from spgf_torch.clutter import run
from spgf_torch.errors import IncompleteError, InputError

FILES = {"results.json", "attempts.csv", "scenes.csv", "index.html", "scenes"}


@pytest.fixture(scope="module")
def objects(tmp_path_factory):
    """Two boxes that stand and are easily held."""
    folder = tmp_path_factory.mktemp("objects")
    for name in ("soap_bar", "carton_milk"):
        (folder / f"{name}.yaml").write_text((ROOT / f"data/objects/{name}.yaml").read_text())
    return folder


def settings(objects, **changes):
    given = {"hand": "panda", "method": "random", "views": 4, "scenes": 2, "count": 2, "film": 0, "cache": "null"}
    return config(**{**given, "objects": objects, **changes})


@pytest.fixture(scope="module")
def done(objects, tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    run(settings(objects), folder)
    return folder


def test_a_run_leaves_rates_rows_and_pictures(done):
    results = json.loads((done / "results.json").read_text())
    assert {path.name for path in done.iterdir()} - {"causes.png", "film.gif"} == FILES
    rows = list(csv.DictReader((done / "attempts.csv").open()))
    scenes = list(csv.DictReader((done / "scenes.csv").open()))
    taken = sum(int(row["success"]) for row in rows)
    assert results["attempts"] == len(rows) > 0 and results["gsr"] == pytest.approx(taken / len(rows), abs=1e-6)
    assert results["dr"] == pytest.approx(taken / sum(int(row["objects"]) for row in scenes), abs=1e-6)
    assert [row["seed"] for row in scenes] == ["0", "1"] and results["method"] == "random"
    assert sum(results["causes"].values()) == len(rows) - taken and sum(results["ended"].values()) == 2
    assert (done / "film.gif").is_file() == any(row["scene"] == "0" for row in rows)


def test_the_same_call_goes_on_where_it_was(done, objects, capsys):
    """One of two scenes is gone: it alone is cleared again, in a process of its own, and to the bit as it was."""
    before = {name: (done / name).read_bytes() for name in ("scenes.csv", "scenes/00000.npz", "scenes/00001.npz")}
    (done / "scenes/00001.json").unlink()
    run(settings(objects, out=done), Path("not used"))
    assert "1 of 2 scenes are kept" in capsys.readouterr().err
    assert {name: (done / name).read_bytes() for name in before} == before
    with pytest.raises(InputError, match=r"00000\.json: expected a scene of these settings"):
        run(settings(objects, out=done, seed=7), Path("not used"))


def test_scenes_that_take_too_long_are_told_and_the_others_are_kept(objects, tmp_path):
    with pytest.raises(IncompleteError, match=r"^1 of 1 scenes without an end: scene 0: did not end in time"):
        run(settings(objects, scenes=1, time_limit=1), tmp_path)
    assert json.loads((tmp_path / "results.json").read_text())["scenes"] == 0


@pytest.mark.parametrize(
    ("overrides", "told"),
    [
        (["objects=nowhere"], "objects: expected a folder of meshes or descriptions, got nothing there at nowhere"),
        (
            ["method=contact_graspnet"],
            "method: expected contact_graspnet with hand=panda and cgn=PYTHON, got hand=sdh2",
        ),
        (["model=nowhere"], "nowhere"),
        (["beside=[nowhere]"], "beside: expected the folder of another run of clutter, got nothing there at nowhere"),
        (["views=0"], "views: expected a number from 1 to 24, got 0"),
        (["method=best"], "method: expected one of ours, random, antipodal, contact_graspnet; got best"),
    ],
)
def test_what_cannot_be_used_is_told_in_one_line(overrides, told, tmp_path):
    done = call("clutter", *overrides, cwd=tmp_path)
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1 and told in done.stderr, done.stderr
    assert not (tmp_path / "outputs").exists() or not any((tmp_path / "outputs/clutter").iterdir())
