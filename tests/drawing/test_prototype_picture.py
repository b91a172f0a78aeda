"""Pictures of prototypes: what is drawn, where, and how little text it is."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest

from spgf_torch.drawing.prototype_picture import BOX, prototype_svg
from spgf_torch.errors import InputError

RIM = np.zeros((2, 36, 2))
RIM[0, :, 0], RIM[0, :, 1] = 5, np.linspace(0, 40, 36)
RIM[1, :, 0], RIM[1, :, 1] = 10, 170
RIM[:, 30:] = 90, 90  # nothing past the rim


def shapes(svg: str) -> list[np.ndarray]:
    """The corners (P, 2) of each line and shape, in the picture's units."""
    found = []
    for x, y, steps in re.findall(r"M(-?\d+) ?(-?\d+)l([-\d ]+)", svg):
        moves = np.array(re.findall(r"-?\d+", steps), dtype=float).reshape(-1, 2)
        found.append(np.array([float(x), float(y)]) + np.concatenate([np.zeros((1, 2)), moves.cumsum(0)]))
    return found


def test_a_rim_by_hand() -> None:
    """The camera at (-60, 38) deg sees x as (0.866, -0.308) and z as (0, 0.788), up; 64 units are the radius.

    The line ahead, 0.4 of it along x, ends 22 right and 8 down; the normal, 0.62 along z, 31 up. Of 36 cells 30 are
    drawn in each layer, and 6 in each are dashes. Cell 0 of the top layer spans -5 to 5 deg and lies 5 deg below the
    plane: its outer corner at 5 deg is 64 (0.9924, 0.0868, -0.0872), seen at (57.8, 21.2 down).
    """
    svg = prototype_svg(RIM)
    assert "M0 0l22 8" in svg and "M0 0l0-31" in svg
    found = shapes(svg)
    assert sum(len(each) == 4 for each in found) == 60 + 1  # the point's own patch is one
    dashes = svg[svg.index('d="') + 3 :].split('"')[0]
    assert dashes.count("M") == 12
    assert any((each == [58, 21]).all(axis=1).any() for each in found if len(each) == 4)
    assert ElementTree.fromstring(svg).find("{*}title").text.startswith("rim: ")  # type: ignore[union-attr]


def test_it_needs_nothing_and_takes_the_page_s_colour() -> None:
    svg = prototype_svg(RIM)
    assert "currentColor" in svg and not re.search(r"href|url\(|<script|<style|<image", svg)
    fills = set(re.findall(r'fill="(#\w+)"', svg))
    assert all(re.fullmatch("#[0-9a-f]{3}", fill) for fill in fills) and len(fills) > 3


@pytest.mark.parametrize("cells", [4, 36, 37, 360])
def test_it_is_small_and_within_its_box(cells: int) -> None:
    """A bump, a hollow, and the steepest wall that is no gap, of any number of cells."""
    around = np.arange(cells) * 2 * np.pi / cells
    for height, lower in ((45 * np.cos(around), 30), (-50 + 9 * np.sin(around), -20), (np.full(cells, 59.0), 59)):
        rings = np.stack([np.stack([height, 90 + 80 * np.sin(around)], 1), np.full((cells, 2), [lower, 170.0])])
        svg = prototype_svg(rings)
        assert len(svg.encode()) <= 4096
        points, (x, y, width, size) = np.concatenate(shapes(svg)), BOX
        assert (points >= [x, y]).all() and (points <= [x + width, y + size]).all()


def test_nothing_around_it() -> None:
    svg = prototype_svg(np.full((2, 36, 2), 90.0))
    assert sum(len(each) == 4 for each in shapes(svg)) == 1 and len(svg) < 1500


@pytest.mark.parametrize(
    ("rings", "words"),
    [
        (np.zeros((36, 2)), r"^rings_deg: expected shape \(2, cells, 2\), got \(36, 2\)$"),
        (np.zeros((2, 0, 2)), "got \\(2, 0, 2\\)"),
        (np.full((2, 36, 2), np.nan), "^rings_deg: expected finite angles in degrees, got NaN or infinity$"),
    ],
)
def test_no_rings_no_picture(rings: np.ndarray, words: str) -> None:
    with pytest.raises(InputError, match=words):
        prototype_svg(rings)
