"""How trials ended and why, in lines: of an episode that knows causes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from spgf_torch.simulation.label import Label
from spgf_torch.simulation.table import OUTCOMES, TrialTable


def ending_lines(tables: Sequence[TrialTable]) -> list[str]:
    """Of what trials failed, most frequent first, and how firmly the others were held; nothing without causes."""
    labels = [
        label
        for table in tables
        if table.causes
        for label in table.causes.labels([OUTCOMES[code] for code in table.outcome.tolist()])
    ]
    if not labels:
        return []
    failed = failure_counts(labels)
    words = "; ".join(f"{count:,} {told}" for told, count in failed.items())
    lines = [f"why {sum(failed.values()):,} of {len(labels):,} trials failed: {words}"] if failed else []
    force = [label.force for label in labels if label.outcome == "success"]
    if force:
        low, middle = np.percentile(force, [5, 50])
        lines.append(f"held at the end by {middle:.1f} N of the weakest finger (median), 5 % by less than {low:.1f} N")
    return lines


def failure_counts(labels: Sequence[Label]) -> dict[str, int]:
    """How many ended how (`Label.told`), the most frequent first; those that held are left out."""
    counts = Counter(label.told for label in labels if label.outcome != "success")
    return dict(sorted(counts.items(), key=lambda each: (-each[1], each[0])))
