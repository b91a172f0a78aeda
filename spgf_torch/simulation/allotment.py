"""Which candidates are tried on an object where a budget allots them (`simulate budget=...`).

The budget counts trials that need physics; of collisions geometry tells, and they cost nothing. It is spent in rounds:
each goes to the grasp type whose rate of success is known least, until nothing is left to spend or to try, or all rates
are known well enough. Within a type candidates are tried in the order in which they were sampled, so that what is tried
is a random sample of it.

All follows from the outcomes on the object alone: from no other object, and not from when and where trials ran.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from spgf_torch.simulation.config import Budget
from spgf_torch.simulation.table import OUTCOMES, TrialTable
from spgf_torch.simulation.worker import episodes


@dataclass(frozen=True)
class Request:
    """Rows `first` to `end` of an object's candidates, of one type, until `most` trials that need physics ended."""

    grasp_type: int
    first: int
    end: int
    most: int


@dataclass(frozen=True)
class Allotted:
    """What was allotted so far.

    Attributes:
        rows: of each grasp type, how many of its candidates.
        request: what is to be tried next; None: nothing.
    """

    rows: tuple[int, ...]
    request: Request | None


def allot(
    outcomes: Sequence[str | None], types: int, budget: Budget, failed: Mapping[int, Any] | None = None
) -> Allotted:
    """Replay all rounds on the outcomes that are there, up to the first that is not.

    Args:
        outcomes: of each row, None where there is none yet; as many rows of each type, one type after the other.
        failed: rows that have no outcome and get none in this call; they count as trials that did not succeed.
    """
    size = len(outcomes) // types
    rows, known, left = [0] * types, failed or {}, budget.trials
    while left > 0:
        unsure = {
            code: uncertainty(outcomes[code * size : code * size + rows[code]])
            for code in range(types)
            if rows[code] < size
        }
        code = max(unsure, key=unsure.__getitem__, default=None)
        if code is None or unsure[code] <= budget.uncertainty:
            break
        first, stop = code * size + rows[code], (code + 1) * size
        most = min(budget.round, left)
        row = first
        while row < stop and most > 0:
            if outcomes[row] is None and row not in known:
                end = next((later for later in range(row, stop) if outcomes[later] is not None), stop)
                return Allotted(tuple(rows), Request(code, row, end, most))
            most -= outcomes[row] != "collision"
            row += 1
        rows[code], left = row - code * size, left - episodes(outcomes[first:row])
    return Allotted(tuple(rows), None)


def uncertainty(outcomes: Sequence[str | None]) -> float:
    """Standard deviation of the rate of success among trials that need physics: of Beta(s + 1, f + 1).

    Before any trial each rate is as likely as another.
    """
    tried, held = episodes(outcomes), outcomes.count("success")
    mean = (held + 1) / (tried + 2)
    return math.sqrt(mean * (1 - mean) / (tried + 3))


def told(table: TrialTable) -> dict[str, dict[str, Any]]:
    """Say of each grasp type what a budget gave it, and why no more; of a table without a budget nothing.

    Candidates that were tried, those of them that needed physics, how many of these succeeded, how uncertain that
    leaves their rate, and what ended it: the budget, or that there were no more candidates.
    """
    if table.provenance.budget is None:
        return {}
    said = {}
    for code, name in enumerate(table.grasp_types):
        its = [OUTCOMES[word] for word in table.outcome[table.grasp_type == code].tolist()]
        said[name] = {
            "candidates": len(its),
            "physics": episodes(its),
            "success": its.count("success"),
            "uncertainty": round(uncertainty(its), 4),
            "ended": "candidates" if len(its) == table.provenance.candidates else "budget",
        }
    return said
