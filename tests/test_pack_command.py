"""`pack` from the outside, and what it leaves read back: by a name, whole or not at all, the same model."""

import json
import shutil
from pathlib import Path

import numpy as np
import torch
from commands import ROOT, here

import spgf_torch
from spgf_torch.affordance.model import load_model
from spgf_torch.predictor import Predictor

SHIPPED = ROOT / "data/models/robotiq_3f"
KEPT = {"README.md", "hand", "judge.json", "judge.safetensors", "model.json", "model.safetensors"}


def test_pack_keeps_a_model_by_a_name_and_replaces_none_by_accident(tmp_path: Path) -> None:
    shutil.copytree(SHIPPED, tmp_path / "from")
    (tmp_path / "models/other").mkdir(parents=True)
    (tmp_path / "models/other/notes.txt").write_text("mine")
    lines = (
        ("model=from", "name=mine", "whole=true"),
        ("model=from", "name=mine"),
        ("model=from", "name=mine", "replace=true"),
        ("model=from", "name=other", "replace=true"),
        ("model=from", "name=a", "out=b"),
        ("model=from",),
    )
    done, again, replaced, foreign, both, neither = (here("pack", *line, cwd=tmp_path) for line in lines)
    assert done.returncode == replaced.returncode == 0, done.stderr + replaced.stderr
    assert "votes: hand robotiq_3f, 50 objects" in done.stdout and "judge: hand robotiq_3f" in done.stdout
    assert {path.name for path in (tmp_path / "models/mine").iterdir()} == KEPT
    for refused, words in (
        (again, "name: expected a new one, got models/mine, which is there; replace=true replaces it"),
        (foreign, "name: expected a new folder or a model's, got another one at models/other"),
        (both, "name: expected name=NAME or out=FOLDER, got both"),
        (neither, "name: expected name=NAME or out=FOLDER, got none"),
    ):
        assert refused.returncode == 2 and words in refused.stderr, refused.stderr
        assert refused.stderr.count("\n") == 1
    assert [path.name for path in (tmp_path / "models/other").iterdir()] == ["notes.txt"]
    assert sorted(path.name for path in (tmp_path / "models").iterdir()) == ["mine", "other"]
    check_card((tmp_path / "models/mine/README.md").read_text(), (SHIPPED / "README.md").read_text())
    small = json.loads((tmp_path / "models/mine/model.json").read_text())["small"]
    assert small["left_out"] == 0 and small["points"] == len(load_model(SHIPPED).condensed.cell)


def check_card(card: str, before: str) -> None:
    """It says its name, and of the card before only what that told of votes and judge, as deep as it stood there."""
    headings = [[line for line in text.splitlines() if line.startswith("#")] for text in (card, before)]
    assert headings[0][0] == "# mine: grasps of the hand robotiq_3f" and "`spgf predict FILE --model mine`" in card
    assert headings[0][1:] == headings[1][1:] and len(headings[0]) > 5
    assert card.count("from_pretrained") == card.count("- Votes: ") == 1


def test_a_pretrained_model_is_saved_elsewhere_and_is_the_same(tmp_path: Path) -> None:
    model = Predictor.from_pretrained(SHIPPED)
    place = model.save_pretrained(tmp_path / "there", small=False)
    other = spgf_torch.load(place)
    ours, theirs = load_model(SHIPPED), load_model(place)
    for name in ("cell", "probability", "support", "partition_start", "base_rate"):
        assert torch.equal(getattr(ours.condensed, name), getattr(theirs.condensed, name)), name
    assert other.identity["judge"]["digest"] == model.identity["judge"]["digest"]
    assert other.hand is not None and model.hand is not None and other.hand.digest == model.hand.digest
    assert repr(other).startswith("Predictor(hand robotiq_3f, 50 objects") and len(repr(other)) < 250
    for name, gripper in model.grippers.items():
        np.testing.assert_array_equal(gripper.T_base_tcp, other.grippers[name].T_base_tcp)
