"""Rooms that need only torch load nothing heavy, so that a ROS node starts in a second; tables need no simulator."""

import subprocess
import sys
from pathlib import Path

import pytest
from doors import python

HEAVY = ("sapien", "lightning", "hydra", "matplotlib", "pytorch_kinematics", "trimesh")
LIGHT = (
    "geometry.se3",
    "ops.neighbours",
    "features.spgf",
    "prototypes.kmeans",
    "prototypes.search",
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


def test_trial_tables_are_read_without_sapien() -> None:
    assert not any(loaded(("trials.table", "trials.runner", "experiment.tried"), ("sapien",)))


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
COUNT = """
import runpy, sys
sys.argv = ["door", *sys.argv[2:]]
try:
    runpy.run_module("spgf_torch.{command}", run_name="__main__")
except SystemExit as left:
    print(left.code, *[m for m in {modules!r} if m in sys.modules])
"""


@pytest.mark.parametrize(
    ("command", "overrides"),
    [
        ("predict", ["input=missing.ply"]),
        ("predict", ["input=[empty,empty]"]),
        ("predict", ["input=model.json", "mask=missing.png"]),
        ("predict", ["input=model.json", "model=missing"]),
        ("evaluate", ["objects=.", "model=missing"]),
        ("train", ["objects=missing"]),
        ("train", ["trials=missing"]),
        ("simulate", ["objects=missing"]),
        ("export", ["format=isaac", "trials=missing"]),
        ("report", ["runs=missing"]),
        ("compare", ["runs=missing"]),
        ("baseline", ["export=missing"]),
        ("train", ["K=0"]),
        ("judge", ["objects=missing"]),
        ("judge", ["trials=missing"]),
    ],
    ids=str,
)
def test_what_is_not_there_is_told_before_anything_heavy_is_loaded(
    command: str, overrides: list[str], tmp_path: Path
) -> None:
    (tmp_path / "empty").touch()
    (tmp_path / "model.json").write_text("{}")
    done = python("-c", COUNT.format(command=command, modules=NOT_YET), "door", *overrides, cwd=tmp_path)
    assert done.stdout == "2\n" and len(done.stderr.splitlines()) == 1, (done.stdout, done.stderr)
    assert overrides[-1].partition("=")[2].strip("[]").split(",")[0].split(".")[0] in done.stderr


def test_importing_the_package_loads_nothing() -> None:
    code = f"import sys, spgf_torch; print(*[m for m in {(*NOT_YET, 'numpy')!r} if m in sys.modules])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "\n"
