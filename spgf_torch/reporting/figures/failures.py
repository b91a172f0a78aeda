"""Executed grasps that failed, on the objects where most of them did, and how they ended."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from textwrap import wrap

import numpy as np

from spgf_torch.drawing.page import drawn, png
from spgf_torch.evaluation.endings import failure_counts
from spgf_torch.experiment.describe import Grasps
from spgf_torch.experiment.execution import Executed
from spgf_torch.hands.records import Gripper
from spgf_torch.objects.grasp_object import GraspObject
from spgf_torch.reporting.figures.learned import deep_outline
from spgf_torch.reporting.figures.scenes import Held, worst
from spgf_torch.simulation.label import Label

MOST = 6  # objects in the picture: two rows
LINE, LINES = 46, 2  # characters of a line below an object, and lines: its panel is 2.7 inches wide


def failures_shown(
    objects: Sequence[GraspObject],
    grasps: Sequence[Grasps],
    executed: Sequence[Executed],
    grippers: Mapping[str, Gripper],
) -> list[Held]:
    """The objects with the lowest rate of their best grasps (CG), with these; none where all held.

    grippers: grasp type -> the open hand; the codes of `grasps` count the types sorted by name.
    """
    sticks = [deep_outline(grippers[name]) for name in sorted(grippers)]
    rows = list(zip(objects, grasps, executed, strict=True))
    failing = [row for row in rows if row[2].rate(row[2].best["CG"]) < 1 and len(row[2].best["CG"])]
    failing.sort(key=lambda row: (row[2].rate(row[2].best["CG"]), row[0].name))
    return [_held(*row, sticks) for row in failing[:MOST]]


def failures_picture(shown: Sequence[Held]) -> bytes:
    """A PNG of these objects: failed grasps red."""
    return png(drawn(worst(shown, "the ranking that was executed")))


def _held(obj: GraspObject, grasps: Grasps, executed: Executed, sticks: Sequence[np.ndarray]) -> Held:
    top = executed.best["CG"]
    why = failure_counts([Label.of(executed.ended[index]) for index in top.tolist()])
    open_hands = [sticks[code] for code in grasps.grasp_type[top].tolist()]
    held = Held.of(
        obj.name, obj.mesh, grasps.T_object_tcp[top].double().numpy(), open_hands, executed.success[top].numpy()
    )
    return replace(held, note=counted(why))


def counted(why: Mapping[str, int]) -> str:
    """How many grasps failed how, in so few lines that they fit below a picture."""
    words = ", ".join(f"{count} {told}" for told, count in why.items())
    return "\n".join(wrap(words, LINE, max_lines=LINES, placeholder=" ..."))
