"""Ranked grasps as people read them in a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rich import box
from rich.table import Table

from spgf_torch.exporting.records import Grasp

PROTOTYPES = 3  # that are named for a grasp


def grasp_table(grasps: Sequence[Grasp], names: Mapping[int, str] | None = None) -> Table:
    """Grasps, best first: rank, type, probability (%), votes, TCP position (mm) and approach direction in the input's
    frame, and the prototypes that gave most votes with their share. `names`: prototype -> word for it.
    """
    table = Table(title="Ranked grasps", caption="TCP position and approach in the input's frame", box=box.SIMPLE_HEAD)
    for heading in ("rank", "type", "probability (%)", "votes", "x (mm)", "y", "z", "approach", "voted by"):
        table.add_column(heading, justify="left" if heading in ("type", "voted by") else "right", no_wrap=True)
    for rank, grasp in enumerate(grasps, start=1):
        table.add_row(
            str(rank),
            grasp.type,
            f"{100 * grasp.probability:.1f}",
            str(grasp.support),
            *(f"{1000 * value:.0f}" for value in grasp.T_input_tcp[:3, 3]),
            direction(grasp),
            voters(grasp, names),
        )
    return table


def direction(grasp: Grasp) -> str:
    """The approach in the input's frame as a unit vector."""
    return " ".join(f"{value:5.2f}" for value in grasp.T_input_tcp[:3, 2] + 0.0)


def voters(grasp: Grasp, names: Mapping[int, str] | None = None) -> str:
    """The prototypes with most votes, each with its share of all votes."""
    votes = sum(count for _, count in grasp.voted_by)
    return ", ".join(
        f"{(names or {}).get(prototype, f'prototype {prototype}')} {100 * count / votes:.0f} %"
        for prototype, count in grasp.voted_by[:PROTOTYPES]
        if count
    )
