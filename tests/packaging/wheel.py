"""The wheel and the sdist: what they hold, and that the wheel alone trains, simulates and predicts outside a checkout.

    python tests/packaging/wheel.py

Outside the suite: it fetches the package's dependencies into a new environment, some 500 MB where pip keeps none.
`.ci/run` calls it when CI_WHEEL=1. It prints a line a step and leaves with status 1 at the first that fails.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tarfile
import time
import zipfile
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory

ROOT = Path(__file__).parents[2]
LARGEST = 40_000_000  # bytes of the wheel: with models of its hands; objects, trials and judges are 6 MB
DATA = ("hands", "models", "objects", "trials")  # what commands read by default; pictures are for README
NOBODY = "65534"
NAMES = ("bowl_sugar", "mug_coffee", "jar_jam", "tumbler", "soap_bar", "box_tea", "sponge", "apple", "egg", "can_soda")
TINY = [
    "+K=5",
    "folds=2",
    "bootstrap=100",
    "sensing.width=160",
    "sensing.height=120",
    "sensing.focal=144",
    "inner_grasps=200",
]
TINY += ["affordance.features_per_object=60", "prototypes.restarts=2", "prototypes.subsample=1000"]
CLOUD = """
import numpy as np
from spgf_torch.predictor import block
texlets = block(0.003)
np.savez("Wolke (1), größe.npz", points=texlets.positions.numpy(), normals=texlets.normals.numpy())
"""


def main() -> None:
    """Build, look, install, run."""
    with TemporaryDirectory(prefix="spgf wheel größe ") as name:
        home = Path(name)
        home.chmod(0o755)
        wheel = build(home)
        check_wheel(wheel)
        python = installed(home, wheel)
        run(home, python)


def build(home: Path) -> Path:
    """The sdist from this checkout and the wheel from the sdist."""
    python = environment(home / "build")
    step("hatchling", python, "-m", "pip", "install", "--quiet", "hatchling", cwd=home)
    step("sdist", python, "-m", "hatchling", "build", "-t", "sdist", "-d", home / "dist", cwd=ROOT)
    (sdist,) = (home / "dist").glob("*.tar.gz")
    check_sdist(sdist)
    step("wheel of it", python, "-m", "pip", "wheel", "--quiet", "--no-deps", "-w", home / "dist", sdist, cwd=home)
    (wheel,) = (home / "dist").glob("*.whl")
    return wheel


def tracked() -> set[str]:
    """Every file of the repository, and new ones that git does not ignore."""
    listed = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    names = subprocess.run(listed, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\0")
    return {name for name in names if name and (ROOT / name).is_file()}


def check_sdist(sdist: Path) -> None:
    """All that is tracked but the settings of CI, and nothing else; the tests are in it."""
    with tarfile.open(sdist) as archive:
        found = {str(PurePosixPath(*PurePosixPath(m.name).parts[1:])) for m in archive.getmembers() if m.isfile()}
    expected = {name for name in tracked() if not name.startswith(".ci/")}
    same("sdist", found - {"PKG-INFO"}, expected)


def check_wheel(wheel: Path) -> None:
    """The package, the settings, and the data that commands read; no tests, no pictures, nothing left over."""
    with zipfile.ZipFile(wheel) as archive:
        found = {name for name in archive.namelist() if ".dist-info/" not in name and not name.endswith("/")}
    names = tracked()
    expected = {name for name in names if name.startswith("spgf_torch/")}
    shipped = {name for name in names if name.startswith(("conf/", *(f"data/{kind}/" for kind in DATA)))}
    expected |= {f"spgf_torch/_shipped/{name}" for name in shipped if not name.endswith((".png", ".md"))}
    same("wheel", found, expected)
    kinds = {PurePosixPath(name).suffix for name in found}
    allowed = {
        ".py",
        ".typed",
        ".css",
        ".js",
        ".html",
        ".LICENSE",
        ".yaml",
        ".urdf",
        ".parquet",
        ".json",
        ".safetensors",
    }
    if not kinds <= {*allowed, ""} or wheel.stat().st_size > LARGEST:
        fail(f"wheel: expected {sorted(allowed)} in {LARGEST} bytes, got {sorted(kinds)}, {wheel.stat().st_size}")


def same(what: str, found: set[str], expected: set[str]) -> None:
    if found != expected:
        fail(f"{what}: too much: {sorted(found - expected)[:5]}, missing: {sorted(expected - found)[:5]}")
    print(f"{what}: {len(found)} files, as expected", flush=True)


def installed(home: Path, wheel: Path) -> Path:
    """Python of a bare environment with the wheel and what it depends on; nothing of the extras but two commands'."""
    python = environment(home / "bare environment")
    step("install the wheel", python, "-m", "pip", "install", "--quiet", f"{wheel}[export,report]", cwd=home)
    step("pip check", python, "-m", "pip", "check", cwd=home)
    code = "import importlib.util as i, spgf_torch; print(spgf_torch.__file__, *[m for m in %r if i.find_spec(m)])"
    said = step("where it is", python, "-c", code % (["roma", "sklearn", "pytest"],), cwd=home)
    if not said.endswith("__init__.py"):
        fail(f"environment: expected neither roma, scikit-learn nor pytest, got {said}")
    return python


