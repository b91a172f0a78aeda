"""What is wrong with a hand is told before anything is simulated, by the check or the error that names it."""

import time
from pathlib import Path

import pytest
from wrong_hands import CASES, DRIVEN, PADS, Wrong, each, load, three_fingers, told

from spgf_torch.errors import InputError
from spgf_torch.handcheck.check import check_hand, checked_hand
from spgf_torch.hands.description_file import read_description

KINDS = {"signs", "axes", "pads", "limits", "inertia", "mimics", "meshes", "names"}


@pytest.mark.parametrize("wrong", CASES, ids=[f"{n} {case.kind} {case.told}" for n, case in enumerate(CASES)])
def test_every_mistake_is_told(wrong: Wrong, tmp_path: Path) -> None:
    lines = told(tmp_path, wrong)
    assert any(wrong.told in line for line in lines), lines


def test_every_kind_of_mistake_is_tried() -> None:
    assert {case.kind for case in CASES} > KINDS and len(CASES) >= 20


@pytest.mark.parametrize(
    "right",
    [
        Wrong("", "panda", ""),
        Wrong("", "sdh2", ""),
        Wrong("a mimic that is driven", "panda", "", change=DRIVEN),
        Wrong("a thumb as strong as two fingers", "sdh2", "", change=three_fingers(0.5)),
    ],
    ids=lambda right: f"{right.hand} {right.kind}",
)
def test_hands_that_are_right_pass(right: Wrong, tmp_path: Path) -> None:
    assert told(tmp_path, right) == []


def test_a_bound_is_just_kept_and_just_missed(tmp_path: Path) -> None:
    """A pad may be 1 mm below its face: 0.9 mm is, 1.1 mm is not; half an opening and the closed fingers go with it."""
    kept, missed = ({**PADS, "left": [0, depth, 0.045]} for depth in (0.0009, 0.0011))
    assert told(tmp_path, Wrong("", "panda", "", change=each("pads", kept))) == []
    lines = told(tmp_path, Wrong("", "panda", "", change=each("pads", missed)))
    assert "pad on its link of NPG: expected 1 mm at most, got 1.10 mm off the surface (left)" in lines[0]


def test_a_wrong_hand_is_refused_in_one_line_and_right_ones_cost_nothing_again(tmp_path: Path) -> None:
    wrong = Wrong("", "panda", "", change=each("pads", {**PADS, "left": [0, 0.004, 0.045]}))
    load(tmp_path, wrong)
    with pytest.raises(
        InputError, match=r"^hand panda: pad on its link of NPG: .*; 3 more, python -m spgf_torch.hand shows all$"
    ):
        checked_hand(read_description(tmp_path / "hand.yaml"))
    hand = load(tmp_path, Wrong("", "panda", ""))
    findings = check_hand(hand)
    start = time.process_time()
    assert check_hand(hand) is findings and time.process_time() - start < 0.01
