"""Overrides on the command line, through the command itself: Hydra, types and ranges."""

import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hostile import KINDS, bounded, defaults, tree
from hydra.core.global_hydra import GlobalHydra

from spgf_torch.cli.command import run_command

CASES: list[tuple[str, list[str], str]] = [
    ("train", ["K=abc"], "K: "),
    ("train", ["features=none_such"], "none_such"),
    ("train", ["+features._target_=os.system"], "_target_"),
    ("train", ["K"], "K"),
    ("train", ["=3"], ""),
    ("train", ["device=meta"], "device"),
    ("predict", [], "input"),
    ("predict", ["input=a.npy", "viewpoints=" + "[" * 200 + "0" + "]" * 200], ""),
    ("predict", ["input=a.npy", "viewpoints=[" + ",".join(["[0,0,0]"] * 40) + "]"], "a.npy"),
]


@pytest.fixture(autouse=True)
def no_hydra_left() -> Iterator[None]:
    yield
    GlobalHydra.instance().clear()


@pytest.mark.parametrize(("command", "overrides", "word"), CASES, ids=[" ".join(o)[:40] for _, o, _ in CASES])
def test_one_line(
    command: str, overrides: list[str], word: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    defaults(command)  # registers what the settings need
    Path("objects").mkdir()
    monkeypatch.setitem(os.environ, "HYDRA_FULL_ERROR", "1")
    monkeypatch.setattr(sys, "argv", [command, *overrides])
    module: Any = __import__(f"spgf_torch.{command}", fromlist=["run"])
    if command == "predict":
        monkeypatch.setattr("spgf_torch.predict.model_and_judge", lambda model, judge: (Path(model), None))
        monkeypatch.setattr("spgf_torch.predictor.model_settings", _known)
    before = tree()
    with pytest.raises(SystemExit) as left, bounded():
        run_command(command, KINDS[command], module.run)
    said = [line for line in capsys.readouterr().err.splitlines() if line.startswith(f"{command}: ")]
    assert left.value.code == 2 and {path for path in tree() if not path.startswith("outputs")} == set(before)
    assert not [path for path in Path("outputs").rglob("*") if path.is_file()]
    assert len(said) == 1 and len(said[0]) < 1100 and said[0].isprintable() and word in said[0], said


def _known(folder: Path) -> dict[str, Any]:
    from hostile import model_document

    return model_document()["settings"]
