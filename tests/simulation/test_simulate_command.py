"""The command from the outside: what it refuses, shares of the objects, and how it ends where something failed."""

import errno
import json
import os
import shutil
import signal
import sys
from pathlib import Path
from typing import Any

import pytest
from composing import composed
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from spgf_torch import simulate
from spgf_torch.cli.command import run_command, slug
from spgf_torch.cli.multirun import lines
from spgf_torch.errors import IncompleteError, InputError
from spgf_torch.reporting.config import ReportConfig
from spgf_torch.settings import plain, typed
from spgf_torch.simulation.config import SimulateConfig
from spgf_torch.simulation.executors import InlineExecutor
from spgf_torch.simulation.generation import Generation
from spgf_torch.simulation.table import OUTCOMES, read_table
from spgf_torch.terminal import Ended

ROOT = Path(__file__).parents[2]


def config(*overrides: str) -> SimulateConfig:
    return typed(SimulateConfig, composed("simulate", *overrides))


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with two objects; trials run in this process."""
    (tmp_path / "objects").mkdir()
    for name in ("egg", "soap_bar"):
        shutil.copy(ROOT / f"data/objects/{name}.yaml", tmp_path / "objects")
    (tmp_path / "run").mkdir()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(simulate, "executor_of", lambda config: InlineExecutor())
    return tmp_path


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["shard=0/2"], ["shard", "0/2"]),
        (["shard=3/2"], ["shard", "3/2"]),
        (["shard=1/2"], ["out", "all shards"]),
        (["failed_as=lost"], ["failed_as", "dropped", "lost"]),
        (["runner=dask"], ["address", "none"]),
        (["address=tcp://here:1"], ["address", "runner=dask"]),
        (["out=objects/egg.yaml"], ["out", "egg.yaml"]),
    ],
)
def test_bad_settings(overrides: list[str], words: list[str], place: Path) -> None:
    before = sorted(place.rglob("*"))
    with pytest.raises(InputError) as error:
        simulate.run(config("objects=objects", "candidates=3", *overrides), Path("run"))
    assert all(word in str(error.value) for word in words) and "\n" not in str(error.value)
    assert sorted(place.rglob("*")) == before


def test_shares_of_the_objects(place: Path, capsys: pytest.CaptureFixture) -> None:
    """Two calls with half of the objects each, then one with all: nothing is left to do."""
    whole = ["objects=objects", "candidates=3", "out=table"]
    for number, name in enumerate(("egg", "soap_bar"), 1):
        simulate.run(config(*whole, f"shard={number}/2"), Path("run"))
        assert (place / f"table/{name}.parquet").exists() and (place / f"table/manifest.{number}-of-2.json").exists()
        assert (place / "table/soap_bar.parquet").exists() == (number == 2)
    capsys.readouterr()
    simulate.run(config(*whole), Path("run"))
    assert "candidates/s" not in capsys.readouterr().out
    left = {path.name for path in (place / "table").iterdir()}
    assert left == {"egg.parquet", "soap_bar.parquet", "manifest.json", "config.yaml"}


def test_the_fast_episode(place: Path) -> None:
    """Its tables say so, and a call with the default one neither adds to them nor reads them."""
    whole = ["objects=objects", "candidates=2", "out=table"]
    simulate.run(config(*whole, "episode=fast", "shard=1/2"), Path("run"))
    made = json.loads((place / "table/manifest.1-of-2.json").read_text())["made_with"]["episode"]
    assert made == read_table(place / "table/egg.parquet").provenance.episode == plain(config("episode=fast").episode)
    before = {path: path.read_bytes() for path in place.rglob("*") if path.is_file()}
    with pytest.raises(InputError, match=r"egg.parquet: expected trials made with episode.dt 0.002, got 0.005"):
        simulate.run(config(*whole), Path("run"))
    assert {path: path.read_bytes() for path in place.rglob("*") if path.is_file()} == before


def test_a_budget(place: Path) -> None:
    """Each object its own number of candidates, by the open SDH-2; what learns reads them, and knows the budget."""
    from spgf_torch.experiment.labelled_grasps import tables_of
    from spgf_torch.hands.hand import load_hand
    from spgf_torch.objects.library import load_objects
    from spgf_torch.simulation.worker import Trials

    asked = config("objects=objects", "candidates=40", "budget=3", "out=table")
    simulate.run(asked, Path("run"))
    trials = Trials(load_hand(asked.hand), asked.episode)
    tables = tables_of(load_objects(place / "objects"), str(place / "table"), trials, asked.sampler)
    entries = json.loads((place / "table/manifest.json").read_text())["objects"]
    for table in tables:
        its = entries[table.object_name]["allotted"]
        free = table.outcome != OUTCOMES.index("collision")
        assert its["physics"] == {
            "NPG": int(free[: its["candidates"]].sum()),
            "WPG": int(free[its["candidates"] :].sum()),
        }
        assert 3 <= int(free.sum()) <= 4 and len(table) == 2 * its["candidates"] and table.provenance.budget == 3
    assert len(tables[0]) < len(
        tables[1]
    )  # all wide grasps on an egg are free, of those on a bar of soap three quarters
    settings = (place / "table/config.yaml").read_text()
    (place / "table/config.yaml").write_text(settings.replace("budget: 3", "budget: few"))
    with pytest.raises(InputError, match=r"config.yaml: expected"):
        tables_of(load_objects(place / "objects"), str(place / "table"), trials, asked.sampler)


def test_an_object_without_candidates(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is told and in the manifest; the other one has its table."""
    from spgf_torch.simulation import generation as generation

    def sample(obj: Any, *made: Any) -> Any:
        if obj.name == "egg":
            raise ValueError("no surface")
        return original(obj, *made)

    original = generation.sample
    monkeypatch.setattr(generation, "sample", sample)
    with pytest.raises(IncompleteError, match=r"1 objects without a table: table/manifest.json says why"):
        simulate.run(config("objects=objects", "candidates=3", "out=table"), Path("run"))
    assert [path.name for path in (place / "table").glob("*.parquet")] == ["soap_bar.parquet"]
    egg = json.loads((place / "table/manifest.json").read_text())["objects"]["egg"]
    assert (egg["state"], egg["reason"]) == ("failed", "no candidates: ValueError: no surface")


