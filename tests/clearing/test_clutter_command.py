"""The command from settings to files: in physics, with one process, on scenes of two things."""

import csv
import json
import re
from pathlib import Path

import pytest
from clearing_cases import config
from commands import ROOT, here

from spgf_torch.clutter import run
from spgf_torch.errors import InputError

FILES = {"results.json", "attempts.csv", "scenes.csv", "index.html", "scenes", "config.yaml"}


@pytest.fixture(scope="module")
def objects(tmp_path_factory):
    """Two boxes that stand and are easily held."""
    folder = tmp_path_factory.mktemp("objects")
    for name in ("soap_bar", "carton_milk"):
        (folder / f"{name}.yaml").write_text((ROOT / f"data/objects/{name}.yaml").read_text())
    return folder


def settings(objects, **changes):
    few = {"method": "random", "views": 4, "scenes": 2, "count": 2, "cache": None}
    return config("panda", **{**few, "objects": objects, **changes})


@pytest.fixture(scope="module")
def done(objects, tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    run(settings(objects), folder)
    return folder


def test_a_run_leaves_rates_rows_and_pictures(done):
    results = json.loads((done / "results.json").read_text())
    assert {path.name for path in done.iterdir()} - {"causes.png"} == FILES
    tables = [(done / name).read_text().splitlines() for name in ("attempts.csv", "scenes.csv")]
    rows, scenes = ([*csv.DictReader(lines)] for lines in tables)
    taken = sum(int(row["success"]) for row in rows)
    assert results["attempts"] == len(rows) > 0 and results["gsr"] == pytest.approx(taken / len(rows), abs=1e-6)
    assert results["dr"] == pytest.approx(taken / sum(int(row["objects"]) for row in scenes), abs=1e-6)
    assert [row["seed"] for row in scenes] == ["0", "1"] and results["method"] == "random"
    assert sum(results["causes"].values()) == len(rows) - taken and sum(results["ended"].values()) == 2


def test_the_same_call_goes_on_where_it_was(done, objects, capsys):
    """One of two scenes is gone: it alone is cleared again, in a process of its own, and to the bit as it was."""
    before = {name: (done / name).read_bytes() for name in ("scenes.csv", "scenes/00000.npz", "scenes/00001.npz")}
    (done / "scenes/00001.json").unlink()
    run(settings(objects, out=done), Path("not used"))
    assert "1 of 2 scenes are kept" in capsys.readouterr().err
    assert {name: (done / name).read_bytes() for name in before} == before


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"objects": "nowhere"}, "objects: expected a folder of meshes or descriptions, got nothing there at nowhere"),
        ({"method": "contact_graspnet"}, "method: expected contact_graspnet with hand=panda and cgn=PYTHON, got no"),
        ({"cgn": "/bin/false", "method": "contact_graspnet"}, "cgn=/bin/false: expected a Python with cgn-pytorch"),
        ({"method": "ours", "model": "sdh2"}, "model: expected one of hand=panda, got one of sdh2"),
        ({"beside": ["nowhere"]}, "beside: expected the folder of another run of clutter, got nothing there"),
    ],
)
def test_what_cannot_be_used_is_told_before_anything_is_begun(changes, told, objects, tmp_path):
    given = {"objects": objects, "out": tmp_path / "run", **changes}
    with pytest.raises(InputError, match=f"^{re.escape(told)}"):
        run(settings(given.pop("objects"), **given), tmp_path)
    assert not (tmp_path / "run").exists()


def test_a_wrong_call_is_one_line_with_status_2(tmp_path):
    done = here("clutter", "method=best", cwd=tmp_path)
    told = "clutter: method: expected one of ours, random, antipodal, contact_graspnet; got best\n"
    assert (done.returncode, done.stderr) == (2, told) and not any(tmp_path.glob("outputs/clutter/*"))
