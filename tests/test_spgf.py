"""`spgf`: help of every command, batches, JSON alone on stdout, completion in a shell."""

import json
import re
import shutil
import subprocess
from dataclasses import is_dataclass
from pathlib import Path

import pytest
import trimesh
from commands import python
from test_command_line import KINDS

from spgf_torch.__main__ import COMMANDS
from spgf_torch.cli.batch import named, run_each
from spgf_torch.cli.command_line import ALIASES, known_settings
from spgf_torch.cli.completion import options, script
from spgf_torch.cli.help_text import help_text
from spgf_torch.errors import IncompleteError, InputError


@pytest.mark.parametrize("command", KINDS)
def test_help_tells_every_setting_but_those_of_hands(command: str) -> None:
    text = help_text(command, KINDS[command])
    told = set(re.findall(r"^  --([\w.]+)", text, re.MULTILINE))
    shown = {internal: alias for alias, internal in ALIASES.items()}
    keys = {shown.get(key, key) for key, kind in known_settings(KINDS[command], "") if not is_dataclass(kind)}
    assert not {key for key in keys if not key.startswith("hand.")} - told
    assert not {f"--{key}" for key in keys - {"as"} if "." not in key} - set(options(command))


def test_help_tells_meaning_unit_range_and_default(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    text = help_text("predict", KINDS["predict"])
    assert (
        "\n  --retreat  [0.1]  0 to 1\n      m back along the approach: where the hand waits; a finger's length" in text
    )
    assert "\n  --hand NAME\n" in text and "--hand NAME\n" not in help_text("report", KINDS["report"])


def test_names_of_a_batch() -> None:
    assert named(["a/mug.ply", "b/can.pcd"]) == ["mug", "can"]
    assert named(["mug.ply", "mug.pcd", "x/mug.pcd"]) == ["mug.ply", "mug.pcd", "mug.pcd_2"]
    assert named(["cup.ply", "cup.ply"]) == ["cup.ply", "cup.ply_2"]


def test_a_bad_input_stops_no_other(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def work(each: str, place: Path) -> None:
        if each.startswith("bad"):
            raise InputError(f"{each}: expected better")
        (place / "done").write_text(each)

    with pytest.raises(IncompleteError, match="1 of 3 inputs not done"):
        run_each("predict", ["a.ply", "bad.ply", "b.ply"], tmp_path, work)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b"]
    assert (tmp_path / "b/done").read_text() == "b.ply"
    assert capsys.readouterr().err == "predict: bad.ply: expected better\n"
    with pytest.raises(InputError, match="none of 2"):
        run_each("predict", ["bad1.ply", "bad2.ply"], tmp_path, work)


def test_a_batch_with_json(tmp_path: Path) -> None:
    """One process: two boxes and what is no cloud; the model is loaded once, stdout is JSON alone."""
    trimesh.creation.box((0.04, 0.06, 0.08)).export(tmp_path / "low.stl")
    trimesh.creation.box((0.05, 0.05, 0.1)).export(tmp_path / "tall.stl")
    (tmp_path / "bad.pcd").write_text("junk\n")
    arguments = ["low.stl", "bad.pcd", "tall.stl", "--hand", "panda", "-N", "2", "--out", "run", "--json"]
    done = python("-m", "spgf_torch", "predict", *arguments, cwd=tmp_path)
    report = json.loads(done.stdout)
    assert done.returncode == report["status"] == 1 and report["command"] == "predict"
    assert [Path(run["folder"]) for run in report["runs"]] == [tmp_path / "run/low", tmp_path / "run/tall"]
    assert [run["input"] for run in report["runs"]] == ["low.stl", "tall.stl"]
    for run in report["runs"]:
        assert run["results"] == json.loads((Path(run["folder"]) / "grasps.json").read_text())
        assert len(run["results"]["grasps"]) == 4
    assert len(re.findall("^model  .* done in", done.stderr, re.MULTILINE)) == 1
    assert "predict: bad.pcd: expected" in done.stderr and "1 of 3 inputs not done" in done.stderr


def test_json_of_what_is_refused(tmp_path: Path) -> None:
    done = python("-m", "spgf_torch", "predict", "gone.ply", "--hand", "panda", "--json", cwd=tmp_path)
    assert done.returncode == 2 and len(done.stderr.splitlines()) == 1
    assert json.loads(done.stdout)["status"] == 2 and json.loads(done.stdout)["runs"] == []


TRY = """
try() { COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); _spgf; echo "${COMPREPLY[@]}"; }
try spgf pre; try spgf predict --viewp; try spgf predict --hand pan; try spgf predict mu; try spgf completion f
"""


def test_completion_in_bash(tmp_path: Path) -> None:
    printed = python("-m", "spgf_torch", "completion", "bash", cwd=tmp_path).stdout
    done = subprocess.run(["bash", "-c", printed + TRY], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["predict", "--viewpoints", "panda", "", "fish"] and not done.stderr


WORDS = ("spgf pre", "spgf predict --viewp", "spgf predict --hand pan", "spgf completion f")
COMPLETED = ["predict", "--viewpoints", "panda", "fish"]
# A shell that is typed into: tab completes, and the function that stands for the command tells its last word.
ZSH = r"""
zmodload zsh/zpty
zpty shell env TERM=dumb zsh -f -i
zpty -w shell "source ./script; spgf() { print -r -- g''ot \${@: -1}. }; print rea''dy"
zpty -r -m shell seen '*ready*'
for line in "$@"; do
  zpty -n -w shell "$line"$'\t'$'\n'
  zpty -r -m shell seen $'*got *.*'
  print -r -- "${${seen##*got }%%.*}"
done
"""


@pytest.mark.skipif(not shutil.which("zsh"), reason="no zsh here")
def test_completion_in_zsh(tmp_path: Path) -> None:
    (tmp_path / "script").write_text(script("zsh", COMMANDS))
    arguments = ["zsh", "-f", "-c", ZSH, "zsh", *WORDS]
    done = subprocess.run(arguments, cwd=tmp_path, capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.split() == COMPLETED


@pytest.mark.skipif(not shutil.which("fish"), reason="no fish here")
def test_completion_in_fish(tmp_path: Path) -> None:
    (tmp_path / "script").write_text(script("fish", COMMANDS))
    asked = "source ./script; for line in $argv; complete --do-complete $line; end"
    arguments = ["fish", "--no-config", "-c", asked, *WORDS]
    done = subprocess.run(arguments, cwd=tmp_path, capture_output=True, text=True, check=True, timeout=60)
    assert [line.split("\t")[0] for line in done.stdout.splitlines()] == COMPLETED


def test_completion_of_other_shells(tmp_path: Path) -> None:
    fish = script("fish", COMMANDS)
    assert all(f" -a {name} -d " in fish for name in COMMANDS)
    assert "'__fish_seen_subcommand_from predict' -l viewpoints\n" in fish
    assert script("zsh", COMMANDS).startswith("#compdef spgf\n")
    wrong = python("-m", "spgf_torch", "completion", "tcsh", cwd=tmp_path)
    assert wrong.returncode == 2 and wrong.stderr == "spgf completion: expected one of bash, zsh, fish; got tcsh\n"
