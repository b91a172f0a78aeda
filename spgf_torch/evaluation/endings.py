"""How trials ended and why: in lines, of an episode that knows causes, and each of the best grasps that failed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from spgf_torch.evaluation.success import ALL
from spgf_torch.experiment.describe import Grasps
from spgf_torch.experiment.execution import Executed
from spgf_torch.objects.grasp_object import GraspObject
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


@dataclass(frozen=True)
class Failed:
    """One of the best grasps (CG) that failed: on which object, in which draw, from 0; its rank there, from 1."""

    name: str
    draw: int
    rank: int
    grasp_type: str
    label: Label


def failed_grasps(
    objects: Sequence[GraspObject],
    grasps: Sequence[Grasps],
    by_draw: Sequence[Sequence[Executed]],
    grasp_types: Sequence[str],
) -> list[Failed]:
    """Those of each object by draw and rank; by_draw: of each draw what became of every object's grasps."""
    return [
        Failed(obj.name, draw, rank, grasp_types[int(its.grasp_type[index])], label)
        for obj, its, *ran in zip(objects, grasps, *by_draw, strict=True)
        for draw, executed in enumerate(ran)
        for rank, index in enumerate(executed.best[ALL].tolist(), start=1)
        if (label := Label.of(executed.ended[index])).outcome != "success"
    ]
