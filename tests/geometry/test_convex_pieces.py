"""What of a surface is open to space, and few pieces of it."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from spgf_torch.geometry.convex_pieces import FewPieces, few_convex_pieces, open_share


def test_the_open_share_of_a_slot_a_box_and_a_closed_room() -> None:
    wide, deep = 0.03, 0.04
    walls = [trimesh.creation.box((0.01, 2.0, deep)).apply_translation((side * (wide + 0.01) / 2, 0, deep / 2))
             for side in (-1, 1)]  # fmt: skip
    slot = trimesh.util.concatenate([*walls, trimesh.creation.box((0.05, 2.0, 0.01)).apply_translation((0, 0, -0.005))])
    up, points = np.array([[0.0, 0.0, 1.0]] * 2), np.array([[0.0, 0.0, 0.0], [0.02, 0.0, deep]])
    bottom, top = open_share(slot, points, up)
    # The middle of an infinite slot sees the sine of half its opening angle: wide / 2 over the distance of an edge.
    assert bottom == pytest.approx(wide / 2 / np.hypot(wide / 2, deep), abs=0.06) and top == 1.0
    room = trimesh.creation.box((0.1, 0.1, 0.1))
    assert open_share(room, np.zeros((1, 3)), up[:1])[0] == 0.0


def test_the_finest_tolerance_that_makes_few_pieces() -> None:
    ring = trimesh.creation.annulus(r_min=0.03, r_max=0.034, height=0.01, sections=64)
    config = FewPieces(0.0005, 0.0, 0.005, 0.01, coarsest=0.006, slack=0.0002, openness=0.1, most=100)
    fine = few_convex_pieces(ring, config)
    config.most = 8
    few = few_convex_pieces(ring, config)
    config.most = 1
    least = few_convex_pieces(ring, config)  # even the coarsest keeps the hole
    assert 8 < len(fine) <= 100 and 1 < len(few) <= 8 and 1 < len(least) <= len(few)
