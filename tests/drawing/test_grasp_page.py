"""The page and the picture of a cloud with grasps: shapes in space by hand, and what stands in the page."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from asymmetric import EXACT, GRIPPERS, asymmetric
from shown_grasps import ball, write_shown

from spgf_torch.drawing.grasp_page import write_scene_page
from spgf_torch.drawing.grasp_scene import ELEVATION, PATCHES, look, pieces, scene_of
from spgf_torch.drawing.outline import outline
from spgf_torch.errors import InputError


def test_the_outline_ends_at_the_fingertips() -> None:
    """Fingers 80 mm apart, out to 15 mm beyond the TCP; in the input's frame the closing direction is +y and the
    approach (0.5, 0, c): the tips lie at (0.1, 0.2, 0.3) + 0.015 (0.5, 0, c) -+ 0.04 (0, 1, 0) =
    (0.1075, 0.16 or 0.24, 0.3129904)."""
    _, palm, left, right = outline(GRIPPERS["WPG"], 0.045, 0.03)
    assert palm[:, 0].tolist() == [-0.04, 0.04] and left[1].tolist() == [-0.04, 0, 0.015]
    assert right[0].tolist() == palm[1].tolist()
    segments = scene_of(*ball(), [asymmetric()], GRIPPERS).outlines[0]
    tips = segments[2:, 1]
    np.testing.assert_allclose(tips, [[0.1075, 0.16, 0.3129904], [0.1075, 0.24, 0.3129904]], atol=EXACT)


def test_lines_are_cut_into_short_pieces() -> None:
    """25 mm in pieces of at most 10 mm: three of 8.3 mm; a line of no length is one piece."""
    long, none = pieces(np.array([[[0, 0, 0], [0.025, 0, 0]], [[1, 1, 1], [1, 1, 1.0]]]), 0.01)
    np.testing.assert_allclose(long[:, 0], [0, 0.025 / 3, 0.05 / 3, 0.025])
    assert len(none) == 2


def test_patches_lie_in_the_surface() -> None:
    points, normals = ball()
    patches = scene_of(points, normals, [], GRIPPERS).patches
    order = np.argmin(np.linalg.norm(patches.mean(axis=1)[:, None] - points, axis=-1), axis=1)
    off = np.einsum("pcj,pj->pc", patches - points[order][:, None], normals[order])
    assert np.abs(off).max() < 1e-9
    assert len(scene_of(*ball(PATCHES + 10), [], GRIPPERS).patches) == PATCHES


@pytest.mark.parametrize(
    ("seen", "towards"),
    [
        ([0, 0, 1.0], "above"),  # a table
        ([-0.8, 0.0, 0.6], "above"),  # a view from -x, z up
        ([0, 0, -1.0], "front"),  # a camera's own frame: z forwards
        ([0, -0.6, -0.8], "front"),  # the same, of things seen from above
    ],
)
def test_the_eye_is_where_the_surface_was_seen_from(seen: list[float], towards: str) -> None:
    eye = look(np.tile(seen, (10, 1)))
    assert eye.towards @ seen > 0.5
    assert eye.up.tolist() == ([0, 0, 1] if towards == "above" else [0, -1, 0])
    np.testing.assert_allclose(eye.axes @ eye.axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(eye.axes) == pytest.approx(1)


def test_a_table_says_what_is_up() -> None:
    """A camera's own frame, z forwards, above a table whose normal is (0, -0.8, -0.6), seen from the camera's side."""
    up = np.array([0.0, -0.8, -0.6])
    eye = look(np.tile([0.0, 0.0, -1.0], (10, 1)), up)
    np.testing.assert_allclose(eye.up, up, atol=1e-12)
    assert eye.towards @ up == pytest.approx(np.sin(np.radians(ELEVATION))) and eye.towards[2] < 0
    np.testing.assert_allclose(eye.axes @ eye.axes.T, np.eye(3), atol=1e-12)
    assert look(np.tile([0.0, 0.0, -1.0], (10, 1)), np.array([0.0, 0.0, -1.0])).up.tolist() == [0, 0, -1]


def test_a_single_point_can_be_drawn() -> None:
    assert np.isfinite(scene_of(np.zeros((1, 3)), np.array([[0, 0, 1.0]]), [], GRIPPERS).patches).all()


@pytest.mark.parametrize(("points", "normals"), [((0, 3), (0, 3)), ((4, 2), (4, 2)), ((4, 3), (5, 3)), ((3,), (3,))])
def test_unusable_clouds_are_told_in_one_line(points: tuple[int, ...], normals: tuple[int, ...]) -> None:
    with pytest.raises(InputError, match=r"scene: expected points and normals \(M, 3\)"):
        scene_of(np.zeros(points), np.zeros(normals), [], GRIPPERS)


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Grasps, with names that would break a careless page."""
    folder = tmp_path_factory.mktemp("scene")
    write_shown(folder)
    return folder


