"""`spgf_torch.train`: what it takes, what it refuses, and that nothing is left of what was refused."""

import multiprocessing
from pathlib import Path
from typing import Any

import pytest
import trimesh
from commands import ROOT
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf
from small_trainings import trained

import spgf_torch
import spgf_torch.train as module
from spgf_torch.command_settings import command_settings
from spgf_torch.errors import InputError
from spgf_torch.experiment.config import TrainConfig
from spgf_torch.judging.config import JudgeConfig
from spgf_torch.settings import typed
from spgf_torch.training import api
from spgf_torch.training.given_objects import kept_objects


@pytest.mark.parametrize(
    ("command", "kind", "changes"),
    [
        ("train", TrainConfig, {"K": 7}),
        ("train", TrainConfig, {"K": 20, "hand": "panda", "episode": "robot_fast", "sensing.cameras": 1}),
        ("judge", JudgeConfig, {"folds": 3, "proposing": "clutter"}),
    ],
)
def test_settings_are_those_that_hydra_composes(command: str, kind: type, changes: dict[str, Any]) -> None:
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        composed = compose(command, overrides=[f"{key}={value}" for key, value in changes.items()])
    assert typed(kind, command_settings(command, changes)) == typed(
        kind, OmegaConf.to_container(composed, resolve=True)
    )


def test_changes_of_a_group_leave_the_rest_of_it() -> None:
    values = command_settings("train", {"sensing": {"cameras": 1}, "hand": {"name": "mine"}})
    assert values["sensing"]["cameras"] == 1 and values["sensing"]["width"] == 320
    with pytest.raises(InputError, match=r"^episode: expected one of .*pinch.*; got pinhc; did you mean pinch\?"):
        command_settings("train", {"episode": "pinhc"})


def test_the_module_of_the_command_is_the_function_too(monkeypatch: pytest.MonkeyPatch) -> None:
    assert spgf_torch.train is module
    monkeypatch.setattr(api, "train", lambda *given, **settings: (given, settings))
    assert spgf_torch.train("folder", K=3) == (("folder",), {"K": 3})


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"judge": "learn"}, "judge: expected True or False, got 'learn'"),
        ({"fold": 3}, "fold: expected a key of TrainConfig, got fold; did you mean folds?"),
        ({"hand": "pandas"}, "hand: expected one of panda, "),
        (
            {"hand": "none.yaml"},
            "hand: expected a hand's description in YAML or a URDF, got nothing there at none.yaml",
        ),
        ({"trials": "nowhere"}, "trials: expected the trial tables that simulate leaves, or a table of recorded ones"),
        ({"trials": "nowhere.csv"}, "nowhere.csv: expected a file"),
        ({"recorded": {"unit": "mm"}}, "recorded: expected with a file of recorded trials, got trials="),
        ({"objects": []}, "objects: expected a mesh at least, got none"),
        ({"objects": [3]}, "objects: expected a mesh or a file of one for object_1, got int"),
        ({"objects": ["mug.step"]}, "objects: expected a file that ends with .ply, .obj, .stl, .off, .glb, got .step"),
        ({"objects": 3}, "objects: expected a folder, or a list of meshes, got int"),
    ],
)
def test_what_is_refused_leaves_nothing(changes: dict[str, Any], words: str, tmp_path: Path) -> None:
    given = {"objects": ROOT / "data/objects", **changes}
    with pytest.raises(InputError) as error:
        trained(given.pop("objects"), tmp_path / "new/run", **given)
    assert str(error.value).startswith(words) and "\n" not in str(error.value)
    assert not list(tmp_path.iterdir())


def test_a_folder_with_something_in_it_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(InputError, match=r"^out: expected a new or an empty folder for the run, got one that is not"):
        trained(ROOT / "data/objects", tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_a_process_that_imports_the_script_does_not_train(monkeypatch: pytest.MonkeyPatch) -> None:
    """As `multiprocessing` starts processes by spawn: they import the script of the one that started them."""
    monkeypatch.setattr(multiprocessing.current_process(), "_inheriting", True, raising=False)
    with pytest.raises(InputError, match=r'^train: expected a call below if __name__ == "__main__": '):
        trained(ROOT / "data/objects", Path("none"))


def test_meshes_are_kept_as_they_were_given(tmp_path: Path) -> None:
    block = trimesh.creation.box((0.0412345678, 0.06, 0.08))
    block.export(tmp_path / "my block.stl")
    (tmp_path / "run").mkdir()
    folder = Path(kept_objects([block, tmp_path / "my block.stl"], tmp_path / "run"))
    assert sorted(path.name for path in folder.iterdir()) == ["my_block.stl", "object_1.obj"]
    assert trimesh.load_mesh(folder / "object_1.obj").extents[0] == pytest.approx(0.0412345678, abs=1e-10)
    assert (folder / "my_block.stl").read_bytes() == (tmp_path / "my block.stl").read_bytes()
    (tmp_path / "twice").mkdir()
    with pytest.raises(InputError, match=r"^objects: expected each name once, got my_block twice"):
        kept_objects([tmp_path / "my block.stl", tmp_path / "my block.stl"], tmp_path / "twice")


def test_a_mesh_that_cannot_be_used_is_told_by_the_file_that_was_given(tmp_path: Path) -> None:
    """An open one: the copy in the run's folder, which goes, is not what its owner knows."""
    block = trimesh.creation.box((0.04, 0.06, 0.08))
    halves = trimesh.Trimesh(block.vertices, block.faces[:5])
    halves.export(tmp_path / "my half.stl")
    for objects, name in (
        ([tmp_path / "my half.stl"], f"{tmp_path}/my half.stl: "),
        ({"half": halves}, "objects: half: "),
    ):
        with pytest.raises(InputError) as error:
            trained(objects, None, trials=None, random_trials=6, workers=1, category="boxes")
        assert str(error.value).startswith(name) and "spgf_torch_" not in str(error.value), error.value


def test_without_trials_random_ones_are_made(tmp_path: Path) -> None:
    """On a mesh of one's own; they are kept beside the model, and the settings name them."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.03)
    changes = {"trials": None, "random_trials": 6, "workers": 1, "category": "curved", "episode": "fast"}
    model = trained({"ball": ball}, tmp_path / "run", **changes)
    assert model.model is not None and model.model.settings["taught"].keys() == {"ball"}
    assert (tmp_path / "run/trials/ball.parquet").is_file()
    assert f"trials: {tmp_path}/run/trials" in (tmp_path / "run/config.yaml").read_text()
    again = trained(tmp_path / "run/objects", tmp_path / "again", **{**changes, "trials": tmp_path / "run/trials"})
    assert again.model is not None and again.model.settings["taught"] == model.model.settings["taught"]
    assert (tmp_path / "run/model.safetensors").read_bytes() == (tmp_path / "again/model.safetensors").read_bytes()
