"""Rooms that need only torch load nothing heavy, so that a ROS node starts in a second; tables need no simulator."""

import subprocess
import sys
from pathlib import Path

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


def loaded(modules: tuple[str, ...], heavy: tuple[str, ...]) -> list[str]:
    """Which of the heavy packages the modules bring, imported one after the other in a fresh process."""
    code = (
        "import importlib, sys\n"
        f"for name in {modules!r}:\n"
        "    importlib.import_module('spgf_torch.' + name)\n"
        f"    print(*[name + ' loads ' + m for m in {heavy!r} if m in sys.modules], sep='\\n')"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.split("\n")


def test_torch_only_rooms_load_nothing_heavy() -> None:
    assert not any(loaded(LIGHT, HEAVY))


NOT_FOR_A_MODEL = ("sapien", "lightning", "hydra", "matplotlib", "h5py", "pyarrow", "plotly", "sklearn")
LOAD = """
import sys
import spgf_torch

for folder in {folders!r}:
    spgf_torch.load(folder)
print(*[m for m in {heavy!r} if m in sys.modules])
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


def test_models_are_loaded_without_what_only_learning_and_reports_need(tmp_path: Path) -> None:
    judge = ROOT / "data/models/panda"
    folders = [str(folder) for folder in (votes(tmp_path), judge) if folder != judge or judge.is_dir()]
    done = python("-c", LOAD.format(folders=folders, heavy=NOT_FOR_A_MODEL), cwd=tmp_path)
    assert done.stdout == "\n", (done.stdout, done.stderr)


def test_trial_tables_are_read_without_sapien() -> None:
    assert not any(loaded(("simulation.table", "simulation.execute", "experiment.labelled_grasps"), ("sapien",)))


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


def test_importing_the_package_loads_nothing() -> None:
    code = f"import sys, spgf_torch; print(*[m for m in {(*NOT_YET, 'numpy')!r} if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "\n"
