"""`hand=FILE` for any command, and a description that is read in Python."""

from pathlib import Path
from typing import Any

import pytest
import yaml
from commands import ROOT
from composing import config_of
from omegaconf import OmegaConf

from spgf_torch.cli.command import _config, slug
from spgf_torch.cli.command_line import translated
from spgf_torch.errors import InputError
from spgf_torch.hands.description_file import read_description
from spgf_torch.simulation.config import SimulateConfig


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder; below it `mine/` with the Panda as somebody's own hand."""
    OmegaConf.register_new_resolver("slug", slug, replace=True)
    description = (ROOT / "conf/hand/panda.yaml").read_text()
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/my jaw.yaml").write_text(description.replace("data/hands/panda.urdf", "jaw.urdf"))
    (tmp_path / "mine/jaw.urdf").write_bytes((ROOT / "data/hands/panda.urdf").read_bytes())
    monkeypatch.chdir(tmp_path)
    return tmp_path


def config(*arguments: str) -> Any:
    return _config(SimulateConfig, config_of("simulate", *translated("simulate", SimulateConfig, arguments)))


def test_a_file_is_a_hand_as_those_of_conf_are(folder: Path) -> None:
    """Its URDF is found from its own folder, and its values can be changed beside it."""
    given = config("hand=mine/my jaw.yaml", "hand.closing.effort=12", "hand.closing.time=2").hand
    shipped = config("hand=panda").hand
    assert given.urdf == str(folder / "mine/jaw.urdf")
    assert (given.closing.effort, given.closing.time, given.closing.speed) == (12, 2, shipped.closing.speed)
    assert given.preshapes == shipped.preshapes and given.fingers == shipped.fingers


def test_a_file_of_a_shipped_hands_name_is_the_file(folder: Path) -> None:
    values = yaml.safe_load((ROOT / "conf/hand/sdh2.yaml").read_text()) | {"name": "other"}
    Path("sdh2.yaml").write_text(yaml.safe_dump(values))
    assert config("hand=sdh2.yaml").hand.name == "other"
    assert config("hand=sdh2").hand.name == "sdh2"


def test_a_sweep_over_files_and_names() -> None:
    Path("mine/my jaw.yaml").rename("mine/a swept jaw.yaml")
    _, word = translated("simulate", SimulateConfig, ["-m", "hand=./mine/a swept jaw.yaml,sdh2"])
    assert word == "hand=a-swept-jaw,sdh2"


def test_what_a_file_does_not_name_beside_it_stays(folder: Path) -> None:
    """A URDF that comes with the package, or in a ROS package; packages from the file's folder; the file's own name."""
    values = {"urdf": "data/hands/panda.urdf", "packages": {"a": ".", "b": "~/nowhere", "c": "../mine"}}
    Path("mine/own.yaml").write_text(yaml.safe_dump(values))
    read = read_description("mine/own.yaml")
    assert read.urdf == "data/hands/panda.urdf" and read.name == "own"
    assert read.packages == {"a": str(folder / "mine"), "b": "~/nowhere", "c": str(folder / "mine")}
    Path("mine/own.yaml").write_text("urdf: package://mine/jaw.urdf")
    assert read_description("mine/own.yaml").urdf == "package://mine/jaw.urdf"


@pytest.mark.parametrize(
    ("value", "told"),
    [
        ("mine/my jam.yaml", "hand: expected a hand's description in YAML or a URDF, got nothing there at mine/my jam"),
        ("mine/my jam.yaml", "did you mean mine/my jaw.yaml?"),
        ("yours/jaw.yaml", "got no folder yours"),
        ("mine/jaw.urdf", "got the URDF mine/jaw.urdf; python -m spgf_torch.hand hand=mine/jaw.urdf proposes one"),
    ],
)
def test_what_is_not_there_is_told(value: str, told: str) -> None:
    with pytest.raises(InputError) as error:
        config(f"hand={value}")
    assert told in str(error.value)


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ("urdf: a.urdf\nfinger: {}", "finger: expected a key of HandConfig, got finger; did you mean fingers?"),
        ("- 3", "expected a hand's description in YAML, got list"),
        ("urdf: {a: b}", "urdf: "),
        ("name: x", "urdf: expected a value, got none"),
        ("urdf: ${oc.env:HOME}", "expected a plain value"),
        ("urdf: a.urdf\njoints: {a: {effort: -3}}", "joints.a.effort: expected a number from 1e-06"),
        (": [", "expected a hand's description in YAML, got"),
    ],
)
def test_a_damaged_description_is_told_with_its_file(content: str, told: str) -> None:
    Path("bad.yaml").write_text(content)
    with pytest.raises(InputError) as error:
        read_description("bad.yaml")
    assert str(error.value).startswith("bad.yaml: ") and told in str(error.value), error.value
