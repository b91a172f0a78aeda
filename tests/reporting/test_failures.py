"""The picture of executed grasps that failed: who is on it, and what it says of them."""

from __future__ import annotations

import io
from collections.abc import Sequence

import torch
from PIL import Image
from trial_objects import box, from_above

from spgf_torch.experiment.describe import Grasps
from spgf_torch.experiment.execution import Executed
from spgf_torch.hands.config import HandConfig
from spgf_torch.hands.hand import load_hand
from spgf_torch.hands.records import grippers_of
from spgf_torch.reporting.figures.failures import _held, counted, failures_picture, failures_shown
from spgf_torch.settings import settings
from spgf_torch.simulation.execute import codes


def executed(words: Sequence[str]) -> Executed:
    best = torch.arange(len(words))
    return Executed({"CG": best}, codes(words), {}, dict(enumerate(words)))


def test_how_grasps_failed_stands_below_them() -> None:
    """The most frequent first; of too many words, those that fit into two lines."""
    T = torch.from_numpy(from_above(0.08)).expand(4, 4, 4)
    words = ["rotated/turn/none/3/", "success/held/none/9/", "dropped", "rotated/turn/none/4/"]
    obj, grasps, ran = box((0.04, 0.06, 0.1)), Grasps(T, torch.tensor([0, 1, 0, 1])), executed(words)
    grippers = grippers_of(load_hand(settings(HandConfig)))
    held = _held(obj, grasps, ran, [torch.zeros(1, 2, 3).numpy()] * 2)
    assert held.title == "box: 1 of 4 held" and held.note == "2 rotated (turn), 1 dropped"
    shown = failures_shown([obj], [grasps], [ran], grippers)
    assert [its.title for its in shown] == [held.title]
    assert min(Image.open(io.BytesIO(failures_picture(shown))).size) > 100
    assert failures_shown([obj], [grasps], [executed(["success/held/none/9/"] * 4)], grippers) == []
    many = counted({f"dropped (lift, without finger_{k}_tip)": 1 for k in range(4)})
    assert many.count("\n") == 1 and many.endswith(" ...") and max(map(len, many.split("\n"))) <= 46
