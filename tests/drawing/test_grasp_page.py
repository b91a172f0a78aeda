"""The page and the picture of a cloud with grasps: shapes in space by hand, and the page in a real browser."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from asymmetric import EXACT, GRIPPERS, asymmetric
from browser import needs_browser, opened

from spgf_torch.drawing.grasp_page import write_scene_page
from spgf_torch.drawing.grasp_scene import PATCHES, Beside, look, pieces, scene_of
from spgf_torch.drawing.outline import outline
from spgf_torch.drawing.page_hands import fractions
from spgf_torch.errors import InputError


def ball(count: int = 400) -> tuple[np.ndarray, np.ndarray]:
    """Points and normals of a ball of 40 mm."""
    normals = np.random.default_rng(0).normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return np.array([0.1, 0.2, 0.3]) + 0.04 * normals, normals


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


def test_a_single_point_can_be_drawn() -> None:
    assert np.isfinite(scene_of(np.zeros((1, 3)), np.array([[0, 0, 1.0]]), [], GRIPPERS).patches).all()


@pytest.mark.parametrize(("points", "normals"), [((0, 3), (0, 3)), ((4, 2), (4, 2)), ((4, 3), (5, 3)), ((3,), (3,))])
def test_unusable_clouds_are_told_in_one_line(points: tuple[int, ...], normals: tuple[int, ...]) -> None:
    with pytest.raises(InputError, match=r"scene: expected points and normals \(M, 3\)"):
        scene_of(np.zeros(points), np.zeros(normals), [], GRIPPERS)


def closing(way: float) -> np.ndarray:
    """(9, 2, 4, 4): the two fingers of `GRIPPERS`, which close along x by `way` each."""
    moves = np.tile(np.eye(4), (9, 2, 1, 1))
    moves[:, 0, 0, 3], moves[:, 1, 0, 3] = way * fractions(), -way * fractions()
    return moves


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three grasps, with names of prototypes that would break a careless page."""
    folder = tmp_path_factory.mktemp("scene")
    grasps = [asymmetric(), asymmetric("NPG", 0.5), asymmetric("WPG", 0.0)]
    names = [f"</script><b>rim {i}" for i in range(8)]
    beside = Beside(closing={"WPG": closing(0.04), "NPG": closing(0.02)})
    write_scene_page(folder / "grasps.html", folder / "grasps.png", *ball(), grasps, GRIPPERS, names, beside)
    return folder


def test_the_page_needs_nothing_else(written: Path) -> None:
    text = (written / "grasps.html").read_text()
    assert text.count("plotly.js v") == 1  # the banner of the library
    own = re.sub(r"<script>.*?</script>", "", text, flags=re.DOTALL)  # plotly.js itself has addresses, unused
    assert not re.search(r"""(src|href)=["']?(https?:)?//|url\(["']?(https?:)?//|@import""", own)
    content = json.loads(re.search(r'<script type="application/json">(.*?)</script>', text, re.DOTALL)[1])
    assert [len(content[key]) for key in ("outlines", "hands", "approaches")] == [3, 3, 3]
    assert [hand["type"] for hand in content["hands"]] == ["WPG", "NPG", "WPG"]
    wide = content["shapes"]["WPG"]
    assert wide["starts"] == [0, 8, 16] and min(wide["x"]) == -50 and max(wide["z"]) == 15
    assert wide["moves"][4] == [[1, 0, 0, 20, 0, 1, 0, 0, 0, 0, 1, 0], [1, 0, 0, -20, 0, 1, 0, 0, 0, 0, 1, 0]]
    assert content["hands"][0]["pose"][:4] == [0, -0.866025, 0.5, 100]
    assert [line["line"]["color"] for line in content["outlines"][1:]] == ["#f2b33d", "#c8102e"]
    words = content["outlines"][0]["text"]
    assert all(part in words for part in ("<b>1</b>", "WPG", "88 %", "42 votes", "rim 7 71 %", "rim 3 29 %"))
    assert "&lt;/script&gt;" in words and "</script>" not in words
    assert (written / "grasps.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert {path.name for path in written.iterdir()} == {"grasps.html", "grasps.png"}


def test_a_page_without_grasps(tmp_path: Path) -> None:
    write_scene_page(tmp_path / "a.html", tmp_path / "a.png", *ball(), [], GRIPPERS)
    assert "0 grasps" in (tmp_path / "a.html").read_text()


@needs_browser
def test_a_browser_turns_and_chooses(written: Path, tmp_path: Path) -> None:
    """A grasp is chosen in the table, its whole hand is drawn, and nothing goes wrong on the way."""
    then = """<script>addEventListener("DOMContentLoaded", () => {
      document.querySelectorAll("#ranked tbody tr")[1].click();
      const plot = document.querySelector(".plot");
      const slider = document.querySelector(".close input"), before = plot.data.at(-2).y[0];
      slider.value = 0.75;
      slider.dispatchEvent(new Event("input"));
      console.log("drawn", plot.data.length, document.querySelector("select").selectedIndex,
        (plot.data.at(-2).y[0] - before).toFixed(2));
    });</script></body>"""
    page, picture = tmp_path / "page.html", tmp_path / "page.png"
    page.write_text((written / "grasps.html").read_text().replace("</body>", then))
    console = opened(page, picture)
    wrong = [line for line in console if "Error" in line or "Uncaught" in line or ":ERROR:" in line or "ERR_" in line]
    assert not wrong and picture.stat().st_size > 20_000, console
    # Cloud, 3 outlines, ranks, bar; hand and its way. The first finger closes along +y of the input by 3/4 of 20 mm.
    assert any('"drawn 8 2 15.00"' in line for line in console), console