def environment(folder: Path) -> Path:
    """Python of a new virtual environment."""
    subprocess.run([sys.executable, "-m", "venv", folder], check=True)
    return folder / "bin/python"


def run(home: Path, python: Path) -> None:
    """Every kind of command in a working folder of its own, with small data."""
    work = home / "my work, 測"
    work.mkdir()
    shipped = next(home.glob("bare environment/lib/python*/site-packages/spgf_torch/_shipped"))
    for kind, ending in (("objects", "yaml"), ("trials", "parquet")):
        (work / kind).mkdir()
        for name in NAMES:
            shutil.copy(shipped / f"data/{kind}/{name}.{ending}", work / kind)
    shutil.copy(shipped / "data/trials/config.yaml", work / "trials")

    def command(name: str, *arguments: str) -> str:
        return step(name, python, "-m", f"spgf_torch.{name}", *arguments, cwd=work)

    step("commands", python, "-m", "spgf_torch", cwd=work)
    command("simulate", "objects=objects", "candidates=5", "out=new trials", "workers=1")
    command("train", "objects=objects", "trials=trials", *TINY)
    step("a cloud", python, "-c", CLOUD, cwd=work)
    command("predict", "input=Wolke (1), größe.npz", "model=latest")
    command("predict", "input=Wolke (1), größe.npz", "hand=panda")
    left = {path.name for path in (work / "outputs/predict/latest").iterdir()}
    if missing := {"grasps.json", "moveit_grasps.json", "index.html", "grasps.png"} - left:
        fail(f"predict with a shipped judge: missing {sorted(missing)}")
    command("export", "format=acronym", "objects=objects", "trials=trials", "out=data set", "folds=2")
    command("report")
    if os.geteuid() == 0 and shutil.which("setpriv"):  # root may write everywhere
        free = home / "somebody else's"
        free.mkdir(mode=0o777)
        free.chmod(0o777)
        given = [f"input={work}/Wolke (1), größe.npz", f"model={work}/outputs/train/latest"]
        who = ["setpriv", f"--reuid={NOBODY}", f"--regid={NOBODY}", "--clear-groups"]
        step("predict, site-packages read-only", *who, python, "-m", "spgf_torch.predict", *given, cwd=free)


def step(what: str, *command: object, cwd: Path) -> str:
    """Run a command without this checkout on the path; a line with its time. Its last line of output."""
    start, kept = time.perf_counter(), {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME")}
    done = subprocess.run(list(map(str, command)), cwd=cwd, env=kept, capture_output=True, text=True)
    if done.returncode or "Traceback" in done.stderr:
        fail(f"{what}: status {done.returncode}\n{done.stdout[-2000:]}\n{done.stderr[-4000:]}")
    last = (done.stdout.strip().splitlines() or [""])[-1]
    print(f"{what}: {time.perf_counter() - start:.0f} s  {last[:100]}", flush=True)
    return last


def fail(words: str) -> None:
    print(words, file=sys.stderr)
    sys.exit(1)


if __name__ == "__main__":
    main()
