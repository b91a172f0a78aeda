"""The page of executed grasps that failed: where they are, when and why each ended, and which fingers had let go."""

from __future__ import annotations

import html
from collections.abc import Sequence

from spgf_torch.drawing.page import Section, caption, page, table, turning
from spgf_torch.evaluation.endings import Failed, failure_counts
from spgf_torch.reporting.figures.scenes import Held
from spgf_torch.reporting.figures.views import worst_view

HEAD = ["object", "draw", "rank", "type", "ended", "in phase", "cause", "weakest finger (N)", "not touching"]


def failures_page(failed: Sequence[Failed], trials: int, shown: Sequence[Held]) -> str:
    """One HTML file of the failed ones among so many trials of the best grasps; shown: objects, of the first draw."""
    counts = failure_counts([its.label for its in failed])
    why = table(["ended", "grasps"], [[html.escape(told), str(count)] for told, count in counts.items()])
    sections = [Section("why", "Why", caption("The most frequent first.") + why)]
    if shown:
        words = caption("The objects on which most of them failed, in the first draw: red failed, green held.")
        sections.append(Section("where", "Where", words + turning(worst_view(shown))))
    sections.append(Section("each", "Each", table(HEAD, [_cells(its) for its in failed])))
    lead = f"<p>{len(failed):,} of {trials:,} trials of the highest-ranked grasps (CG) failed.</p>"
    return page("Grasps that failed", lead, sections)


def _cells(its: Failed) -> list[str]:
    """What an episode without causes does not know stays empty."""
    label, known = its.label, its.label.phase != "none"
    cause = "" if label.cause == "none" else label.cause.replace("_", " ")
    force, lost = (f"{label.force:.1f}", label.lost.replace("+", ", ")) if known else ("", "")
    what = [label.outcome, label.phase if known else "", cause, force, lost]
    return [html.escape(cell) for cell in (its.name, str(its.draw), str(its.rank), its.grasp_type, *what)]
