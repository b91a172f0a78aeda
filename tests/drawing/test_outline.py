"""Outlines of open hands: forks of jaws, and the edges of the fingers of any other hand, by hand (m)."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from asymmetric import GRIPPERS

from spgf_torch.drawing.outline import edges, fork, outline, outline_words
from spgf_torch.drawing.style import TYPE_COLOURS, type_colours
from spgf_torch.reporting.figures.scenes import hands


def box(size: tuple[float, float, float], at: tuple[float, float, float]) -> trimesh.Trimesh:
    return trimesh.creation.box(size).apply_translation(at)


def test_a_fork_ends_at_the_pads_and_approaches_along_z() -> None:
    handle, palm, left, right = fork(0.08, 0.03, 0.02, 0.01)
    assert handle[:, 2].tolist() == [-0.05, -0.03] and palm[:, 0].tolist() == [-0.04, 0.04]
    assert left.tolist() == [[-0.04, 0, -0.03], [-0.04, 0, 0.01]]
    assert right.tolist() == [[0.04, 0, -0.03], [0.04, 0, 0.01]]


def test_each_finger_is_a_spoke_and_the_edge_that_faces_the_axis() -> None:
    """Three upright fingers, one of two shapes, on a palm whose front lies 20 mm behind the TCP. Their middles are at
    (50, 0), (-30, 40) and (0, -25) mm, 10 mm wide: the ways to the axis leave the boxes at x = 45; at y = 35,
    of which 30 / 40 is x = -26.25; at y = -20."""
    palm = box((0.12, 0.12, 0.04), (0, 0, -0.04))
    first = [box((0.01, 0.01, 0.03), (0.05, 0, -0.005)), box((0.01, 0.01, 0.03), (0.05, 0, 0.015))]
    others = [box((0.01, 0.01, 0.06), (-0.03, 0.04, 0.005)), box((0.01, 0.01, 0.05), (0, -0.025, 0.0))]
    found = edges([palm, *first, *others], behind=0.03, handle=0.02)
    assert len(found) == 1 + 3 * 2
    np.testing.assert_allclose(found[0], [[0, 0, -0.04], [0, 0, -0.02]])
    for (spoke, edge), (x, y, tip) in zip(
        found[1:].reshape(3, 2, 2, 3), ((0.045, 0, 0.03), (-0.02625, 0.035, 0.035), (0, -0.02, 0.025)), strict=True
    ):
        np.testing.assert_allclose(spoke, [[0, 0, -0.02], [x, y, -0.02]], atol=1e-6)
        np.testing.assert_allclose(edge, [[x, y, -0.02], [x, y, tip]], atol=1e-6)


def test_an_edge_follows_a_finger_that_bends() -> None:
    """A wedge from 40 mm off the axis at its foot to 10 mm half way up, where a second one turns it back."""
    corners = np.array([[0.04, 0, 0.0], [0.06, 0, 0.0], [0.01, 0, 0.05], [0.03, 0, 0.05]])
    low = trimesh.Trimesh(np.concatenate([corners + np.array([0, y, 0]) for y in (-0.01, 0.01)])).convex_hull
    high = low.copy().apply_transform(np.diag([1.0, 1.0, -1.0, 1.0])).apply_translation([0, 0, 0.1])
    found = edges([low, high], behind=0.05, handle=0.02)[1:]  # it ends above the foot: no spoke
    height = np.array([*found[:, 0, 2], found[-1, 1, 2]])
    assert height[0] == pytest.approx(0, abs=1e-6) and height[-1] == pytest.approx(0.1, abs=1e-6)
    reach = np.array([*found[:, 0, 0], found[-1, 1, 0]])
    np.testing.assert_allclose(reach, 0.01 + 0.03 / 0.05 * np.abs(height - 0.05), atol=1e-5)


def test_words_and_colours_for_any_types() -> None:
    """Jaws are forks, others lines, both if both occur; the paper's types keep their colours, others differ."""
    jaw, other = GRIPPERS["WPG"], replace(GRIPPERS["NPG"], jaw=False)
    assert outline_words({"a": jaw}, "their tips").endswith("two fingers that end at their tips.")
    assert outline_words({"a": other}).startswith("Lines are the open hand")
    assert outline_words({"a": jaw, "b": other}).count("open hand") == 2
    colours = type_colours(("NPG", "hook", "sphere", "CG"))
    assert colours["NPG"] == TYPE_COLOURS["NPG"] and colours["CG"] == TYPE_COLOURS["CG"]
    assert len({colours[name] for name in ("NPG", "hook", "sphere", "CG")}) == 4
    assert np.array_equal(outline(jaw, 0.03, 0.02), fork(jaw.width, 0.03, 0.02, jaw.depth))
    assert len(outline(other, 0.03, 0.02)) == 1 + 2 * 2  # its two fingers, each a spoke and an edge


def test_outlines_of_different_hands_stand_in_one_array() -> None:
    """A fork has four segments, the other hand five: the fork's last finger stands in it twice."""
    sticks = [fork(0.08, 0.03, 0.02, 0.0), outline(replace(GRIPPERS["NPG"], jaw=False), 0.03, 0.02)]
    T = np.tile(np.eye(4), (2, 1, 1))
    T[1, 0, 3] = 0.5
    placed = hands(T, sticks)
    assert placed.shape == (2, 5, 2, 3)
    np.testing.assert_allclose(placed[0], [*sticks[0], sticks[0][-1]])
    np.testing.assert_allclose(placed[1], sticks[1] + np.array([0.5, 0, 0]))
    assert hands(T[:0], []).shape == (0, 0, 2, 3)
