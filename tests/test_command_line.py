"""Arguments on their way through Hydra: every name a shell can pass arrives as it was; what is wrong is one line."""

import os
from pathlib import Path
from typing import Any

import pytest
from composing import config_of
from hydra.core.override_parser.overrides_parser import OverridesParser
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from omegaconf import OmegaConf

from spgf_torch.baselines.config import BaselineConfig
from spgf_torch.cli.command import _config, slug
from spgf_torch.cli.command_line import translated
from spgf_torch.errors import InputError
from spgf_torch.experiment.config import EvaluateConfig, TrainConfig
from spgf_torch.formats.config import ExportConfig
from spgf_torch.handcheck.config import HandCheckConfig
from spgf_torch.reporting.config import ReportConfig
from spgf_torch.scene.config import PredictConfig
from spgf_torch.simulation.config import SimulateConfig

CONF = Path(__file__).parents[1] / "conf"
KINDS = {
    "predict": PredictConfig,
    "evaluate": EvaluateConfig,
    "train": TrainConfig,
    "simulate": SimulateConfig,
    "export": ExportConfig,
    "report": ReportConfig,
    "baseline": BaselineConfig,
    "hand": HandCheckConfig,
}
NAMES = [
    "cloud (1).pcd",
    "it's.pcd",
    'a "b".pcd',
    "'quoted'",
    '"twice"',
    "scan[1].pcd",
    "[x].pcd",
    "{a: b}.pcd",
    "a,b.pcd",
    ",",
    "a=b.pcd",
    "K=20,seed=1",
    "$x.pcd",
    "${x}.pcd",
    "${oc.env:HOME}",
    "\\${x}",
    "\\\\${x}",
    "back\\slash.pcd",
    "end\\",
    "it\\'s",
    "a:b.pcd",
    "-x.pcd",
    "--input",
    "~",
    "~x.pcd",
    "#.pcd",
    "50%.pcd",
    "größe 測.pcd",
    "e\u0301",
    "😀.ply",
    " leading",
    "trailing ",
    "tab\there",
    "line\nbreak",
    "\x1b[31m",
    "[bold]x",
    "1",
    "1e3",
    "null",
    "true",
    "nan",
    "glob(*)",
    "choice(a,b)",
    "!!x",
    "*",
    "a;b&c|d",
    "`a`",
    "@x",
    "?",
    "???",
    "..x",
]


@pytest.fixture(autouse=True)
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    OmegaConf.register_new_resolver("slug", slug, replace=True)
    return tmp_path


def config(command: str, *arguments: str) -> Any:
    """The settings that a run would get."""
    return _config(KINDS[command], config_of(command, *translated(command, KINDS[command], arguments)))


def refused(command: str, *arguments: str) -> str:
    with pytest.raises(InputError) as error:
        translated(command, KINDS[command], arguments)
    line = str(error.value)
    assert "hydra.cc" not in line and "mismatched" not in line and "\n" not in line
    return line


@pytest.mark.parametrize("name", NAMES)
def test_a_file_of_any_name(name: str) -> None:
    """Alone, in lists with and without quotes, and where it names what is not there yet."""
    Path(name).write_text("x")
    Path("other.pcd").write_text("x")

    def opened(given: Any) -> bool:
        return Path(given).samefile(name)

    lists = [f"intrinsics=[{name},other.pcd]", f"poses=[other.pcd, {name}, other.pcd]", f"mask=[other.pcd,{name}]"]
    got = config("predict", f"input={name}", f"model={name}", *lists)
    assert opened(got.input) and opened(got.model)
    assert opened(got.intrinsics[0]) and got.intrinsics[1:] == ["other.pcd"]
    assert opened(got.poses[1]) and got.poses[::2] == ["other.pcd"] * 2
    assert opened(got.mask[1]) and got.mask[:1] == ["other.pcd"]


@pytest.mark.parametrize("name", [n for n in NAMES if n not in ("null", "???", "~", "[x].pcd") and n[0] not in "'\""])
def test_a_name_that_is_not_there(name: str) -> None:
    got = config("predict", f"input={name}", f"mask={name}")
    assert got.input == got.mask == name


@pytest.mark.parametrize("command", KINDS)
def test_every_path_setting_of_every_command(command: str) -> None:
    paths = {"predict": ["input", "model", "intrinsics", "poses", "mask"], "evaluate": ["objects", "model", "cache"]}
    paths |= {
        "train": ["objects", "trials", "cache", "prototypes_from"],
        "simulate": ["objects", "out"],
        "report": ["runs"],
    }
    paths |= {"export": ["objects", "trials", "out"], "baseline": ["export", "checkpoints"], "hand": ["urdf"]}
    needed = {"predict": ["input=x"], "evaluate": ["objects=x"]}.get(command, [])
    for key in paths[command]:
        given = [argument for argument in needed if not argument.startswith(key)]
        assert getattr(config(command, *given, f"{key}=a ${{b}}'s, (1)"), key) == "a ${b}'s, (1)"
    if command != "report":
        key = paths[command][0]
        assert getattr(config(command, f"{key}=~/x"), key) == f"{os.environ['HOME']}/x"


