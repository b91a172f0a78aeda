"""Several runs in one call, here, on processes and as a cluster would: folders, what is said, exit status."""

import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from commands import here, python
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from spgf_torch.cli.command import slug
from spgf_torch.cli.multirun import lines

ROOT = Path(__file__).parents[1]
NAMES = ("bowl_sugar", "jar_jam", "soap_bar", "box_tea")
TINY = [
    "folds=2",
    "final_model=false",
    "inner_grasps=50",
    "trials_per_object=100",
    "bootstrap=100",
    "sensing.width=160",
    "sensing.height=120",
    "sensing.focal=144",
    "affordance.features_per_object=60",
    "prototypes.restarts=2",
    "prototypes.subsample=1000",
]
# A command like ours that does nothing: the launchers are what is tested.
TOY = """
import json, sys
from pathlib import Path
from spgf_torch.cli.command import run_command
from spgf_torch.experiment.config import TrainConfig

def run(config: TrainConfig, folder: Path) -> None:
    torch = sys.modules.get("torch")
    threads = torch and torch.get_num_threads()
    results = {"success_rate": {"all": {"CG": config.K / 100}}, "ranking": "paper", "threads": threads}
    (folder / "results.json").write_text(json.dumps(results))

if __name__ == "__main__":
    run_command("train", TrainConfig, run)
"""


def call(*arguments: str, cwd: Path) -> subprocess.CompletedProcess:
    return python(*arguments, cwd=cwd, OMP_NUM_THREADS=None)  # launchers see to threads


def runs(cwd: Path) -> list[Path]:
    """The run folders, by number of the job; nothing else but what Hydra and submitit leave lies beside them."""
    entries = set((cwd / "outputs/train").iterdir())
    found = [path for path in entries if path.is_dir() and not path.is_symlink() and path.name != ".submitit"]
    assert {path.name for path in entries - set(found)} <= {"latest", "multirun.yaml", ".submitit"}
    return sorted(found, key=lambda path: int(path.name.split("_")[2]))


@pytest.fixture
def toy(tmp_path: Path) -> Path:
    (tmp_path / "toy.py").write_text(TOY)
    return tmp_path


def test_jobs_in_this_process(toy: Path) -> None:
    """An override after -m, two refused jobs among four: both are told, the others run, the summary has a line each."""
    done = here("toy.py", "seed=1", "-m", "K=5,0,10,-1", cwd=toy)
    assert done.returncode == 2
    assert [path.name.split("_", 2)[2] for path in runs(toy)] == ["0_K=5,seed=1", "2_K=10,seed=1"]
    assert done.stderr.splitlines() == [
        "job 0: seed=1 K=5",
        "job 1: seed=1 K=0",
        "train: job 1: K: expected a number from 1 to 1000, got 0",
        "job 2: seed=1 K=10",
        "job 3: seed=1 K=-1",
        "train: job 3: K: expected a number from 1 to 1000, got -1",
    ]
    summary = done.stdout.splitlines()
    assert [line.split()[0] for line in summary] == ["K=5", "K=0", "K=10", "K=-1"]
    assert "all CG  10.0 % (paper)" in summary[2] and summary[2].endswith("2_K=10,seed=1")
    assert "not run: K: expected" in summary[1]


def test_jobs_as_a_cluster_runs_them(toy: Path) -> None:
    done = call("toy.py", "-m", "K=5,0", "hydra/launcher=submitit_local", "hydra.launcher.cpus_per_task=1", cwd=toy)
    assert done.returncode == 2, done.stderr
    (run,) = runs(toy)
    assert json.loads((run / "results.json").read_text())["threads"] == 1
    assert done.stderr.splitlines() == [
        "jobs run elsewhere; what they say is in outputs/train/.submitit/%j (%j: number of the job)"
    ]
    assert [line.split()[0] for line in done.stdout.splitlines()] == ["K=5", "K=0"]
    logs = [path.read_text() for path in (toy / "outputs/train/.submitit").glob("*/*_log.err")]
    assert sorted(text.splitlines()[0] for text in logs) == ["job 0: K=5", "job 1: K=0"]


def test_train_on_two_processes(tmp_path: Path) -> None:
    for kind, ending in (("objects", "yaml"), ("trials", "parquet")):
        (tmp_path / kind).mkdir()
        for name in NAMES:
            shutil.copy(ROOT / f"data/{kind}/{name}.{ending}", tmp_path / kind)
    shutil.copy(ROOT / "data/trials/config.yaml", tmp_path / "trials")
    sweep = ["-m", "K=3,0", "hydra/launcher=joblib", "hydra.launcher.n_jobs=2"]
    done = call("-m", "spgf_torch.train", *sweep, "objects=objects", "trials=trials", *TINY, cwd=tmp_path)
    assert done.returncode == 2, done.stderr
    (run,) = runs(tmp_path)
    assert (tmp_path / "outputs/train/latest").resolve() == run and (run / "results.json").is_file()
    assert "Traceback" not in done.stderr and "train: job 1: K: expected" in done.stderr
    assert re.search(r"^0: sensing +4 objects +done", done.stderr, re.MULTILINE)  # whose line it is
    assert re.search(r"^K=3 +all CG +\d+\.\d %", done.stdout, re.MULTILINE)
    assert re.search(r"^K=0 +not run: K: expected", done.stdout, re.MULTILINE)
    assert list((tmp_path / "outputs/cache").glob("features-*.safetensors"))


@pytest.mark.parametrize(
    ("launcher", "words"),
    [("nowhere", ["hydra/launcher/nowhere", "spgf-torch[sweep]"]), ("slurm", ["slurm"])],
)
def test_a_launcher_that_is_not_there(launcher: str, words: list[str], toy: Path) -> None:
    done = here("toy.py", "-m", "K=5", f"hydra/launcher={launcher}", cwd=toy)
    assert done.returncode == 2
    told = [line for line in done.stderr.splitlines() if not line.startswith("jobs run elsewhere")]
    assert len(told) == 1 and all(word in told[0] for word in words)


def test_the_settings_of_slurm_are_submitits() -> None:
    """Every key is one that the launcher knows: an unknown one would fail on the cluster."""
    OmegaConf.register_new_resolver("slug", slug, replace=True)
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        composed = compose("train", ["K=5", "hydra/launcher=slurm"], return_hydra_config=True)
        theirs = compose("train", ["K=5", "hydra/launcher=submitit_slurm"], return_hydra_config=True)
    launcher = OmegaConf.to_container(composed.hydra.launcher, resolve=False)
    assert launcher.keys() == theirs.hydra.launcher.keys()
    assert launcher["_target_"].endswith("SlurmLauncher") and launcher["cpus_per_task"] == 2


def test_the_summary_of_jobs_by_hand(tmp_path: Path) -> None:
    """What sets a job apart is named; results of another kind have no rate."""
    (tmp_path / "results.json").write_text("{}")
    notes = [
        {"job": 0, "overrides": ["K=5", "seed=1"], "folder": str(tmp_path)},
        {"job": 1, "overrides": ["K=10", "seed=1"], "refused": "no objects"},
    ]
    assert lines(notes) == [f"K=5   {os.path.relpath(tmp_path)}", "K=10  not run: no objects"]
    assert lines([{**notes[1], "overrides": []}]) == ["job 1  not run: no objects"]
    assert lines([]) == []
