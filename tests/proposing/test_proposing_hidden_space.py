"""Which places no camera saw free, worked out for one camera that looks along z at a step."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from spgf_torch.proposing.clearance import Plane
from spgf_torch.proposing.config import proposing_named
from spgf_torch.proposing.hidden_space import hidden_places
from spgf_torch.sensing.cameras import Camera
from spgf_torch.sensing.unseen import DepthView

CONFIG = replace(proposing_named("clutter").neighbours, unseen_from=0.01, unseen_depth=0.06, unseen_cell=0.01)
FAR = 10.0  # m; so far away the camera's rays are nearly parallel
POINTS = torch.tensor([[-0.05, -0.05, 0.0], [0.0, 0.05, 0.04]])


def view(left: float, right: float) -> DepthView:
    """A camera `FAR` below the origin that looks up: at x < 0 it meets something at z = left, elsewhere at right."""
    K = np.array([[10_000.0, 0, 150], [0, 10_000, 150], [0, 0, 1]])
    T = np.eye(4)
    T[2, 3] = -FAR
    depth = np.where(np.arange(301) < 150, FAR + left, FAR + right) * np.ones((301, 1))
    return DepthView.of(depth, Camera(K, T, 301, 301))


def slow(views: list[DepthView], least_z: float) -> set[tuple[int, ...]]:
    """Cells, in whole cells from the lowest: by x and z alone, as the step says, and only the outer ones."""
    low, high = POINTS.amin(0) - CONFIG.unseen_depth, POINTS.amax(0) + CONFIG.unseen_depth
    shape = [len(torch.arange(float(a), float(b), 0.01)) for a, b in zip(low, high, strict=True)]
    kinds = np.zeros(shape, dtype=int)  # 0 free or unknown, 1 solid, 2 hidden
    places = low + 0.01 * (torch.tensor(list(np.ndindex(*shape))) + 0.5)
    least = torch.stack([v.behind(places) for v in views]).amin(0).tolist()
    for (i, j, k), behind, z in zip(np.ndindex(*shape), least, places[:, 2].tolist(), strict=True):
        below = z <= least_z + 0.01
        kinds[i, j, k] = 1 if below or 0 < behind <= 0.06 else 0
        if kinds[i, j, k] and not below and behind > 0.01:
            kinds[i, j, k] = 2
    outer = set()
    for cell in zip(*np.nonzero(kinds == 2), strict=True):
        beside = [tuple(np.add(cell, step)) for step in np.vstack([np.eye(3, dtype=int), -np.eye(3, dtype=int)])]
        inside = [all(0 <= c < n for c, n in zip(other, shape, strict=True)) for other in beside]
        if not all(inside) or any(kinds[other] == 0 for other in beside):
            outer.add(tuple(int(c) for c in cell))
    return outer


@pytest.mark.parametrize(("views", "table"), [([view(0.0, 0.03)], None), ([view(0.0, 0.2)], -0.02)])
def test_equals_a_slow_loop(views: list[DepthView], table: float | None) -> None:
    plane = None if table is None else Plane.of((0.0, 0.0, 1.0), table)
    found = hidden_places(POINTS, views, plane, CONFIG)
    low = POINTS.amin(0) - CONFIG.unseen_depth
    cells = {tuple(cell) for cell in ((found - low) / 0.01).floor().long().tolist()}
    assert len(cells) == len(found) > 50
    assert cells == slow(views, -1.0 if table is None else table)


def test_behind_a_step_by_hand() -> None:
    """What lies 10 to 60 mm behind the near half, and the far one, which is 30 mm further away."""
    x, _, z = hidden_places(POINTS, [view(0.0, 0.03)], None, CONFIG).unbind(1)
    for side, surface in ((x < -0.001, 0.0), (x > 0.001, 0.03)):
        assert bool(side.any()) and float(z[side].min()) > surface + 0.0099
        assert float(z[side].max()) < surface + 0.0601
    assert len(hidden_places(POINTS, [view(0.0, 0.03), view(0.2, 0.2)], None, CONFIG)) == 0  # the second sees through


def test_nothing_is_known_without_images_points_or_depth() -> None:
    one = [view(0.0, 0.03)]
    assert hidden_places(POINTS, [], None, CONFIG).shape == (0, 3)
    assert hidden_places(POINTS[:0], one, None, CONFIG).shape == (0, 3)
    assert hidden_places(POINTS, one, None, replace(CONFIG, unseen_depth=0.0)).shape == (0, 3)
    assert len(hidden_places(POINTS + torch.tensor([5.0, 0, 0]), one, None, CONFIG)) == 0  # beyond the image
