"""Rooms that need only torch load nothing heavy, so that a ROS node starts in a second; tables need no simulator."""

import json
from pathlib import Path

import pytest
import torch
from commands import ROOT, in_turn, python

from spgf_torch.affordance.calibration import uncalibrated
from spgf_torch.affordance.config import AffordanceConfig
from spgf_torch.affordance.model import GraspModel, grid_of, save_model
from spgf_torch.affordance.neighbourhood import Condensed
from spgf_torch.features.config import FeatureConfig
from spgf_torch.hands.config import HandConfig
from spgf_torch.prototypes.config import PrototypeConfig
from spgf_torch.sensing.config import SensingConfig
from spgf_torch.settings import plain, settings

HEAVY = ("sapien", "lightning", "hydra", "matplotlib", "pytorch_kinematics", "trimesh")
LIGHT = (
    "geometry.se3",
    "ops.neighbours",
    "features.spgf",
    "prototypes.kmeans",
    "prototypes.kmeans_search",
    "affordance.voting",
)


TABLES = ("simulation.table", "simulation.execute", "experiment.labelled_grasps")
NOT_FOR_A_MODEL = ("sapien", "lightning", "hydra", "matplotlib", "h5py", "pyarrow", "plotly", "sklearn")
IN_TURN = """
import importlib, json, sys

def loaded(heavy):
    return [name for name in heavy if name in sys.modules]

import spgf_torch
found = {{"package": loaded({nothing!r})}}
for name in {light!r}:
    importlib.import_module("spgf_torch." + name)
found["light"] = loaded({heavy!r})
for folder in {folders!r}:
    spgf_torch.load(folder)
found["models"] = loaded({not_for_a_model!r})
for name in {tables!r}:
    importlib.import_module("spgf_torch." + name)
found["tables"] = loaded(["sapien"])
print(json.dumps(found))
"""


def votes(folder: Path, K: int = 3) -> Path:
    """A model of votes that has learned nothing."""
    nothing, base_rate = torch.zeros(0), torch.tensor([0.1, 0.4])
    condensed = Condensed(torch.zeros(2 * K + 1, dtype=torch.int64), nothing.int(), nothing, nothing, base_rate)
    rooms = {"sensing": SensingConfig, "features": FeatureConfig, "prototypes": PrototypeConfig, "hand": HandConfig}
    said = {name: plain(settings(kind)) for name, kind in (rooms | {"affordance": AffordanceConfig}).items()}
    lattice = grid_of(settings(AffordanceConfig))
    save_model(GraspModel(torch.zeros(K, 144), condensed, lattice, uncalibrated(base_rate), said), folder)
    return folder


@pytest.fixture(scope="module")
def loaded(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[str]]:
    """What was loaded that need not be, in a process that imports one thing after the other, what needs least first."""
    folder, judge = votes(tmp_path_factory.mktemp("votes")), ROOT / "data/models/panda"
    code = IN_TURN.format(
        nothing=(*NOT_YET, "numpy"),
        light=LIGHT,
        heavy=HEAVY,
        folders=[str(each) for each in (folder, judge) if each.is_dir()],
        not_for_a_model=NOT_FOR_A_MODEL,
        tables=TABLES,
    )
    done = python("-c", code, cwd=folder)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_importing_the_package_loads_nothing(loaded: dict[str, list[str]]) -> None:
    assert loaded["package"] == []


def test_torch_only_rooms_load_nothing_heavy(loaded: dict[str, list[str]]) -> None:
    assert loaded["light"] == []


def test_models_are_loaded_without_what_only_learning_and_reports_need(loaded: dict[str, list[str]]) -> None:
    assert loaded["models"] == []


def test_trial_tables_are_read_without_sapien(loaded: dict[str, list[str]]) -> None:
    assert loaded["tables"] == []


NOT_YET = (
    "torch",
    "roma",
    "scipy",
    "matplotlib",
    "pyarrow",
    "lightning",
    "sapien",
    "h5py",
    "trimesh",
    "numba",
    "plotly",
    "sklearn",
)
NOT_THERE = [
    ("predict", "input=missing.ply"),
    ("predict", "input=[empty,empty]"),
    ("predict", "input=model.json", "mask=missing.png"),
    ("predict", "input=model.json", "model=missing"),
    ("evaluate", "objects=.", "model=missing"),
    ("train", "objects=missing"),
    ("train", "trials=missing"),
    ("simulate", "objects=missing"),
    ("export", "format=isaac", "trials=missing"),
    ("report", "runs=missing"),
    ("compare", "runs=missing"),
    ("baseline", "export=missing"),
    ("train", "K=0"),
    ("judge", "objects=missing"),
    ("judge", "trials=missing"),
    ("clutter", "objects=missing"),
    ("clutter", "model=missing"),
    ("serve", "model=missing"),
    *[(command, "out=empty") for command in ("generate", "simulate", "clutter")],
    ("export", "format=isaac", "out=empty"),
]


def test_what_is_not_there_is_told_before_anything_heavy_is_loaded(tmp_path: Path) -> None:
    """By none of the commands, so that one process can be asked for all."""
    (tmp_path / "empty").touch()
    (tmp_path / "model.json").write_text("{}")
    lines = [(f"spgf_torch.{command}", *overrides) for command, *overrides in NOT_THERE]
    for line, done in zip(lines, in_turn(*lines, cwd=tmp_path, modules=NOT_YET), strict=True):
        assert (done.returncode, done.stdout, done.loaded) == (2, "", []), (line, done)
        assert len(done.stderr.splitlines()) == 1, (line, done)
        assert line[-1].partition("=")[2].strip("[]").split(",")[0].split(".")[0] in done.stderr, (line, done)
