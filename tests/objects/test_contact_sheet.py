"""The contact sheet is a picture with something on it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.image import imread

from spgf_torch.objects.contact_sheet import contact_sheet
from spgf_torch.objects.library import load_object
from spgf_torch.paths import find


def test_contact_sheet_draws_each_object_in_its_colour(tmp_path: Path) -> None:
    """Ten cells a row: two objects fill the first two, the other eight stay white."""
    names = ("mug_coffee", "banana")
    objects = [load_object(find(f"data/objects/{name}.yaml")) for name in names]
    contact_sheet(objects, tmp_path / "sheet.png")
    picture = imread(tmp_path / "sheet.png")[..., :3]
    columns = np.array_split(picture, 10, axis=1)
    drawn = [(np.ptp(column, axis=2) > 0.1).mean() for column in columns]
    assert min(drawn[:2]) > 0.01 and max(drawn[2:]) == 0
