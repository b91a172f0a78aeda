"""Grasps as a short table of text or HTML: what a console and a notebook show."""

from __future__ import annotations

import html
from collections.abc import Sequence

from spgf_torch.hands.records import Grasp

MOST = 10  # rows
_HEAD = ("", "type", "probability", "x y z (mm)", "approach", "width (mm)")
_TARGET = "target"


def table_text(grasps: Sequence[Grasp]) -> str:
    """How many there are, and the best, a line each, by their index."""
    rows = [_heading(grasps), *_rows(grasps[:MOST], grasps)] if grasps else []
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ["  ".join(word.rjust(width) for word, width in zip(row, widths, strict=True)) for row in rows]
    return "\n".join([_title(grasps), *lines, *_rest(grasps)])


def table_html(grasps: Sequence[Grasp]) -> str:
    """The same as a table of HTML."""
    cells = [_heading(grasps), *_rows(grasps[:MOST], grasps)] if grasps else []
    rows = ["".join(f"<td>{html.escape(word)}</td>" for word in row) for row in cells]
    table = f"<table>{''.join(f'<tr>{row}</tr>' for row in rows)}</table>" if rows else ""
    return f"<p>{_title(grasps)}</p>{table}{''.join(f'<p>{line}</p>' for line in _rest(grasps))}"


def _title(grasps: Sequence[Grasp]) -> str:
    return f"{len(grasps)} grasp{'' if len(grasps) == 1 else 's'}{', best first' if len(grasps) > 1 else ''}"


def _rest(grasps: Sequence[Grasp]) -> list[str]:
    return [f"... and {len(grasps) - MOST} more"] if len(grasps) > MOST else []


def _heading(grasps: Sequence[Grasp]) -> tuple[str, ...]:
    return (*_HEAD, *([_TARGET] if _several(grasps) else []))


def _rows(shown: Sequence[Grasp], grasps: Sequence[Grasp]) -> list[tuple[str, ...]]:
    several = _several(grasps)
    return [
        (
            str(index),
            grasp.type,
            f"{100 * grasp.probability:.1f} %",
            " ".join(f"{value:5.0f}" for value in 1000 * grasp.T_input_tcp[:3, 3]),
            " ".join(f"{value:5.2f}" for value in grasp.T_input_tcp[:3, 2] + 0.0),
            f"{1000 * grasp.width:.0f}",
            *([str(grasp.target)] if several else []),
        )
        for index, grasp in enumerate(shown)
    ]


def _several(grasps: Sequence[Grasp]) -> bool:
    return any(grasp.target != 1 for grasp in grasps)