def content(page: Path) -> dict:
    return json.loads(re.search(r'<script type="application/json" id="content">(.*?)</script>', page.read_text())[1])


def test_the_page_needs_nothing_else_and_is_small(written: Path) -> None:
    text = (written / "index.html").read_text()
    assert len(text) < 1_500_000 and {path.name for path in written.iterdir()} == {"index.html", "grasps.png"}
    own = re.sub(r"<script>.*?</script>", "", text, flags=re.DOTALL)  # three.js itself has addresses, unused
    assert not re.search(r"""(src|href)=["']?(https?:)?//|url\(["']?(https?:)?//|@import""", own)
    assert "default-src 'none'" in own and text.count("</script>") == 3 and "$" not in own.split("<style>")[0]
    assert (written / "grasps.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


def test_hostile_names_are_text(written: Path) -> None:
    text = (written / "index.html").read_text()
    assert "<b>evil" not in text and "<img src=x" not in text and "</script><b>" not in text
    assert "Grasps for &lt;img src=x onerror=alert(1)&gt;.pcd" in text
    assert "spgf predict &#x27;a &quot;b&quot;&#x27;" in text
    found = content(written / "index.html")
    assert found["prototypes"]["7"]["name"] == "</script><b>evil 7"


def test_what_is_said_of_the_page(written: Path) -> None:
    text = (written / "index.html").read_text()
    for name, value in (("hand", "claw"), ("model", "claw (3b6d4dc3)"), ("grasps", "4")):
        assert f"<dt>{name}</dt><dd>{value}</dd>" in text
    assert '<p class="doubt">nothing sure &lt;b&gt;</p>' in text
    assert "<h2>Input</h2><ul><li>voxels of 2 mm</li></ul>" in text and "<h2>Model</h2>" in text


def test_the_table_has_each_grasp(written: Path) -> None:
    """Rank 3: target 2, probability 0.3, judged (0.6, 0.5); TCP (100, 200, 300) mm, approach (0.5, 0, 0.87)."""
    rows = re.findall(r"<tr>(.*?)</tr>", (written / "index.html").read_text())
    cells = [re.sub("<[^>]*>", "", cell) for cell in re.findall(r"<td.*?</td>", rows[3])]
    assert [" ".join(cell.split()) for cell in cells] == [
        "3",
        "WPG",
        "2",
        "30.0",
        "60",
        "50",
        "100 200 300",
        "0.50 0.00 0.87",
    ]


def test_a_page_without_grasps(tmp_path: Path) -> None:
    write_scene_page(tmp_path / "a.html", tmp_path / "a.png", *ball(), [], GRIPPERS)
    text = (tmp_path / "a.html").read_text()
    assert "<dt>grasps</dt><dd>0</dd>" in text and "<p>No grasp.</p>" in text
    assert content(tmp_path / "a.html")["hands"] == {}
