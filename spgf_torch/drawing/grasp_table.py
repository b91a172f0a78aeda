"""Ranked grasps as a table for a terminal."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rich import box
from rich.table import Table

from spgf_torch.hands.records import Grasp

PROTOTYPES = 3  # that are named for a grasp


def grasp_table(grasps: Sequence[Grasp], names: Sequence[str] | None = None, targets: bool = False) -> Table:
    """Grasps, best first: rank, type, probability (%), votes, TCP position (mm) and approach direction in the input's
    frame, and the prototypes that gave most votes with their share; with `targets` the target too. Where a judge
    ranked, no votes and no prototypes. `names`: a word for each prototype.
    """
    voted = not any(grasp.judged for grasp in grasps)
    where = f"{opened(grasps)}; TCP position and approach in the input's frame"
    table = Table(
        title="Ranked grasps",
        caption=f"{where}; prototypes with their share of the votes" if voted else where,
        box=box.SIMPLE_HEAD,
    )
    for heading in ("rank", "type", "prob. (%)", *(["votes"] if voted else []), "x y z (mm)", "approach"):
        table.add_column(heading, justify="left" if heading == "type" else "right", no_wrap=True)
    if voted:
        table.add_column("prototypes")
    if targets:
        table.add_column("target", justify="right")
    for rank, grasp in enumerate(grasps, start=1):
        table.add_row(
            str(rank),
            grasp.type,
            f"{100 * grasp.probability:.1f}",
            *([str(grasp.support)] if voted else []),
            " ".join(f"{1000 * value:4.0f}" for value in grasp.T_input_tcp[:3, 3]),
            direction(grasp),
            *([voters(grasp, names)] if voted else []),
            *([str(grasp.target)] if targets else []),
        )
    return table


def opened(grasps: Sequence[Grasp]) -> str:
    """What the grasp types are, in a line: how far the hand is open before it closes, where that is known."""
    widths = {grasp.type: grasp.width for grasp in grasps}
    words = [name if math.isnan(width) else f"{name} {1000 * width:.3g} mm" for name, width in sorted(widths.items())]
    return f"type: how far the hand is open before it closes, {', '.join(words)}"


def direction(grasp: Grasp) -> str:
    """The approach in the input's frame as a unit vector."""
    return " ".join(f"{value:5.2f}" for value in grasp.T_input_tcp[:3, 2] + 0.0)


def voters(grasp: Grasp, names: Sequence[str] | None = None) -> str:
    """The prototypes with most votes, each with its share of all votes."""
    votes = sum(count for _, count in grasp.voted_by)
    return ", ".join(
        f"{names[prototype] if names else f'#{prototype}'} {100 * count / votes:.0f} %"
        for prototype, count in grasp.voted_by[:PROTOTYPES]
        if count
    )
