"""Which candidates are tried on an object where a budget allots them (`simulate budget=...`).

The budget counts trials that need physics; of collisions geometry tells, and they cost nothing. It is spent in rounds:
each goes to the grasp type whose rate of success is known least, until nothing is left to spend or to try, or all rates
are known well enough. Within a type candidates are tried in the order in which they were sampled, so that what is tried
is a random sample of it.

All follows from the outcomes on the object alone: from no other object, and not from when and where trials ran.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

from spgf_torch.simulation.config import Budget
from spgf_torch.simulation.table import OUTCOMES, TrialTable
from spgf_torch.simulation.worker import COLLISION, episodes


@dataclass(frozen=True)
class Request:
    """Rows `first` to `end` of an object's candidates, of one type, until `most` trials that need physics ended."""

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


def allot(outcomes: Sequence[str | None], types: int, budget: Budget, failed: Collection[int] = ()) -> Allotted:
    """Replay all rounds on the outcomes that are there, up to the first that is not.

    Args:
        outcomes: of each row, None where there is none yet; as many rows of each type, one type after the other.
        failed: rows that get no outcome in this call; they count as trials that needed physics and did not succeed.
    """
    size = len(outcomes) // types
    rows, left = [0] * types, budget.trials
    while left > 0 and (code := _next_type(outcomes, rows, budget)) is not None:
        row, stop, most = code * size + rows[code], (code + 1) * size, min(budget.round, left)
        while row < stop and most > 0:
            if outcomes[row] is None and row not in failed:
                end = next((later for later in range(row, stop) if outcomes[later] is not None), stop)
                return Allotted(tuple(rows), Request(row, end, most))
            if outcomes[row] != COLLISION:
                most, left = most - 1, left - 1
            row += 1
        rows[code] = row - code * size
    return Allotted(tuple(rows), None)


def _next_type(outcomes: Sequence[str | None], rows: Sequence[int], budget: Budget) -> int | None:
    """Return the type whose rate is known least, after `rows` of each; None where all are known or at their end."""
    size = len(outcomes) // len(rows)
    unknown = {
        code: uncertainty(outcomes[code * size : code * size + count])
        for code, count in enumerate(rows)
        if count < size
    }
    code = max(unknown, key=unknown.__getitem__, default=None)
    return None if code is None or unknown[code] <= budget.uncertainty else code


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
