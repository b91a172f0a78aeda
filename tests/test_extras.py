"""What an extra brings is asked for first, and where it is missing one line names the extra."""

import ast
import json
import sys
import tomllib
from pathlib import Path

import pytest
from commands import ROOT, python

from spgf_torch.errors import InputError
from spgf_torch.extras import PACKAGES, installed, needed
from spgf_torch.formats.acronym import read_acronym
from spgf_torch.simulation.executors import DaskExecutor

# Command, its settings, the package that is not there, the line.
CALLS = [
    ("report", [], "plotly", "index.html expected plotly (pip install 'spgf-torch[report]')"),
    ("export", ["format=[isaac,acronym]"], "h5py", "format: acronym expected h5py (pip install 'spgf-torch[export]')"),
    ("judge", [], "sklearn", "learning expected scikit-learn (pip install 'spgf-torch[judge]')"),
    (
        "evaluate",
        ["objects=.", "engine=both"],
        "mujoco",
        "engine: both expected MuJoCo (pip install 'spgf-torch[mujoco]')",
    ),
    ("train", ["judge=learn"], "sklearn", "judge: learn expected scikit-learn (pip install 'spgf-torch[judge]')"),
    ("train", ["ranking=judge"], "sklearn", "ranking: judge expected scikit-learn (pip install 'spgf-torch[judge]')"),
    (
        "train",
        ["features.descriptor=fpfh"],
        "open3d",
        "features.descriptor: fpfh expected Open3D (pip install 'spgf-torch[baselines]')",
    ),
    *(
        (name, [*more, "runner=dask", "address=tcp://10.0.0.1:8786"], "distributed", "runner: dask expected Dask (pip")
        for name, more in (("simulate", []), ("judge", []), ("train", ["judge=learn"]))
    ),
]
# All of them in one process: status and what was said of each, and what was loaded on the way.
RUN = """
import contextlib, io, json, runpy, sys
told = []
for command, overrides, package, _ in json.loads(sys.argv[1]):
    sys.modules[package], sys.argv, said = None, [command, *overrides], io.StringIO()
    try:
        with contextlib.redirect_stderr(said):
            runpy.run_module(f"spgf_torch.{command}", run_name="__main__")
    except SystemExit as left:
        told.append([left.code, said.getvalue()])
    del sys.modules[package]
print(json.dumps([told, [name for name in ("torch", "scipy", "pyarrow", "sapien") if name in sys.modules]]))
"""


def test_commands_name_the_extra_before_anything_is_loaded_or_written(tmp_path: Path) -> None:
    done = python("-c", RUN, json.dumps(CALLS), cwd=tmp_path)
    assert not done.returncode, done.stderr
    told, loaded = json.loads(done.stdout)
    assert not loaded
    for (status, said), (command, _, _, line) in zip(told, CALLS, strict=True):
        assert status == 2 and said.startswith(f"{command}: {line}") and len(said.splitlines()) == 1, said
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_the_library_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.h5").touch()
    for package in ("h5py", "distributed"):
        monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(InputError, match=r"a.h5: expected h5py \(pip install 'spgf-torch\[export\]'\), got no such"):
        read_acronym(tmp_path / "a.h5")
    with pytest.raises(InputError, match=r"runner: dask expected Dask \(pip install 'spgf-torch\[cluster\]'\)"):
        DaskExecutor("tcp://127.0.0.1:9")


def test_what_is_installed_is_not_asked_for() -> None:
    assert installed("h5py")
    needed("format: acronym", "h5py")


def test_modules_import_what_an_extra_brings_only_when_it_is_used() -> None:
    """But for those that learn judges, run MuJoCo and serve, which commands import once they have asked."""
    found = set()
    for path in (ROOT / "spgf_torch").rglob("*.py"):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            found |= {path.name for name in names if name.split(".")[0] in PACKAGES}
    served = {"app.py", "bodies.py", "metrics.py", "middleware.py", "predictions.py", "server.py"}
    assert found == {"learning.py", "model.py", "trial.py"} | served


def test_extras_bring_what_is_said_of_them() -> None:
    """No package that an extra brings is required, and `all`, which make installs, has every extra that users need."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = {name: " ".join(wanted) for name, wanted in project["optional-dependencies"].items()}
    for module, (known, extra) in PACKAGES.items():
        package = {"sklearn": "scikit-learn", "collada": "pycollada"}.get(module, module.replace("_", "-"))
        assert f"{package}>=" in extras[extra] or f"{package}-cpu>=" in extras[extra], known
        assert not any(required.startswith(package) for required in project["dependencies"]), known
    assert (
        extras["all"] == "spgf-torch[export,report,judge,sweep,cluster,hands,mujoco,serve,view]"
        and "spgf-torch[all,docs]" in extras["dev"]
    )