def test_a_full_disk_is_one_line(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def run(self: Generation, *args: Any) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Generation, "run", run)
    with pytest.raises(IncompleteError, match=r"^table: expected room to write, got No space left on device; 0 cand"):
        simulate.run(config("objects=objects", "candidates=3", "out=table"), Path("run"))


def noted(error: BaseException, note: str) -> BaseException:
    error.add_note(note)
    return error


@pytest.mark.parametrize(
    ("error", "status", "told"),
    [
        (IncompleteError("egg: two\nlines"), 1, "report: egg: two lines\n"),
        (OSError(errno.ENOSPC, "No space left on device", "results.json"), 1, "report: results.json: No space left on"),
        (KeyboardInterrupt(), 130, "report: interrupted\n"),
        (noted(Ended(signal.SIGTERM), "kept in x"), 143, "report: ended by SIGTERM; kept in x\n"),
    ],
)
def test_how_a_command_ends(
    error: BaseException, status: int, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: Any
) -> None:
    def run(config: ReportConfig, folder: Path) -> None:
        (folder / "results.json").write_text("{}")
        raise error

    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HYDRA_FULL_ERROR", "1")
    monkeypatch.setattr(sys, "argv", ["report"])
    with pytest.raises(SystemExit) as ended:
        run_command("report", ReportConfig, run)
    assert ended.value.code == status and capfd.readouterr().err.startswith(told)
    assert (tmp_path / "outputs/report/latest").exists() == isinstance(error, IncompleteError)


def test_an_unfinished_job_in_the_summary() -> None:
    notes = [{"job": 0, "overrides": ["shard=1/2"], "folder": ".", "incomplete": "1 objects without a table"}]
    assert lines(notes) == ["shard=1/2  not done: 1 objects without a table"]


def test_simulate_as_slurm_array_jobs() -> None:
    """One task a share; the launcher's keys are those that it has for train."""
    OmegaConf.register_new_resolver("slug", slug, replace=True)
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        composed = compose("simulate", ["hydra/launcher=slurm", "out=table", "shard=1/4"], return_hydra_config=True)
    assert composed.hydra.launcher["_target_"].endswith("SlurmLauncher") and composed.shard == "1/4"
    assert OmegaConf.to_container(composed.hydra, resolve=False)["launcher"]["name"] == "spgf-${hydra.job.name}"


def test_what_submitit_pickles() -> None:
    """A command runs as __main__, whose functions travel with all globals that they use."""
    cloudpickle = pytest.importorskip("cloudpickle")
    cloudpickle.register_pickle_by_value(simulate)
    try:
        assert cloudpickle.dumps(simulate.run)
    finally:
        cloudpickle.unregister_pickle_by_value(simulate)
