"""Options as shells are used to: each is the override that Hydra's form would be; what is wrong is one line."""

import re
import shlex
from pathlib import Path

import pytest
from commands import ROOT
from test_command_line import KINDS, NAMES, config

from spgf_torch.cli.options import as_overrides
from spgf_torch.errors import InputError
from spgf_torch.files.given_paths import model_of_hand


@pytest.fixture(autouse=True)
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def overrides(command: str, *arguments: str) -> list[str]:
    return as_overrides(command, KINDS[command], arguments)


@pytest.mark.parametrize(
    ("command", "given", "expected"),
    [
        ("predict", "mug.ply --viewpoint 0 0.5 -2", "viewpoints=[0,0.5,-2] input=mug.ply"),
        ("predict", "--viewpoint 0,0.5,-2 mug.ply", "viewpoints=[0,0.5,-2] input=mug.ply"),
        ("predict", "--viewpoint 0 0 1 --viewpoint 2 0 0 mug.ply", "viewpoints=[[0,0,1],[2,0,0]] input=mug.ply"),
        ("predict", "input=mug.ply --hand panda N=3", "input=mug.ply N=3 model=data/models/panda"),
        ("predict", "input=mug.ply hand=panda", "input=mug.ply model=data/models/panda"),
        ("predict", "--N 5 a.ply b.ply", "N=5 input=['a.ply','b.ply'] batch=true"),
        ("predict", "-N 5 7.ply", "N=5 input=7.ply"),
        ("predict", "--input a.ply --input b.ply", "input=['a.ply','b.ply']"),
        ("predict", "--as cloud --crop-low -1 -2 0", "read_as=cloud crop_low=[-1,-2,0]"),
        ("predict", "--table find --input=x=1.ply", "table=find input=x=1.ply"),
        ("predict", "--table 0 0 1 0 --gravity auto x", "table=[0,0,1,0] gravity=auto input=x"),
        ("predict", "--viewpoint [[0,0,1],[1,0,0]] x", "viewpoints=[[0,0,1],[1,0,0]] input=x"),
        ("predict", "x --out run", "hydra.run.dir=run input=x"),
        ("predict", "-m x out=run seed=1,2", "-m hydra.sweep.dir=run seed=1,2 input=x"),
        ("predict", "--cfg job --proposing clutter", "--cfg job proposing=clutter"),
        ("predict", "-- --seed 3", "input=['--seed','3'] batch=true"),
        ("simulate", "--out table --skip-bad --candidates 5", "out=table skip_bad=true candidates=5"),
        ("evaluate", "--table true --objects x", "table=true objects=x"),  # a switch here, of scenes four numbers
        ("simulate", "--no-skip-bad", "skip_bad=false"),
        (
            "train",
            "meshes --ablation noise_none --features.radius 0.02",
            "+ablation=noise_none features.radius=0.02 objects=meshes",
        ),
        ("train", "~hand.preshapes.NPG +K=7", "~hand.preshapes.NPG +K=7"),
        ("export", "acronym isaac", "format=[acronym,isaac]"),
        ("hand", "--hand gripper.urdf", "hand=gripper.urdf"),
    ],
)
def test_an_option_is_the_override_that_it_stands_for(command: str, given: str, expected: str) -> None:
    assert overrides(command, *given.split()) == expected.split()


@pytest.mark.parametrize("name", [name for name in NAMES if name != "~"])
def test_a_file_of_any_name_is_a_word(name: str) -> None:
    Path(name).write_text("x")
    assert overrides("predict", name) == [f"input={name}"]


def test_files_of_a_batch_arrive_as_they_are_called() -> None:
    names = ["it's.pcd", "a,b.pcd", "a=b.pcd", "c d.pcd", "[x].pcd", "e\\f.pcd", "${x}", "gone.pcd"]
    for name in names[:-1]:
        Path(name).write_text("x")
    got = config("predict", *overrides("predict", *names))
    assert got.input == names and got.batch


def test_text_that_hydra_could_not_read_is_quoted() -> None:
    assert config("export", *overrides("export", "--license", "mine (all)")).license == "mine (all)"


@pytest.mark.parametrize(
    ("command", "given", "words"),
    [
        ("predict", "--viewpiont 0 0 0", ["--viewpiont: ", "did you mean --viewpoints?"]),
        ("predict", "--top 3", ["--top: ", "N=COUNT is how many of each type"]),
        ("predict", "--handd panda", ["did you mean --hand?"]),
        ("predict", "x --hand pandda", ["hand: ", "panda", "did you mean panda?"]),
        ("predict", "x --hand panda --model m", ["got both"]),
        ("predict", "x --seed", ["--seed: expected a value after it, got none"]),
        ("predict", "x --seed --json", ["--seed: expected a value after it, got --json"]),
        ("predict", "x.ply --viewpoint a b c", ["--viewpoint: expected 3 numbers after it; got a b c"]),
        ("predict", "--viewpoint 0 0 x.ply --N 3", ["--viewpoint: expected 3 numbers after it; got 0 0 x.ply"]),
        ("predict", "x --viewpoint 0 1 2 3", ["--viewpoint: expected 3 numbers after it; got 0 1 2 3"]),
        ("predict", "x --crop-low x", ["--crop-low: expected 3 numbers after it; got x"]),
        ("predict", "x --table up", ["--table: expected 4 numbers after it, or find; got up"]),
        ("predict", "x --gravity 0 0 --N 3", ["--gravity: expected 3 numbers after it, or auto; got 0 0"]),
        ("predict", "x --seed 1 --seed 2", ["seed: expected one value, got 1 and 2"]),
        ("predict", "x --hand panda hand=sdh2", ["hand: expected one value, got panda, and hand=sdh2"]),
        ("predict", "x --voxel 0.002 voxel=0.01", ["voxel: expected one value, got 0.002, and voxel=0.01"]),
        ("predict", "x --viewpoint 0 0 1 viewpoints=[9,9,9]", ["viewpoints: expected one value, got [0,0,1], and"]),
        ("predict", "a.ply input=b.ply", ["input: expected one value, got a.ply, and input=b.ply"]),
        ("train", "--nosuch 3", ["--nosuch: expected an option of train (see --help), got an unknown one"]),
    ],
)
def test_what_is_wrong_is_told_in_one_line(command: str, given: str, words: list[str]) -> None:
    with pytest.raises(InputError) as error:
        overrides(command, *given.split())
    assert all(word in str(error.value) for word in words), error.value


def test_every_shipped_judge_is_a_hand() -> None:
    names = [path.parent.name for path in (ROOT / "data/models").glob("*/judge.json")]
    assert "panda" in names and all(Path(ROOT, model_of_hand(name), "judge.json").is_file() for name in names)


def test_commands_of_the_page_have_settings_that_exist() -> None:
    page = (ROOT / "docs/howto/command.md").read_text(encoding="utf-8")
    found = [line.split("#")[0] for line in re.findall(r"^spgf (?!completion)(.*)$", page, re.MULTILINE)]
    for line in found:
        command, *words = shlex.split(re.sub(r">.*|--json", "", line.replace("gripper.yaml", "panda")))
        config(command, *overrides(command, *words))
    assert len(found) >= 5


def test_both_columns_of_the_page_mean_the_same() -> None:
    page = (ROOT / "docs/howto/command.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `([^`]+)` \| `([^`]+)` \|$", page, re.MULTILINE)
    command = {"--ablation": "train", "--features.radius": "train"}
    for option, override in rows:
        words = option.split()
        assert overrides(command.get(words[0], "predict"), *words) == [override]
    assert len(rows) >= 7
