"""How many candidates are tried on an object where a budget allots them (`simulate budget=...`).

The budget counts trials that need physics: of a candidate whose open hand cuts the object, or in a robot's episode
meets it or the table on its way, geometry tells, and it costs nothing. Candidates are taken in the order in which they
were sampled, as many of each grasp type, until so many of them need physics. So hard objects, on which few candidates
are free, get more of them than easy ones, and what is tried on an object is a random sample: docs/howto/budget.md has
what was measured, and why types share a number.

All follows from geometry alone: from no outcome, no other object, and not from when and where trials run.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from spgf_torch.simulation.table import OUTCOMES, TrialTable

if TYPE_CHECKING:
    from spgf_torch.objects.grasp_object import GraspObject
    from spgf_torch.simulation.execute import Poses
    from spgf_torch.simulation.worker import Trials

# T_object_tcp (4, 4) -> whether geometry alone tells how that ends.
Geometry = Callable[[np.ndarray], bool]


def open_hand(obj: GraspObject, trials: Trials, grasp_type: str) -> Geometry:
    """Return the pre-check of collisions of the open hand; of a robot's episode also those on its way, with a table."""
    from spgf_torch.simulation.arrival import Arrival
    from spgf_torch.simulation.precheck import PreCheck

    if trials.episode.robot is not None:
        return Arrival(obj, trials.hand, trials.episode.robot, grasp_type).collides
    return PreCheck(obj, trials.hand.preshapes[grasp_type]).collides


def free_candidates(
    obj: GraspObject, poses: Poses, trials: Trials, geometry: Callable[[GraspObject, Trials, str], Geometry] = open_hand
) -> np.ndarray:
    """Return (types, candidates) bool: which candidates need physics."""
    free, of_types = [], np.split(poses.T_object_tcp(0, len(poses)), len(poses.grasp_types))
    for grasp_type, T in zip(poses.grasp_types, of_types, strict=True):
        tells = geometry(obj, trials, grasp_type)
        free.append([not tells(one) for one in T])
    return np.array(free, dtype=bool)


def allotted(free: np.ndarray, budget: int) -> int:
    """Return how many candidates of each type are tried: until `budget` of all need physics, or to the last.

    Args:
        free: (types, candidates) bool, in the order of sampling.
    """
    needed = np.cumsum(free.sum(axis=0))
    return min(int(np.searchsorted(needed, budget)) + 1, free.shape[1])


def told(table: TrialTable) -> dict[str, Any]:
    """Return what a budget gave an object, and why no more: nothing where there was none.

    `candidates` of each type; of each type the trials that needed `physics`; and what it `ended` with: the budget, or
    the candidates, of which there were no more.
    """
    if table.provenance.budget is None:
        return {}
    candidates = len(table) // len(table.grasp_types)
    needed = table.outcome != OUTCOMES.index("collision")
    physics = {name: int(needed[table.grasp_type == code].sum()) for code, name in enumerate(table.grasp_types)}
    all_tried = candidates == table.provenance.candidates and sum(physics.values()) < table.provenance.budget
    return {"candidates": candidates, "physics": physics, "ended": "candidates" if all_tried else "budget"}
