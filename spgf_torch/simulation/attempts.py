"""What a worker does: a chunk of candidates on one object, each tried; and what becomes of a chunk whose process died.

Does not import torch, which no trial needs: a worker is there in two seconds, with a third of the memory.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from spgf_torch.simulation.worker_process import Cell, CellDiedError, limited

if TYPE_CHECKING:
    from spgf_torch.hands.hand import Hand
    from spgf_torch.objects.grasp_object import GraspObject
    from spgf_torch.simulation.config import EpisodeConfig

# How many time limits of a trial the making of an object may take: the first one loads the simulator.
BUILDING = 10

# T_object_tcp (4, 4) -> one of `table.OUTCOMES`.
Attempt = Callable[[np.ndarray], str]


@dataclass(frozen=True)
class Trials:
    """How trials are run: the hand and the settings of an episode."""

    hand: Hand
    episode: EpisodeConfig


def physics(obj: GraspObject, trials: Trials, kind: str) -> Attempt:
    """Pre-check, then the episode in SAPIEN."""
    from spgf_torch.simulation.episode import Simulator  # a parent of workers never steps a scene: no need of SAPIEN
    from spgf_torch.simulation.precheck import PreCheck

    check = PreCheck(obj, trials.hand.preshapes[kind])
    simulator = Simulator(obj, trials.hand, trials.episode)
    return lambda T: "collision" if check.collides(T) else simulator.run(T, kind)


@dataclass(frozen=True)
class Case:
    """One object and grasp type, and how it is tried; `key` stands for all that is not compared."""

    key: str
    kind: str
    obj: GraspObject = field(compare=False)
    trials: Trials = field(compare=False)
    make: Callable[[GraspObject, Trials, str], Attempt] = field(default=physics, compare=False)

    @staticmethod
    def of(
        obj: GraspObject,
        trials: Trials,
        kind: str,
        make: Callable[[GraspObject, Trials, str], Attempt] = physics,
    ) -> Case:
        return Case(f"{obj.digest} {trials.hand.digest} {trials.episode} {make.__qualname__}", kind, obj, trials, make)


@dataclass(frozen=True)
class Ended:
    """How a chunk ended.

    Attributes:
        outcomes: of each candidate one of `table.OUTCOMES`, or None where it has none.
        reasons: index into `outcomes` -> why it has none.
        unbuilt: why the object could not be made, if it could not; then no candidate has an outcome.
        incident: what happened on the way, if anything did, and was made good or is among `reasons`.
    """

    outcomes: list[str | None]
    reasons: dict[int, str] = field(default_factory=dict)
    unbuilt: str = ""
    incident: str = ""


def try_chunk(case: Case, T_object_tcp: np.ndarray, limit: float | None = None) -> Ended:
    """Try each of T_object_tcp (M, 4, 4) in this process, which ends if one takes longer than `limit` seconds."""
    try:
        with limited(limit and BUILDING * limit):
            attempt = _attempt(case)
    except Exception as error:  # whatever is wrong with one object, the others go on
        return Ended([None] * len(T_object_tcp), unbuilt=told(error))
    outcomes: list[str | None] = []
    reasons: dict[int, str] = {}
    for index, T in enumerate(T_object_tcp):
        try:
            with limited(limit):
                outcomes.append(attempt(T))
        except Exception as error:
            outcomes.append(None)
            reasons[index] = told(error)
    return Ended(outcomes, reasons)


def try_in_cell(cell: Cell, case: Case, T_object_tcp: np.ndarray, limit: float | None = None) -> Ended:
    """`try_chunk` in a process of its own.

    Where that process dies, the candidates are tried again one by one, each once: those that end have their outcome
    as if nothing had happened, since no trial depends on another.
    """
    try:
        return cell.call(try_chunk, case, T_object_tcp, limit)
    except CellDiedError as died:
        incident = f"{case.obj.name} {case.kind}: a process died ({died}); {len(T_object_tcp)} candidates tried again"
    outcomes: list[str | None] = []
    reasons: dict[int, str] = {}
    for index in range(-1, len(T_object_tcp)):  # first none at all: only the object is made
        try:
            one = cell.call(try_chunk, case, T_object_tcp[max(index, 0) : index + 1], limit)
        except CellDiedError as died:
            one = Ended([None], {0: _overdue(limit) if died.overdue else str(died)})
            if index < 0:
                one = Ended([], unbuilt=one.reasons[0])
        if one.unbuilt:
            return Ended([None] * len(T_object_tcp), unbuilt=one.unbuilt, incident=incident)
        outcomes += one.outcomes
        if one.reasons:
            reasons[index] = one.reasons[0]
    return Ended(outcomes, reasons, incident=incident)


@lru_cache(maxsize=2)
def _attempt(case: Case) -> Attempt:
    """What is prepared for an object is kept by the worker for the chunks to come."""
    return case.make(case.obj, case.trials, case.kind)


def _overdue(limit: float | None) -> str:
    return f"did not end within {limit:g} s"


def told(error: Exception) -> str:
    """In one line."""
    lines = str(error).splitlines()
    return f"{type(error).__name__}: {lines[0][:200]}" if lines else type(error).__name__
