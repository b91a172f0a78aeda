"""The page of `evaluate engine=both`: what each engine holds, and the grasps on which they disagree."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from typing import Any

from spgf_torch.drawing.page import Section, View, caption, page, table, turning
from spgf_torch.evaluation.success import ALL
from spgf_torch.reporting.figures.disagreements import COLOURS, Disagreement
from spgf_torch.reporting.figures.views import solid_trace
from spgf_torch.second_engine.physics import MUJOCO, NAMES, SAPIEN

COLUMNS = (SAPIEN, MUJOCO, "both")


def engines_page(found: Mapping[str, Any], shown: Sequence[Disagreement], lines: Sequence[str], n: int) -> str:
    """One HTML file. found: `engine_results`. lines: in plain words, at the head."""
    lead = "".join(f"<p>{html.escape(line)}</p>" for line in lines)
    sections = [
        Section(
            "held", "Held", caption(f"The {n} highest-ranked grasps (CG) that were held, in percent.") + _held(found)
        ),
        Section("outcomes", "Outcomes", caption("All executed grasps, by how they end in each.") + _outcomes(found)),
        Section("disagreements", "Disagreements", _disagreements(shown)),
    ]
    return page("The same grasps in two engines", lead, sections)


def _held(found: Mapping[str, Any]) -> str:
    rows = [
        [
            html.escape(row["object"]),
            *(f"{100 * row[name]:.1f}" for name in COLUMNS),
            str(row["free"]),
            str(row["disagree"]),
        ]
        for row in found["per_object"]
    ]
    means = []
    for name in COLUMNS:
        low, high = found[name]["interval95"]["all"][ALL]
        means.append(f"{100 * found[name]['success_rate']['all'][ALL]:.1f} ({100 * low:.0f}-{100 * high:.0f})")
    totals = [str(sum(row[name] for row in found["per_object"])) for name in ("free", "disagree")]
    return table(["object", "SAPIEN", "MuJoCo", "both", "free grasps", "disagree"], [*rows, ["all", *means, *totals]])


def _outcomes(found: Mapping[str, Any]) -> str:
    rows = [[row[SAPIEN], row[MUJOCO], f"{row['grasps']:,}"] for row in found["outcomes"]]
    return table(["in SAPIEN", "in MuJoCo", "grasps"], rows, words=2)


def _disagreements(shown: Sequence[Disagreement]) -> str:
    if not shown:
        return caption("None.")
    names = tuple(f"{its.name}, {its.grasp}: {its.ends}" for its in shown)
    traces = tuple(
        [solid_trace(its.mesh), solid_trace(its.hand, COLOURS[its.holds], f"held only in {NAMES[its.holds]}")]
        for its in shown
    )
    sides = " and ".join(f"{_colour(engine)} where only {name} holds it" for engine, name in NAMES.items())
    return caption(f"The open hand where it was tried, in {sides}.") + turning(View("grasp", names, traces))


def _colour(engine: str) -> str:
    return f'<b style="color:{COLOURS[engine]}">this colour</b>'