@given(st.text(st.characters(blacklist_characters="\0/", blacklist_categories=["Cs"]), min_size=1, max_size=12))
@hypothesis_settings(max_examples=25, deadline=None, database=None)
def test_any_text_is_a_name(name: str) -> None:
    given = "./" + name  # neither a list, nor quoted, nor null
    assert config("predict", f"input={given}").input == given


def test_hydras_own_forms_go_on_working() -> None:
    assert config("predict", "input='a b.pcd'").input == "a b.pcd"
    assert config("predict", "input=[\"a,b\", 'it\\'s',c]").input == ["a,b", "it's", "c"]
    assert config("predict", "input=x", "mask=null").mask is None
    assert config("predict", "input=x", "intrinsics=[615,615,319.5,2e2]").intrinsics == [615, 615, 319.5, 200]
    assert config("predict", "input=x", "viewpoints=[0,0,0]").viewpoints == [0, 0, 0]
    assert config("predict", "input=x", "viewpoints=[[0,0,1],[1,0,0]]", "++seed=3").seed == 3
    assert config("export", "format=[acronym,isaac]").format == ["acronym", "isaac"]
    assert config(
        "train", "+ablation=noise_none", "features.radius=0.02", "hand.preshapes.NPG.opening=0.05"
    ).features.radius
    assert config("train", "hand.joints.new_joint.effort=3", "~hand.preshapes.NPG").hand.joints["new_joint"].effort == 3
    assert config("report", "objects=2").objects == 2
    run = "outputs/train/2026-11-29_07-50-04.000000_K=20"
    assert config("train", f"prototypes_from={run}").prototypes_from == run
    assert translated("train", TrainConfig, ["-m", "+ablation=glob(noise*)"]) == ["-m", "+ablation=glob(noise*)"]
    assert translated("train", TrainConfig, ["-m", "K=5,10"]) == ["-m", "K=5,10"]
    assert translated("evaluate", EvaluateConfig, ["objects=a b,c", "-m"]) == ["-m", "objects='a b','c'"]
    assert translated("report", ReportConfig, ["runs=[a,b],[c]", "-m"]) == ["-m", "runs=['a','b'],['c']"]


@pytest.mark.parametrize(
    ("command", "arguments", "words"),
    [
        ("predict", ["mug.ply"], ["input=mug.ply", "no key"]),
        ("evaluate", ["meshes"], ["objects=meshes"]),
        ("predict", ["--input", "mug.ply"], ["--input: ", "input=mug.ply"]),
        ("predict", ["--input=mug.ply"], ["input=mug.ply"]),
        ("predict", ["-n", "3"], ["key=value"]),
        ("predict", ["input=a", "n=3"], ["n: ", "did you mean N?"]),
        ("predict", ["input=a", "top=3"], ["top: ", "N=COUNT is how many of each type"]),
        ("predict", ["input=a", "viewpoint=[0,0,0]"], ["did you mean viewpoints?"]),
        ("predict", ["input=a", "out=b"], ["out: ", "unknown key"]),
        ("predict", ["input=a", "sensing.distance=3"], ["sensing.distance: ", "unknown key"]),
        ("predict", ["input=a", "+nosuch=3"], ["nosuch: "]),
        ("predict", ["input=a", "intrinsics=615,615,319.5,239.5"], ["intrinsics=[615,615,319.5,239.5]"]),
        ("train", ["distance=1"], ["did you mean sensing.distance?"]),
        ("train", ["K=5,10"], ["K: ", "-m"]),
        ("train", ["K=(5"], ["K: ", "quotes"]),
        ("export", ["license=mine (all)"], ["license: ", "\"license='mine (all)'\""]),
        ("predict", ["input=a", "viewpoints=[[0,0,0"], ["viewpoints: "]),
        ("predict", ["--cfg", "nosuch"], ["--cfg"]),
        ("train", ["=3"], ["=: "]),
        ("train", ["-m", "seed=range(0)"], ["seed: expected at least one value to try, got none in range(0)"]),
        ("train", ["-m", "seed=range(3,3)"], ["seed: expected at least one value"]),
        ("train", ["-m", "seed=range(0,3,0)"], ["seed: expected at least one value"]),
        ("train", ["-m", "+ablation=glob(nosuch*)"], ["ablation: expected at least one value"]),
        ("predict", [""], ["no key"]),
    ],
)
def test_what_is_wrong_is_told_in_one_line(command: str, arguments: list[str], words: list[str]) -> None:
    line = refused(command, *arguments)
    assert all(word in line for word in words), line


def test_several_files_without_brackets() -> None:
    for name in ("a.png", "b.png"):
        Path(name).write_text("x")
    assert "input=[a.png,b.png]" in refused("predict", "input=a.png,b.png")


def test_a_range_of_seeds_is_a_sweep_over_them() -> None:
    """Hydra's own syntax: the upper end is not in it."""
    *_, word = translated("train", TrainConfig, ["-m", "+K=20", "seed=range(5)"])
    sweep = OverridesParser.create().parse_override(word)
    assert list(sweep.sweep_string_iterator()) == ["0", "1", "2", "3", "4"]
    with pytest.raises(InputError, match=r"^seed: expected one value, or a list .* or -m to try each; got range\(5\)"):
        translated("train", TrainConfig, ["+K=20", "seed=range(5)"])
