"""A short table of grasps for a console and a notebook."""

from dataclasses import replace

from asymmetric import GRIPPERS, asymmetric

from spgf_torch.grasps.grasps import Grasps
from spgf_torch.grasps.words import MOST

TABLE = """\
2 grasps, best first
   type  probability         x y z (mm)           approach  width (mm)
0   WPG       87.5 %    100   200   300   0.50  0.00  0.87          80
1   NPG       25.0 %    100   200   300   0.50  0.00  0.87          40"""


def grasps(count: int = 2, target: int = 1) -> Grasps:
    first, second = asymmetric(), replace(asymmetric("NPG", 0.25), target=target)
    return Grasps((first, *[second] * (count - 1)), GRIPPERS)


def test_a_console_shows_index_type_probability_place_and_width() -> None:
    assert repr(grasps()) == TABLE
    assert repr(grasps()[:0]) == "0 grasps" and repr(grasps(1)).startswith("1 grasp\n")


def test_a_long_list_is_cut_and_says_so() -> None:
    lines = repr(grasps(MOST + 5)).splitlines()
    assert len(lines) == MOST + 3 and lines[-1] == "... and 5 more"


def test_targets_are_told_where_there_are_several() -> None:
    assert "target" not in repr(grasps())
    assert [line.split()[-1] for line in repr(grasps(target=7)).splitlines()[1:]] == ["target", "1", "7"]


def test_a_notebook_shows_a_table() -> None:
    shown = grasps()._repr_html_()
    assert shown.count("<tr>") == 3 and "<td>87.5 %</td>" in shown and "more" not in shown
    hostile = Grasps((replace(asymmetric(), type="<script>"),), GRIPPERS)
    assert "<script>" not in hostile._repr_html_() and grasps()[:0]._repr_html_() == "<p>0 grasps</p>"
