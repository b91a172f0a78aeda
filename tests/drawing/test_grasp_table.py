"""The ranked table as text."""

import io
from dataclasses import replace

from asymmetric import asymmetric
from rich.console import Console

from spgf_torch.drawing.grasp_table import grasp_table, opened


def text(names: list[str] | None = None) -> str:
    out = io.StringIO()
    Console(width=120, file=out).print(grasp_table([asymmetric(), asymmetric("NPG", 0.5)], names))
    return out.getvalue()


def test_a_row_says_what_where_and_why() -> None:
    """87.5 %, TCP (100, 200, 300) mm, approach (0.5, 0, 0.87); 30 of 42 votes are 71 %."""
    first = next(line for line in text().splitlines() if "WPG" in line)
    assert " ".join(first.split()) == "1 WPG 87.5 42 100 200 300 0.50 0.00 0.87 #7 71 %, #3 29 %"


def test_types_are_told_below_by_how_far_the_hand_is_open() -> None:
    assert "type: how far the hand is open before it closes, NPG 40 mm, WPG 80 mm" in text()
    unknown = replace(asymmetric(), width=float("nan"))  # of a grasp from a file that does not say
    half = replace(asymmetric("NPG", 0.5), width=0.0425)
    assert opened([unknown, half]).endswith("closes, NPG 42.5 mm, WPG")


def test_prototypes_by_name() -> None:
    names = [f"rim {i}" if i % 2 else f"[bold]wall {i}" for i in range(8)]
    assert "rim 7 71 %, rim 3 29 %" in text(names)


def test_without_votes_where_a_judge_ranked() -> None:
    """The row ends with the approach, and no line explains prototypes."""
    out = io.StringIO()
    Console(width=120, file=out).print(grasp_table([replace(asymmetric(), judged=(0.9, 0.5))]))
    row = next(line for line in out.getvalue().splitlines() if "WPG" in line)
    assert " ".join(row.split()) == "1 WPG 87.5 100 200 300 0.50 0.00 0.87"
    assert "prototypes" not in out.getvalue()
    assert "votes" not in out.getvalue()
