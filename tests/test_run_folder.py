"""The folder of a run and its neighbours: what was there before a call stays as it was, whatever the call is told."""

from pathlib import Path

import pytest
from commands import here, python

TOY = """
import sys
from pathlib import Path
from spgf_torch.cli.command import run_command
from spgf_torch.errors import InputError
from spgf_torch.reporting.config import ReportConfig
from spgf_torch.progress import show

def run(config: ReportConfig, folder: Path) -> None:
    if config.seed == 1:
        raise InputError("seed: expected another one, got 1")
    (folder / "results.txt").write_text("done")
    show(f"in {folder}")

if __name__ == "__main__":
    run_command("report", ReportConfig, run)
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A working folder with a stranger's things in it."""
    (tmp_path / "toy.py").write_text(TOY)
    for name in ("mine", "hydra/.hydra"):
        (tmp_path / name).mkdir(parents=True)
        for file in ("config.yaml", "multirun.yaml", "results.txt", "latest"):
            (tmp_path / name / file).write_text("mine: 1")
    (tmp_path / "empty").mkdir()
    (tmp_path / "latest").write_text("mine")
    (tmp_path / "link").symlink_to("mine")
    (tmp_path / "dangling").symlink_to("nowhere")
    return tmp_path


def tree(folder: Path) -> dict[str, str]:
    """Everything below the folder, with its content."""
    found = {path: path.read_text() if path.is_file() else "" for path in sorted(folder.rglob("*"))}
    return {str(path.relative_to(folder)): text for path, text in found.items()}


NOT_EMPTY = [
    ["hydra.run.dir=mine"],
    ["hydra.run.dir=."],
    ["hydra.run.dir=link"],
    ["hydra.run.dir=dangling"],
    ["hydra.run.dir=toy.py"],
    ["hydra.run.dir=hydra", "hydra.output_subdir=.hydra"],
    ["-m", "hydra.sweep.dir=mine"],
    ["-m", "hydra.sweep.dir=."],
    ["-m", "hydra.sweep.subdir=../../mine"],
]


def test_a_folder_with_something_in_it_is_refused(folder: Path) -> None:
    """Before the settings are looked at, or anything is done."""
    before = tree(folder)
    for where in NOT_EMPTY:
        done = here("toy.py", "worst=5", *where, cwd=folder)
        assert done.returncode == 2 and "Traceback" not in done.stderr, where
        assert "new or an empty folder for the run" in done.stderr, where
    assert {name: text for name, text in tree(folder).items() if not name.startswith("outputs")} == before


@pytest.mark.parametrize("setting", ["worst=0", "seed=1"])
def test_only_what_this_call_made_is_removed(setting: str, folder: Path) -> None:
    """An empty folder stays, a new one goes with those on the way to it, Hydra's own files with it."""
    before = tree(folder)
    places = (["empty"], ["new/a/b"], ["mine/new", "hydra.output_subdir=.hydra"], ["a (b), 'c'"])
    for given in (*([f"hydra.run.dir={where}", *more] for where, *more in places), []):
        done = here("toy.py", setting, *given, cwd=folder)
        assert done.returncode == 2 and len(done.stderr.splitlines()) == 1, done.stderr
    assert tree(folder) == before


def test_a_folder_of_its_own_is_used(folder: Path) -> None:
    """And `latest` beside it, which is somebody else's, is not touched."""
    places = ("empty", "new/a", "mine/sub")
    for where in places:
        done = here("toy.py", "worst=5", f"hydra.run.dir={where}", cwd=folder)
        assert done.returncode == 0 and done.stdout == f"in {folder / where}\n", done.stderr
        assert (folder / where / "results.txt").is_file() and "worst: 5" in (folder / where / "config.yaml").read_text()
    assert (folder / "latest").read_text() == "mine" and not list(folder.rglob(".latest*"))


@pytest.mark.parametrize("kind", ["folder", "file", "link"])
def test_latest_that_is_no_link_stays(kind: str, folder: Path) -> None:
    """As after `cp -rL`: the run is kept and told."""
    place = folder / "outputs/report/latest"
    place.parent.mkdir(parents=True)
    if kind == "folder":
        place.mkdir()
        (place / "precious").write_text("x")
    elif kind == "file":
        place.write_text("x")
    else:
        place.symlink_to("gone")
    done = here("toy.py", "worst=5", cwd=folder)
    runs = [path for path in place.parent.iterdir() if path.name != "latest"]
    assert done.returncode == 0 and len(runs) == 1 and (runs[0] / "results.txt").is_file()
    if kind == "link":
        assert done.stderr == "" and place.resolve() == runs[0]
        return
    assert len(done.stderr.splitlines()) == 1 and str(runs[0]) in done.stderr and kind in done.stderr
    assert ((place / "precious") if kind == "folder" else place).read_text() == "x"


def test_brackets_in_the_working_folder_are_printed(folder: Path) -> None:
    place = folder / "x[" / "y] [bold]:smile:\x1b[31m"
    place.mkdir(parents=True)
    (place / "toy.py").write_text(TOY)
    done = here("toy.py", "worst=5", cwd=place)
    assert done.returncode == 0 and done.stderr == ""
    assert "x[/y] [bold]:smile:\\x1b[31m/outputs" in done.stdout


def test_a_working_folder_that_cannot_be_used(folder: Path) -> None:
    (folder / "gone").mkdir()
    code = "import os, sys, runpy; os.chdir('gone'); os.rmdir('../gone'); sys.argv = ['toy.py', 'worst=5']\n"
    code += f"runpy.run_path({str(folder / 'toy.py')!r}, run_name='__main__')"
    done = python("-c", code, cwd=folder)
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1 and "folder" in done.stderr, done.stderr
    (folder / "outputs").write_text("a file")
    done = here("toy.py", "worst=5", cwd=folder)
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1 and "outputs" in done.stderr
