"""Imports run one way, heavy packages are imported in few places: the contracts of import-linter in pyproject.toml."""

import ast
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

from commands import ROOT
from statements import statements

CONTRACTS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
# For each contract an import that breaks it, and where.
FORBIDDEN = {
    "layers": ("features/spgf.py", "import spgf_torch.scene.planes"),
    "sapien": ("proposing/propose.py", "import sapien.physx"),
    "lightning": ("prototypes/kmeans.py", "from lightning.pytorch import Trainer"),
    "sklearn": ("judging/judge_training.py", "import sklearn"),
    "mujoco": ("simulation/worker.py", "import mujoco"),
    "open3d": ("scene/files.py", "import open3d"),
    "hydra": ("predictor.py", "from hydra import main"),
}


def lint(folder: Path) -> subprocess.CompletedProcess:
    """What `make check` calls, for the package and the contracts in a folder."""
    command = [Path(sys.executable).with_name("lint-imports"), "--no-cache", "--no-logo", folder / "pyproject.toml"]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True)


def test_the_contracts_hold() -> None:
    done = lint(ROOT)
    assert not done.returncode, done.stdout + done.stderr


def test_each_contract_can_be_broken(tmp_path: Path) -> None:
    assert set(FORBIDDEN) == {contract["id"] for contract in CONTRACTS}
    shutil.copytree(ROOT / "spgf_torch", tmp_path / "spgf_torch", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    for place, line in FORBIDDEN.values():
        with (tmp_path / "spgf_torch" / place).open("a") as file:
            file.write(f"\n{line}\n")
    done = lint(tmp_path)
    words = " ".join(done.stdout.split())
    assert done.returncode == 1, done.stdout + done.stderr
    for contract in CONTRACTS:
        assert f"{contract['name']} BROKEN" in words, contract["name"]


def test_what_is_imported_is_there() -> None:
    """Also within functions, which no other test may call."""
    missing = []
    for path in sorted(path for folder in ("spgf_torch", "tests") for path in (ROOT / folder).rglob("*.py")):
        for node in statements(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "spgf_torch":
                place = ROOT.joinpath(*str(node.module).split("."))
                if not place.is_dir() and not place.with_suffix(".py").is_file():
                    missing.append(f"{path.relative_to(ROOT)}:{node.lineno}: {node.module}")
                elif place.is_dir():
                    known = {part.stem for part in place.iterdir()}
                    own = (place / "__init__.py").read_text(encoding="utf-8")
                    lost = [alias.name for alias in node.names if alias.name not in known and alias.name not in own]
                    missing += [f"{path.relative_to(ROOT)}:{node.lineno}: {node.module}.{name}" for name in lost]
    assert not missing, "\n".join(missing)
